"""Limits as stage functions: every row is scaled so that its legal range is [−1, 1] or ≤ 1."""

from __future__ import annotations

from typing import Any

import casadi as ca

from dmoc.stages import Stage, expression_stage

__all__ = [
    "acceleration_stage",
    "end_acceleration_stage",
    "half_space_stage",
    "smoothing_stage",
    "velocity_stage",
]


def velocity_stage(n: int) -> Stage:
    """(q⁺ − q)/(h v_max); z = (q, q⁺, h), θ = v_max."""
    qa, qb, h, limit = (ca.SX.sym(s, k) for s, k in (("qa", n), ("qb", n), ("h", 1), ("v", n)))
    return expression_stage("velocity", ca.vertcat(qa, qb, h), limit, (qb - qa) / (h * limit))


def acceleration_stage(n: int) -> Stage:
    """(q⁺ − 2q + q⁻)/(h² a_max) at an inner knot; z = (q⁻, q, q⁺, h), θ = a_max."""
    qa, qb, qc, limit = (ca.SX.sym(s, n) for s in ("qa", "qb", "qc", "a"))
    h = ca.SX.sym("h")
    rows = (qc - 2 * qb + qa) / (h**2 * limit)
    return expression_stage("acceleration", ca.vertcat(qa, qb, qc, h), limit, rows)


def end_acceleration_stage(n: int) -> Stage:
    """Acceleration over the half interval next to an end, ± 2((q⁺ − q)/h − v)/(h a_max).

    z = (q, q⁺, h), θ = (a_max, v) with v the velocity prescribed at the end.
    """
    qa, qb, limit, v = (ca.SX.sym(s, n) for s in ("qa", "qb", "a", "v"))
    h = ca.SX.sym("h")
    rows = 2 * ((qb - qa) / h - v) / (h * limit)
    return expression_stage("end_acceleration", ca.vertcat(qa, qb, h), ca.vertcat(limit, v), rows)


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
