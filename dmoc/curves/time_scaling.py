r"""Time scaling of a path: as fast as the limits allow, then slowed to the best cost.

Two laws s(t) are tried on the blended path: the time-optimal one under speed, acceleration and
torque limits (TOPP-RA, Pham and Pham 2018) and the quintic 10τ³ − 15τ⁴ + 6τ⁵. Either is then run
slower by a factor κ: speeds divide by κ, torques become g + (τ − g)/κ², so

.. math:: J(\kappa) = \alpha\kappa + \beta/\kappa + \gamma/\kappa^3, \qquad
   \alpha = \int c_t + c_e\|g\|^2, \;
   \beta = \int 2 c_e g^T(\tau - g) + c_v\|\dot q\|^2, \;
   \gamma = \int c_e\|\tau - g\|^2,

with its minimum at κ² = (β + √(β² + 12αγ)) / 2α, or at the least κ that the limits allow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import toppra
from toppra.constraint import (
    JointAccelerationConstraint,
    JointTorqueConstraint,
    JointVelocityConstraint,
)
from toppra.interpolator import AbstractGeometricPath

from dmoc.arrays import Array
from dmoc.curves.blended_path import BlendedPath, FreeTest, blend_corners
from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointPath, JointTrajectory, inverse_dynamics
from dmoc.physics.running_cost import cost_rate
from dmoc.robot.robot import Robot

import pinocchio as pin  # isort: skip


Law = Literal["quintic", "toppra"]
_LIMIT_SLACK = 0.999
#: Points of the grid on which a law is found, at least.
LEAST_POINTS = 81
_PIN_TOLERANCE_RAD = 1e-9


@dataclass(frozen=True)
class TimedPath:
    """A path with its timing: `trajectory` (knots dense along the path) and its J.

    `law` names the time law; `within_limits` says whether speed, acceleration, jerk and torque
    limits hold at every knot interval's midpoint.
    """

    trajectory: JointTrajectory
    cost: float
    law: Law
    within_limits: bool


def time_scale(
    path: JointPath,
    problem: MotionProblem,
    *,
    is_free: FreeTest | None = None,
    laws: tuple[Law, ...] = ("quintic", "toppra"),
) -> TimedPath:
    """Timing of `path` for `problem`: the cheaper of the two laws after the best slow-down.

    `is_free` (rows of q → bool) guards the blends of corners. Corners at the problem's departure
    and arrival knots are passed within 1e-3 rad. `laws` are those tried; the quintic stands in
    where no time-optimal law exists. With a fixed `duration_s` the law is stretched or
    squeezed to it.
    """
    points = np.asarray(path.q_rad)
    robot = problem.robot
    blended = blend_corners(
        points, robot.velocity_limit_rad_s, pinned=_pinned(points, problem), is_free=is_free
    )
    grid = blended.grid(LEAST_POINTS)
    q, dq, ddq = blended.evaluate(grid)
    candidates = []
    if "quintic" in laws:
        candidates.append(_finish(problem, "quintic", _quintic_law(blended, grid), q, dq, ddq))
    speed = _toppra_speed(robot, blended, grid) if "toppra" in laws else None
    if speed is not None:
        t = np.concatenate([[0.0], np.cumsum(2 * np.diff(grid) / (speed[:-1] + speed[1:]))])
        candidates.append(_finish(problem, "toppra", (t, speed), q, dq, ddq))
    if not candidates:
        candidates.append(_finish(problem, "quintic", _quintic_law(blended, grid), q, dq, ddq))
    legal = [c for c in candidates if c.within_limits] or candidates
    return min(legal, key=lambda c: c.cost)


def _pinned(points: Array, problem: MotionProblem) -> Array:
    pins = np.zeros(len(points), dtype=bool)
    for knots in (problem.depart_rad, problem.arrive_rad):
        if knots is not None:
            gap = np.abs(points[:, None] - knots[None]).max(axis=2)
            pins |= (gap < _PIN_TOLERANCE_RAD).any(axis=1)
    return pins


def _quintic_law(blended: BlendedPath, grid: Array) -> tuple[Array, Array]:
    """t and ds/dt at the grid for the quintic of unit duration per unit of length."""
    # Invert s(τ) on a fine table: the quintic is monotone.
    tau = np.linspace(0.0, 1.0, 2001)
    s = tau**3 * (10 + tau * (6 * tau - 15))
    tau_at = np.interp(grid / blended.length, s, tau)
    tau_at[0], tau_at[-1] = 0.0, 1.0
    # Two Newton steps make the table exact where the slope does not vanish.
    for _ in range(2):
        slope = 30 * tau_at**2 * (1 - tau_at) ** 2
        error = tau_at**3 * (10 + tau_at * (6 * tau_at - 15)) - grid / blended.length
        tau_at = np.where(slope > 1e-3, tau_at - error / np.maximum(slope, 1e-3), tau_at)
    return tau_at * blended.length, 30 * tau_at**2 * (1 - tau_at) ** 2


class _ToppraPath(AbstractGeometricPath):
    """A blended path as toppra wants to see it."""

    def __init__(self, blended: BlendedPath) -> None:
        self._blended = blended

    def __call__(self, path_positions: float | Array, order: int = 0) -> Array:
        rows = self._blended.evaluate(np.atleast_1d(path_positions))[order]
        return rows[0] if np.ndim(path_positions) == 0 else rows

    @property
    def dof(self) -> int:
        return int(self._blended.c0.shape[1])

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self._blended.length])


def _toppra_speed(robot: Robot, blended: BlendedPath, grid: Array) -> Array | None:
    """The time-optimal ds/dt at the grid, or None where the limits leave no motion."""
    data = robot.model.createData()
    torque = _LIMIT_SLACK * robot.torque_limit_nm

    def rnea(q: Array, v: Array, a: Array) -> Array:
        return pin.rnea(robot.model, data, q, v, a)

    constraints = [
        JointVelocityConstraint(_both_signs(robot.velocity_limit_rad_s)),
        JointAccelerationConstraint(_both_signs(robot.acceleration_limit_rad_s2)),
        JointTorqueConstraint(rnea, _both_signs(torque), np.zeros(robot.num_joints)),
    ]
    solver = toppra.algorithm.TOPPRA(
        constraints, _ToppraPath(blended), gridpoints=grid, solver_wrapper="seidel"
    )
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.all(np.isfinite(speed)):
        return None
    if np.any(speed[:-1] + speed[1:] <= 1e-9):
        return None
    return np.asarray(speed)


def _both_signs(limit: Array) -> Array:
    return np.column_stack([-limit, limit])


def _finish(
    problem: MotionProblem,
    law: Law,
    timing: tuple[Array, Array],
    q: Array,
    dq: Array,
    ddq: Array,
) -> TimedPath:
    """Slow one law down to its best J and give it torques."""
    robot = problem.robot
    t, speed = timing
    raw = JointTrajectory(t, q, dq * speed[:, None], np.zeros((len(t) - 1, q.shape[1])))
    step = np.diff(t)
    mid = raw.sample(0.5 * (t[:-1] + t[1:]))
    zero = np.zeros_like(mid.q_rad)
    gravity = inverse_dynamics(robot.model, mid.q_rad, zero, zero)
    moving = inverse_dynamics(robot.model, *mid[:3]) - gravity
    least = max(
        least_slowdown(robot, mid.velocity_rad_s, mid.acceleration_rad_s2, gravity, moving),
        _slowdown_for_jerk(problem, step, raw.velocity_rad_s),
    )
    within = bool(np.isfinite(least))
    if not within:
        least = 1.0
    if problem.duration_s is not None:
        kappa = problem.duration_s / t[-1]
        within = within and kappa >= least * (1 - 1e-9)
    elif isinstance(problem.cost, Cost) and not problem.cost.has_matrices:
        kappa = best_slowdown(
            *slowdown_coefficients(problem.cost, step, mid.velocity_rad_s, gravity, moving), least
        )
    else:
        kappa = _searched_slowdown(problem, step, mid[:3], gravity, moving, least)
    torque = gravity + moving / kappa**2
    rate = cost_rate(
        problem.cost,
        robot,
        mid.q_rad,
        mid.velocity_rad_s / kappa,
        mid.acceleration_rad_s2 / kappa**2,
        torque,
    )
    slowed = JointTrajectory(t * kappa, q, raw.velocity_rad_s / kappa, torque, robot)
    return TimedPath(slowed, float(np.sum(rate * step) * kappa), law, within)


def _slowdown_for_jerk(problem: MotionProblem, step: Array, velocity: Array) -> float:
    """The least κ at which the jumps of the acceleration, by 1/κ³, meet the limit; 0 without one.

    From rest to rest: a jump counts over the time between the middles of its two intervals.
    """
    limit = problem.jerk_limit_rad_s3
    if limit is None:
        return 0.0
    still = np.zeros((1, velocity.shape[1]))
    mean = np.vstack([still, np.diff(velocity, axis=0) / step[:, None], still])
    apart = np.concatenate([step[:1], (step[1:] + step[:-1]) / 2, step[-1:]])
    return float(np.cbrt(np.max(np.abs(np.diff(mean, axis=0)) / apart[:, None] / limit)))


def least_slowdown(
    robot: Robot, velocity: Array, acceleration: Array, gravity: Array, moving: Array
) -> float:
    """The least κ > 0 at which rows (K, n) of q̇/κ, q̈/κ², g + (τ − g)/κ² meet the limits.

    Infinite where holding still already needs more than a torque limit.
    """
    by_speed = np.max(np.abs(velocity) / robot.velocity_limit_rad_s)
    by_acceleration = np.max(np.abs(acceleration) / robot.acceleration_limit_rad_s2)
    spare = robot.torque_limit_nm - np.sign(moving) * gravity
    if np.any(robot.torque_limit_nm <= np.abs(gravity)):
        return float("inf")
    by_torque = np.max(np.abs(moving) / spare)
    return float(max(by_speed, np.sqrt(by_acceleration), np.sqrt(by_torque)))


def slowdown_coefficients(
    cost: Cost, step_s: Array, velocity: Array, gravity: Array, moving: Array
) -> tuple[float, float, float]:
    """α, β, γ of J(κ) = ακ + β/κ + γ/κ³ from K samples that each stand for `step_s` (K,).

    Of the scalar weights only: with Q or R matrices the best κ is searched instead.
    """
    alpha = np.sum(step_s * (cost.time + cost.effort * np.sum(gravity**2, axis=1)))
    beta = np.sum(
        step_s
        * (
            2 * cost.effort * np.sum(gravity * moving, axis=1)
            + cost.velocity * np.sum(velocity**2, axis=1)
        )
    )
    gamma = np.sum(step_s * cost.effort * np.sum(moving**2, axis=1))
    return float(alpha), float(beta), float(gamma)


def best_slowdown(alpha: float, beta: float, gamma: float, least: float = 1.0) -> float:
    """The κ ≥ `least` that minimises ακ + β/κ + γ/κ³ (α, γ ≥ 0).

    J'(κ) = 0 has one positive root, κ² = (β + √(β² + 12αγ)) / 2α. With α = 0 slower is never
    worse without end; `least` is returned.
    """
    if alpha <= 0:
        return least
    return max(least, float(np.sqrt((beta + np.sqrt(beta**2 + 12 * alpha * gamma)) / (2 * alpha))))


def _searched_slowdown(
    problem: MotionProblem,
    step: Array,
    motion: tuple[Array, Array, Array],
    gravity: Array,
    moving: Array,
    least: float,
) -> float:
    """The best of 60 slow-downs between `least` and five times it, for any cost."""

    def total(kappa: float) -> float:
        rate = cost_rate(
            problem.cost,
            problem.robot,
            motion[0],
            motion[1] / kappa,
            motion[2] / kappa**2,
            gravity + moving / kappa**2,
        )
        return float(np.sum(rate * step) * kappa)

    tried = least * np.geomspace(1.0, 5.0, 60)
    return float(tried[int(np.argmin([total(kappa) for kappa in tried]))])
