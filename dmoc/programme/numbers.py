"""Numbers of one motion for its programme: bounds of variables, bounds of rows, parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.arrays import Array, joint_vector
from dmoc.motion.motion import MotionProblem
from dmoc.physics.state import mass_matrices
from dmoc.programme.builder import MotionProgramme
from dmoc.programme.curve_limits import Margins
from dmoc.programme.types import Box, PathRows

# Capacities are multiples of this, so that few solver objects serve every set of rows.
SLOTS = 8


def without_idle_rows(problem: MotionProblem, box: Box | None, rows: PathRows) -> PathRows:
    """Without the rows that no knots within the bounds can violate: presolve, exact."""
    lower, upper = knot_bounds(problem, box)
    i, share, g = rows.interval, rows.fraction[:, None], rows.gradient
    low = (1 - share) * lower[i] + share * lower[i + 1]
    high = (1 - share) * upper[i] + share * upper[i + 1]
    worst = np.sum(np.minimum(g * low, g * high), axis=1)
    keep = worst < rows.lower
    return PathRows(i[keep], rows.fraction[keep], g[keep], rows.lower[keep])


def capacity_for(rows: PathRows) -> int:
    """The largest number of rows in an interval, rounded up to whole slots."""
    if len(rows.interval) == 0:
        return 0
    return -(-int(np.max(np.bincount(rows.interval))) // SLOTS) * SLOTS


def half_space_params(
    problem: MotionProblem, rows: PathRows | None, capacity: int
) -> tuple[Array, Array]:
    """Coefficients (N, 2 capacity n) and lower bounds (N, capacity); unused slots are free."""
    count, n = problem.num_intervals, problem.robot.num_joints
    coefficients = np.zeros((count, 2, capacity, n))
    lower = np.full((count, capacity), -np.inf)
    if rows is not None and capacity:
        order = np.argsort(rows.interval, kind="stable")
        interval = rows.interval[order]
        slot = np.arange(len(order)) - np.searchsorted(interval, interval)
        share, gradient = rows.fraction[order, None], rows.gradient[order]
        coefficients[interval, 0, slot] = (1 - share) * gradient
        coefficients[interval, 1, slot] = share * gradient
        lower[interval, slot] = rows.lower[order]
    return coefficients.reshape(count, -1), lower


SHORTEST_STEP_S = 1e-4
LONGEST_MOTION_S = 120.0
# Rows of momentum are divided by this time [s] times u_max.
ROW_TIME_S = 0.1


def knot_bounds(problem: MotionProblem, box: Box | None) -> tuple[Array, Array]:
    """Lower and upper bound (N+1, n) [rad] of every knot; fixed knots have both equal."""
    robot, shape = problem.robot, (problem.num_intervals + 1, problem.robot.num_joints)
    lower = np.tile(robot.q_lower_rad, (shape[0], 1))
    upper = np.tile(robot.q_upper_rad, (shape[0], 1))
    if box is not None:
        lower, upper = np.maximum(lower, box.q_lower_rad), np.minimum(upper, box.q_upper_rad)
    free = list(problem.limits.free_goal_joints)
    last = lower[-1].copy(), upper[-1].copy()
    for index, value in fixed_knots(problem):
        lower[index] = upper[index] = value
    lower[-1, free], upper[-1, free] = last[0][free], last[1][free]
    return lower, upper


def variable_bounds(
    problem: MotionProblem, motion: MotionProgramme, box: Box | None, inside: Array
) -> tuple[Array, Array]:
    """Bounds of x, those of the free knots by `inside` (2, N+1, n) [rad] within the ranges."""
    layout, count = motion.layout, problem.num_intervals
    lower, upper = knot_bounds(problem, box)
    robot, free = problem.robot, lower < upper
    # Never past the other bound: a box or a short range keeps what it has.
    lower = np.where(free, np.clip(robot.q_lower_rad + inside[0], lower, upper), lower)
    upper = np.where(free, np.clip(robot.q_upper_rad - inside[1], lower, upper), upper)
    h = step_bounds(problem)
    one = np.ones((count, problem.robot.num_joints))
    goal_velocity = np.asarray(problem.goal_velocity_rad_s)
    v = (goal_velocity, goal_velocity)
    if problem.limits.free_goal_velocity:
        v = (-problem.robot.velocity_limit_rad_s, problem.robot.velocity_limit_rad_s)
    last = slice(None) if layout.end_velocity else slice(0, 0)
    return (
        layout.pack(lower, -one, h[0], v[0][last]),
        layout.pack(upper, one, h[1], v[1][last]),
    )


def step_bounds(problem: MotionProblem) -> tuple[float, float]:
    """Least and most h [s]; equal for a given duration."""
    count = problem.num_intervals
    if problem.duration_s is not None:
        return (problem.duration_s / count,) * 2
    return SHORTEST_STEP_S, LONGEST_MOTION_S / count


def fixed_knots(problem: MotionProblem) -> list[tuple[Any, Array]]:
    """Index and joint vectors of the knots that the problem prescribes."""
    fixed: list[tuple[Any, Array]] = [(0, problem.start_rad), (-1, problem.goal_rad)]
    if problem.depart_rad is not None:
        fixed.append((slice(1, len(problem.depart_rad) + 1), problem.depart_rad))
    if problem.arrive_rad is not None:
        fixed.append((slice(-1 - len(problem.arrive_rad), -1), problem.arrive_rad))
    return fixed


def row_bounds(
    problem: MotionProblem, motion: MotionProgramme, lower_half: Array, margins: Margins
) -> tuple[Array, Array]:
    """Bounds of all rows; the right-hand side of the momentum rows holds the end momenta."""
    size = motion.programme.num_rows
    lower, upper = -np.ones(size), np.ones(size)
    momentum = motion.rows["momentum"]
    lower[momentum] = upper[momentum] = 0.0
    first, last = end_momenta(problem)
    lower[momentum[0]] = upper[momentum[0]] = -first
    if not motion.layout.end_velocity:
        lower[momentum[-1]] = upper[momentum[-1]] = last
    limit_bounds(problem, motion, lower_half, margins, lower, upper)
    return lower, upper


def end_momenta(problem: MotionProblem) -> tuple[Array, Array]:
    """s M(q) q̇ (n,) at start and goal, s the scale of the momentum rows."""
    scale = 1.0 / (ROW_TIME_S * problem.robot.torque_limit_nm)
    ends = (
        (problem.start_rad, problem.start_velocity_rad_s),
        (problem.goal_rad, problem.goal_velocity_rad_s),
    )
    first, last = (
        scale * (mass_matrices(problem.robot, q[None])[0] @ v) if np.any(v) else np.zeros(len(q))
        for q, v in ends
    )
    return first, last


def limit_bounds(
    problem: MotionProblem,
    motion: MotionProgramme,
    lower_half: Array,
    margins: Margins,
    lower: Array,
    upper: Array,
) -> None:
    """Write the bounds of all rows that are limits into `lower` and `upper`."""
    limits = problem.limits
    for name in ("velocity", "acceleration"):
        if name in motion.rows:
            lower[motion.rows[name]], upper[motion.rows[name]] = getattr(margins, name)
    if "half_spaces" in motion.rows:
        place = motion.rows["half_spaces"]
        lower[place], upper[place] = lower_half, np.inf
    if "jerk" in motion.rows:
        lower[motion.rows["jerk"]], upper[motion.rows["jerk"]] = margins.jerk
        if limits.free_goal_velocity:  # what follows is unknown
            place = motion.rows["jerk"][-1]
            lower[place], upper[place] = -np.inf, np.inf
    for i, constraint in enumerate(limits.path):
        place = motion.rows[f"path{i}"]
        lower[place], upper[place] = constraint.lower, constraint.upper
    for i, condition in enumerate(limits.end):
        place = motion.rows[f"end{i}"]
        lower[place], upper[place] = condition.lower, condition.upper


def parameters(
    problem: MotionProblem, motion: MotionProgramme, half_spaces: Array, margins: Margins
) -> Array:
    """The parameter vector of the programme."""
    robot, limits = problem.robot, problem.limits
    n, u_max = robot.num_joints, robot.torque_limit_nm
    one = np.ones(n)
    values = {
        "scale": 1.0 / (ROW_TIME_S * u_max),
        "u_max": u_max,
        "weights": problem.cost.weights(n),
        "smoothing": problem.cost.smoothing,
        "v_max": robot.velocity_limit_rad_s,
        "a_max": robot.acceleration_limit_rad_s2,
        "v_start": problem.start_velocity_rad_s,
        "v_goal": problem.goal_velocity_rad_s,
        "half_spaces": half_spaces,
        "wrench": problem.wrench,
    }
    if margins.mobility is not None:
        weights = margins.mobility * u_max  # columns belong to torques, rows to joints
        by_acceleration = weights / (2 * robot.acceleration_limit_rad_s2[:, None])
        by_velocity = weights / (4 * robot.velocity_limit_rad_s[:, None])
        shares = {"acceleration": by_acceleration, "velocity": by_velocity}
        if problem.jerk_limit_rad_s3 is not None:
            shares["jerk"] = weights / problem.jerk_limit_rad_s3[:, None]
        for name, value in shares.items():
            columns = value.transpose(0, 2, 1)
            values[f"{name}_weights"] = columns.reshape(len(columns), n * n)
    if problem.jerk_limit_rad_s3 is not None:
        values["j_max"] = problem.jerk_limit_rad_s3
    if limits.rms_torque_nm is not None:
        rms = joint_vector(limits.rms_torque_nm, "limits.rms_torque_nm", n)
        values["rms_share"] = u_max / (rms * np.sqrt(problem.num_intervals))
    if limits.torque_speed is not None:
        values["stall_share"] = u_max / (one * np.asarray(limits.torque_speed.stall_torque_nm))
        values["no_load"] = one * np.asarray(limits.torque_speed.no_load_speed_rad_s)
    return motion.pack(**values)
