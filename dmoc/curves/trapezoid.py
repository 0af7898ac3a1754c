"""The movej baseline: all joints on one trapezoidal speed profile, as fast as limits allow.

Every robot controller offers this motion; it is what optimised motions are compared with. The
path is the straight line in joint space q(s) = q_0 + s (q_1 - q_0); s follows a trapezoid whose
speed and acceleration are limited by the slowest joint, so all joints start and stop together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmoc.errors import ProblemError
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.robot.robot import Robot


def trapezoid_phases(
    distance_rad: np.ndarray, velocity_rad_s: np.ndarray, acceleration_rad_s2: np.ndarray
) -> tuple[float, float]:
    """(t_a, T): ramp time and duration [s] of the fastest synchronised trapezoid.

    With v = min_j v_j/|d_j| and a = min_j a_j/|d_j| (per unit of s): if v^2/a <= 1 the profile
    has a plateau, t_a = v/a, T = 1/v + v/a; otherwise it is a triangle, t_a = sqrt(1/a), T = 2 t_a.
    """
    moving = np.abs(distance_rad) > 1e-12
    if not moving.any():
        return 0.0, 0.0
    speed = float(np.min(velocity_rad_s[moving] / np.abs(distance_rad[moving])))
    ramp = float(np.min(acceleration_rad_s2[moving] / np.abs(distance_rad[moving])))
    if speed * speed / ramp <= 1.0:
        return speed / ramp, 1.0 / speed + speed / ramp
    return float(np.sqrt(1.0 / ramp)), float(2.0 * np.sqrt(1.0 / ramp))


def trapezoid_motion(
    robot: Robot,
    start_rad: Sequence[float] | np.ndarray,
    goal_rad: Sequence[float] | np.ndarray,
    num_intervals: int = 40,
    scale: float = 1.0,
) -> JointTrajectory:
    """Fastest synchronised trapezoid from `start_rad` to `goal_rad` (n,) [rad], at rest at both.

    The knots include the ends of both ramps, so the cubic Hermite interpolant of the trajectory
    *is* the trapezoid, exactly. `scale` in (0, 1] multiplies velocity and acceleration limits.
    Torques come from inverse dynamics at the interval midpoints; torque limits are not enforced.
    Raises `ProblemError` for wrong shapes, equal ends or a bad scale.
    """
    start = np.asarray(start_rad, dtype=float)
    goal = np.asarray(goal_rad, dtype=float)
    shape = (robot.num_joints,)
    if start.shape != shape or goal.shape != shape or not np.isfinite(start + goal).all():
        raise ProblemError.of(
            "joint-vector",
            "",
            "start_rad, goal_rad",
            f"{start.shape}, {goal.shape}",
            f"{shape}, finite",
            "give one angle for each joint",
        )
    if not 0.0 < scale <= 1.0:
        raise ProblemError.of("scale", "", "scale", repr(scale), "0 < scale <= 1")
    if num_intervals < 3:
        raise ProblemError.of("num-intervals", "", "num_intervals", str(num_intervals), ">= 3")
    distance = goal - start
    ramp_s, total_s = trapezoid_phases(
        distance,
        scale * np.asarray(robot.velocity_limit_rad_s),
        scale * np.asarray(robot.acceleration_limit_rad_s2),
    )
    if total_s <= 0.0:
        raise ProblemError.of(
            "no-motion",
            "",
            "goal_rad",
            "equal to start_rad",
            "a different joint vector",
            "leave this motion out",
        )
    t = _knots(ramp_s, total_s, num_intervals)
    s, rate, _ = _profile(t, ramp_s, total_s)
    middle = 0.5 * (t[1:] + t[:-1])
    s_m, rate_m, accel_m = _profile(middle, ramp_s, total_s)
    torque = inverse_dynamics(
        robot.model,
        start + s_m[:, None] * distance,
        rate_m[:, None] * distance,
        accel_m[:, None] * distance,
    )
    q = start + s[:, None] * distance
    q[-1] = goal
    return JointTrajectory(t, q, rate[:, None] * distance, torque, robot)


def _knots(ramp_s: float, total_s: float, num_intervals: int) -> np.ndarray:
    """Times 0..T with both ramp ends among them, intervals about equally long."""
    edges = [0.0, ramp_s, total_s - ramp_s, total_s]
    if edges[2] - edges[1] < 1e-9 * total_s:
        edges = [0.0, 0.5 * total_s, total_s]
    lengths = np.diff(edges)
    counts = np.maximum(1, np.floor(num_intervals * lengths / total_s)).astype(int)
    while counts.sum() < num_intervals:
        counts[int(np.argmax(lengths / counts))] += 1
    parts = [
        np.linspace(edges[i], edges[i + 1], counts[i], endpoint=False) for i in range(len(counts))
    ]
    return np.concatenate([*parts, [total_s]])


def _profile(
    t: np.ndarray, ramp_s: float, total_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """s, ds/dt, d2s/dt2 of the unit trapezoid at times t (K,)."""
    speed = 1.0 / (total_s - ramp_s)
    accel = speed / ramp_s
    up, down = t < ramp_s, t > total_s - ramp_s
    s = speed * (t - 0.5 * ramp_s)
    s = np.where(up, 0.5 * accel * t**2, s)
    s = np.where(down, 1.0 - 0.5 * accel * (total_s - t) ** 2, s)
    rate = np.where(up, accel * t, np.where(down, accel * (total_s - t), speed))
    return s, rate, np.where(up, accel, np.where(down, -accel, 0.0))
