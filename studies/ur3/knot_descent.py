r"""Free-form polish: gradient descent over every knot of a trajectory, on the exact drive model.

Optimal control needs smooth functions, so friction is rounded near standstill there, and a
solution may creep where the real joint would stick. This descent takes its knots (q_k, q̇_k), the
parameters of the Hermite curve that is replayed, and goes on with sharper and sharper friction.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.robot.robot import Robot
from studies.ur3.bezier_problem import metric_values
from studies.ur3.curve_cost import CurveCost

#: Samples per interval, and iterations at each smoothing of the kinks in turn.
SAMPLES, ITERATIONS = 4, 150
SMOOTHING_RAD_S = (0.01, 0.003, 0.001)
#: Of a limit that is broken.
PRICE = 1e4


def hermite(t: Array, knots_s: Array, derivative: int) -> Array:
    """Matrix (K, 2 (N + 1)) from knots (q_0..q_N, q̇_0..q̇_N) to the curve's derivative at t (K,)."""
    count = len(knots_s)
    k = np.clip(np.searchsorted(knots_s, t, side="right") - 1, 0, count - 2)
    h = knots_s[k + 1] - knots_s[k]
    s = (t - knots_s[k]) / h
    one = np.ones_like(s)
    shapes = {
        0: (1 - 3 * s**2 + 2 * s**3, 3 * s**2 - 2 * s**3, s - 2 * s**2 + s**3, s**3 - s**2),
        1: (6 * s**2 - 6 * s, 6 * s - 6 * s**2, 1 - 4 * s + 3 * s**2, 3 * s**2 - 2 * s),
        2: (12 * s - 6, 6 - 12 * s, 6 * s - 4, 6 * s - 2),
        3: (12 * one, -12 * one, 6 * one, 6 * one),
    }[derivative]
    matrix = np.zeros((len(t), 2 * count))
    rows = np.arange(len(t))
    for column, shape in zip((k, k + 1), shapes[:2]):
        matrix[rows, column] = shape / h**derivative
    for column, shape in zip((k, k + 1), shapes[2:]):
        matrix[rows, count + column] = shape * h / h**derivative
    return matrix


def still_joints(
    trajectory: JointTrajectory, robot: Robot, metric: str
) -> tuple[JointTrajectory, float]:
    """Joints that end where they began held still wherever that costs less; and the value."""
    value = metric_values(trajectory, robot, (metric,))[metric]
    for j in np.flatnonzero(np.abs(trajectory.q_rad[-1] - trajectory.q_rad[0]) < 1e-9):
        q, v = np.array(trajectory.q_rad), np.array(trajectory.velocity_rad_s)
        q[:, j], v[:, j] = q[0, j], 0.0
        tried = _with_knots(trajectory, robot, q, v)
        cost = metric_values(tried, robot, (metric,))[metric]
        if cost < value:
            trajectory, value = tried, cost
    return trajectory, value


def polish_trajectory(
    trajectory: JointTrajectory, robot: Robot, metric: str
) -> tuple[JointTrajectory, float]:
    """The trajectory after descent over its inner knots, and its exact value on the fine replay.

    Ends and end velocities stay. Position limits are bounds; velocity, acceleration and torque
    limits are penalties with a 1 % margin, and a step that breaks one or costs more is not taken.
    """
    t0 = trajectory.t_s - trajectory.t_s[0]
    count, n = trajectory.q_rad.shape
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    times = (t0[:-1, None] + np.diff(t0)[:, None] * share).ravel()
    q, v, a, jerk = (hermite(times, t0, k) for k in range(4))
    first, second = (hermite(t0[[0, -1]], t0, k) for k in (1, 2))
    cost = CurveCost(robot, metric, (q, v, a, jerk), (first, second), float(t0[-1] / len(times)))
    best, value = still_joints(trajectory, robot, metric)
    free = np.ones((2 * count, n), dtype=bool)
    free[[0, count - 1, count, 2 * count - 1]] = False
    idle = np.ptp(best.q_rad, axis=0) < 1e-12
    free[:, idle] = False
    knots = np.vstack([best.q_rad, best.velocity_rad_s])
    low = np.vstack([np.tile(robot.q_lower_rad, (count, 1)), np.full((count, n), -np.inf)])
    high = np.vstack([np.tile(robot.q_upper_rad, (count, 1)), np.full((count, n), np.inf)])
    box = np.stack([low[free], high[free]], axis=1)
    for level in SMOOTHING_RAD_S:

        def function(x: Array, level: float = level, at: Array = knots) -> tuple[float, Array]:
            full = at.copy()
            full[free] = x
            value, gradient = cost.descend(full, level, PRICE)
            return value, gradient[free]

        solver: Any = minimize  # its stubs know no `jac=True`
        found = solver(
            function,
            np.clip(knots[free], *box.T),
            jac=True,
            method="L-BFGS-B",
            bounds=box,
            options={"maxiter": ITERATIONS, "maxcor": 30, "ftol": 1e-11},
        )
        tried = knots.copy()
        tried[free] = found.x
        if cost.evaluate(tried[None]).excess[0] > 0.0025:
            continue
        candidate = _with_knots(best, robot, tried[:count], tried[count:])
        reached = metric_values(candidate, robot, (metric,))[metric]
        if reached < value:
            best, value, knots = candidate, reached, tried
    return best, value


def _with_knots(trajectory: JointTrajectory, robot: Robot, q: Array, v: Array) -> JointTrajectory:
    """The Hermite curve through other knots; torques by inverse dynamics at the midpoints."""
    bare = replace(trajectory, q_rad=q, velocity_rad_s=v, robot=None)
    middle = bare.sample(0.5 * (bare.t_s[1:] + bare.t_s[:-1]))
    torque = inverse_dynamics(
        robot.model, middle.q_rad, middle.velocity_rad_s, middle.acceleration_rad_s2
    )
    return replace(bare, torque_nm=torque, robot=robot)
