"""Bounds of the variables and right-hand sides of the rows of one motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.motion import MotionProblem
from dmoc.nlp_types import Box
from dmoc.programme import MotionProgramme
from dmoc.state import mass_matrices

__all__ = ["ROW_TIME_S", "fixed_knots", "knot_bounds", "row_bounds", "variable_bounds"]

SHORTEST_STEP_S = 1e-4
LONGEST_MOTION_S = 120.0
# Rows of momentum are divided by this time [s] times u_max.
ROW_TIME_S = 0.1


def knot_bounds(problem: MotionProblem, box: Box | None) -> tuple[Array, Array]:
    """Lower and upper bound (N+1, n) [rad] of every knot; fixed knots have both equal."""
    robot, shape = problem.robot, (problem.num_intervals + 1, problem.robot.num_joints)
    lower = np.broadcast_to(robot.q_lower_rad, shape).copy()
    upper = np.broadcast_to(robot.q_upper_rad, shape).copy()
    if box is not None:
        lower, upper = np.maximum(lower, box.q_lower_rad), np.minimum(upper, box.q_upper_rad)
    for index, value in fixed_knots(problem):
        lower[index] = upper[index] = value
    return lower, upper


def variable_bounds(
    problem: MotionProblem, motion: MotionProgramme, box: Box | None
) -> tuple[Array, Array]:
    """Bounds of x."""
    layout, count = motion.layout, problem.num_intervals
    lower, upper = knot_bounds(problem, box)
    h = (SHORTEST_STEP_S, LONGEST_MOTION_S / count)
    if problem.duration_s is not None:
        h = (problem.duration_s / count,) * 2
    one = np.ones((count, problem.robot.num_joints))
    return layout.pack(lower, -one, h[0]), layout.pack(upper, one, h[1])


def fixed_knots(problem: MotionProblem) -> list[tuple[Any, Array]]:
    """Index and joint vectors of the knots that the problem prescribes."""
    fixed = [(0, problem.start_rad), (-1, problem.goal_rad)]
    if problem.depart_rad is not None:
        fixed.append((slice(1, len(problem.depart_rad) + 1), problem.depart_rad))
    if problem.arrive_rad is not None:
        fixed.append((slice(-1 - len(problem.arrive_rad), -1), problem.arrive_rad))
    return fixed


def row_bounds(
    problem: MotionProblem, motion: MotionProgramme, lower_half: Array
) -> tuple[Array, Array]:
    """Bounds of all rows; the right-hand side of the momentum rows holds the end momenta."""
    size = motion.programme.num_rows
    lower, upper = -np.ones(size), np.ones(size)
    momentum = motion.rows["momentum"]
    lower[momentum] = upper[momentum] = 0.0
    scale = 1.0 / (ROW_TIME_S * problem.robot.torque_limit_nm)
    for at, sign, q, v in (
        (0, -1.0, problem.start_rad, problem.start_velocity_rad_s),
        (-1, 1.0, problem.goal_rad, problem.goal_velocity_rad_s),
    ):
        if np.any(v):
            p = sign * scale * (mass_matrices(problem.robot, q[None])[0] @ v)
            lower[momentum[at]] = upper[momentum[at]] = p
    if "half_spaces" in motion.rows:
        place = motion.rows["half_spaces"]
        lower[place], upper[place] = lower_half, np.inf
    return lower, upper
