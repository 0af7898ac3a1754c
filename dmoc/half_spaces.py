"""Half-spaces of a path as parameters of a programme: a fixed number of slots per interval."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.bounds import knot_bounds
from dmoc.motion import MotionProblem
from dmoc.nlp_types import Box, PathRows

__all__ = ["capacity_for", "half_space_params", "without_idle_rows"]

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
