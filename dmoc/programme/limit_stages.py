"""Limits as stage functions: every row is scaled so that its legal range is [−1, 1] or ≤ 1."""

from __future__ import annotations

from typing import Any

import casadi as ca

from dmoc.physics.dynamics import ArmModel, lagrangian_gradients
from dmoc.programme.stages import Stage, expression_stage, local_interval


def acceleration_stage(n: int) -> Stage:
    """q̈/a_max on the interval after an inner knot, (q⁺ − 2q + q⁻)/(h² a_max) + W (û − û⁻).

    z = (q⁻, q, q⁺, h, û⁻, û), θ = (a_max, W column by column), W = M⁻¹ u_max/(2 a_max). The knots
    alone show the mean of two intervals; half the jump of the torque tells them apart.
    """
    z, (qa, qb, qc, h, before, after) = _about_knot(n)
    limit, weight = ca.SX.sym("a", n), ca.SX.sym("W", n, n)
    rows = (qc - 2 * qb + qa) / (h**2 * limit) + weight @ (after - before)
    return expression_stage("acceleration", z, ca.vertcat(limit, ca.vec(weight)), rows)


def velocity_stage(n: int) -> Stage:
    """q̇/v_max at an inner knot, (q⁺ − q⁻)/(2h v_max) − h W (û − û⁻).

    z as in `acceleration_stage`, θ = (v_max, W), W = M⁻¹ u_max/(4 v_max).
    """
    z, (qa, _, qc, h, before, after) = _about_knot(n)
    limit, weight = ca.SX.sym("v", n), ca.SX.sym("W", n, n)
    rows = (qc - qa) / (2 * h * limit) - h * (weight @ (after - before))
    return expression_stage("velocity", z, ca.vertcat(limit, ca.vec(weight)), rows)


def _about_knot(n: int) -> tuple[Any, tuple[Any, ...]]:
    """z and its parts (q⁻, q, q⁺, h, û⁻, û)."""
    names = (("qa", n), ("qb", n), ("qc", n), ("h", 1), ("before", n), ("after", n))
    parts = tuple(ca.SX.sym(*item) for item in names)
    return ca.vertcat(*parts), parts


def first_acceleration_stage(n: int) -> Stage:
    """2((q⁺ − q)/h − v)/(h a_max) of the first interval.

    z = (q, q⁺, h), θ = (a_max, v) with v the velocity prescribed at the start.
    """
    qa, qb, limit, v = (ca.SX.sym(s, n) for s in ("qa", "qb", "a", "v"))
    h = ca.SX.sym("h")
    rows = 2 * ((qb - qa) / h - v) / (h * limit)
    z = ca.vertcat(qa, qb, h)
    return expression_stage("first_acceleration", z, ca.vertcat(limit, v), rows)


def half_space_stage(n: int, capacity: int) -> Stage:
    """G₀ q + G₁ q⁺ for `capacity` rows; z = (q, q⁺), θ = (G₀, G₁), each row-major."""
    qa, qb = ca.SX.sym("qa", n), ca.SX.sym("qb", n)
    first, second = ca.SX.sym("g0", n * capacity), ca.SX.sym("g1", n * capacity)
    left, right = (ca.reshape(g, n, capacity).T for g in (first, second))
    rows = left @ qa + right @ qb
    return expression_stage("half_space", ca.vertcat(qa, qb), ca.vertcat(first, second), rows)


def smoothing_stage(n: int) -> Stage:
    """w‖û⁺ − û‖² of two neighbouring intervals; z = (û, û⁺), θ = w. A term of the objective."""
    ua, ub, weight = ca.SX.sym("ua", n), ca.SX.sym("ub", n), ca.SX.sym("w")
    step: Any = ub - ua
    return expression_stage("smoothing", ca.vertcat(ua, ub), weight, weight * ca.sumsqr(step))


def jerk_stage(n: int) -> Stage:
    """W (û − û⁻)/h, the jump of the acceleration at an inner knot per step, in shares of j_max.

    z = (h, û⁻, û), θ = W column by column, W = M⁻¹ u_max/j_max.
    """
    h, before, after = ca.SX.sym("h"), ca.SX.sym("before", n), ca.SX.sym("after", n)
    weight = ca.SX.sym("W", n, n)
    rows = weight @ (after - before) / h
    return expression_stage("jerk", ca.vertcat(h, before, after), ca.vec(weight), rows)


def end_jerk_stage(n: int) -> Stage:
    """2((q⁺ − q)/h − v)/(h² j_max): from steady motion at v to the first interval, or back to it.

    z = (q, q⁺, h), θ = (j_max, v).
    """
    qa, qb, limit, v = (ca.SX.sym(s, n) for s in ("qa", "qb", "j", "v"))
    h = ca.SX.sym("h")
    rows = 2 * ((qb - qa) / h - v) / (h**2 * limit)
    return expression_stage("end_jerk", ca.vertcat(qa, qb, h), ca.vertcat(limit, v), rows)


def rms_torque_stage(n: int) -> Stage:
    """Each interval's share of the mean square torque, (û θ)²; z = û, θ = u_max/(u_rms √N)."""
    u, theta = ca.SX.sym("u", n), ca.SX.sym("r", n)
    return expression_stage("rms_torque", u, theta, (u * theta) ** 2)


def torque_speed_stage(n: int) -> Stage:
    """u/stall + v/no-load; z = (q, q⁺, û, h), θ = (u_max/stall, no-load speed)."""
    z, qa, qb, u, h = local_interval(n)
    share, speed = ca.SX.sym("s", n), ca.SX.sym("w", n)
    rows = u * share + (qb - qa) / (h * speed)
    return expression_stage("torque_speed", z, ca.vertcat(share, speed), rows)


def path_stage(n: int, function: ca.Function) -> Stage:
    """A user's c(q, v, u) at the midpoint; z = (q, q⁺, û, h), θ = u_max."""
    z, qa, qb, u, h = local_interval(n)
    u_max = ca.SX.sym("u_max", n)
    rows = function.expand()((qa + qb) / 2, (qb - qa) / h, u * u_max)
    return expression_stage("path", z, u_max, rows)


def end_stage(n: int, function: ca.Function, num_intervals: int) -> Stage:
    """A user's function of (q_N, q̇_N, T); z = (q_N, h, q̇_N), no parameters."""
    q, h, v = ca.SX.sym("q", n), ca.SX.sym("h"), ca.SX.sym("v", n)
    rows = function.expand()(q, v, h * num_intervals)
    return expression_stage("end", ca.vertcat(q, h, v), ca.SX.sym("none", 0), rows)


def end_momentum_stage(arm: ArmModel) -> Stage:
    """−s M(q_N) q̇_N, what the last momentum row lacks when q̇_N is free; z = (q_N, q̇_N), θ = s."""
    n = arm.num_joints
    q, v, scale = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("s", n)
    momentum, _ = lagrangian_gradients(arm, q, v)
    return expression_stage("end_momentum", ca.vertcat(q, v), scale, -scale * momentum)
