r"""What a motion has cost at least by a time t after it left a pose (or before it reaches it).

Within t of rest, joint j is at most ρ_j(t) away (`reach`). The relaxed running cost is minimised
over the cells of the box that can be reached and over all speeds that can have been reached; its
integral over time is a lower bound of the cost up to t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from dmoc.jit import njit
from dmoc.motion.cost import Cost
from dmoc.robot.robot import Robot
from sequencing.bounds.field import CellGrid, FieldCells
from sequencing.bounds.series import ArmSeries


def reach(robot: Robot, t_s: Array) -> Array:
    """ρ (K, n): ½ a t² until the speed limit, then at the speed limit; `t_s` (K,)."""
    t = np.asarray(t_s)[:, None]
    v, a = robot.velocity_limit_rad_s, robot.acceleration_limit_rad_s2
    return np.where(t <= v / a, 0.5 * a * t * t, v * t - 0.5 * v * v / a)


def shortest_time(robot: Robot, travelled_rad: Array) -> Array:
    """Least time (K,) from rest to rest in which joint j travels `travelled_rad` (K, n) in all.

    The speed |q̇_j| starts and ends at zero, changes by at most a_j a second and stays below v_j: a
    trapezoid covers the most; reversals on the way do not help.
    """
    v, a = robot.velocity_limit_rad_s, robot.acceleration_limit_rad_s2
    way = np.asarray(travelled_rad)
    each = np.where(way <= v * v / a, 2.0 * np.sqrt(way / a), way / v + v / a)
    return np.asarray(each.max(axis=1))


@dataclass(frozen=True)
class Curves:
    """Per node V and time K: `spent` (V, K+1), the integral up to t_k of the least running cost
    (not counting what is left of the quadratic form); `weight` (V, K+1, n), the least diagonal in
    the box of t_k where it may be used, else 0; `floor` the least running cost anywhere."""

    spent: Array
    weight: Array
    floor: float


def leaving_curves(
    robot: Robot,
    cost: Cost,
    series: ArmSeries,
    grid: CellGrid,
    cells: FieldCells,
    q_rad: Array,
    t_s: Array,
) -> Curves:
    """Curves of the nodes `q_rad` (V, n) at times `t_s` (K+1,), starting with 0."""
    bearing = np.array(series.bearing)
    x = np.ascontiguousarray(q_rad[:, bearing])
    offset = robot.gravity_torque_nm(q_rad)[:, bearing] - series.mean_gravity(x)
    radius = reach(robot, t_s)
    speed = np.minimum(robot.velocity_limit_rad_s, t_s[:, None] * robot.acceleration_limit_rad_s2)
    drift = radius @ series.slope.T
    known = (bearing, grid, cells, cost.time, cost.effort)
    rate, weight = _boxes(
        x,
        offset,
        radius[:, bearing],
        drift,
        series.spread,
        speed,
        *known,
    )
    spent = np.zeros_like(rate)
    spent[:, 1:] = np.cumsum(rate[:, 1:] * np.diff(t_s), axis=1)
    # Anywhere, at any time: a box that holds all cells, any angle of the others, full speed.
    everywhere = np.array([2.0 * np.pi * np.ones(2)])
    middle = (grid.points[0] + grid.points[-1])[None] / 2
    least, _ = _boxes(
        middle,
        np.zeros((1, 2)),
        np.vstack([everywhere, everywhere]) * 10,
        np.vstack([series.spread, series.spread]),
        series.spread,
        np.vstack([robot.velocity_limit_rad_s] * 2),
        *known,
    )
    return Curves(spent, weight, float(least[0, 1]))


@njit
def _least_form(a, b, c, u, w):  # type: ignore[no-untyped-def]
    """min of a x² − 2 b |x| |y| + c y² over |x| ≤ u, |y| ≤ w, b ≥ 0; never positive."""
    best = min(0.0, a * u * u - 2.0 * b * u * w + c * w * w)
    y = w if c <= 0.0 else min(w, b * u / c)
    best = min(best, a * u * u - 2.0 * b * u * y + c * y * y)
    x = u if a <= 0.0 else min(u, b * w / a)
    return min(best, a * x * x - 2.0 * b * x * w + c * w * w)


@njit
def _boxes(  # type: ignore[no-untyped-def]
    x, offset, radius, drift, spread, speed, bearing, grid, cells, price_time, price_effort
):
    """rate (V, K+1) and usable diagonal (V, K+1, n) of the box of every node and time."""
    around, lower, step = grid.around, grid.lower, grid.step
    alpha, low, high, diagonal, cross = cells
    nodes, times, n = x.shape[0], radius.shape[0], diagonal.shape[2]
    counts = diagonal.shape[:2]
    first, second = bearing[0], bearing[1]
    rate = np.zeros((nodes, times))
    weight = np.zeros((nodes, times, n))
    span = np.zeros((2, 2), dtype=np.int64)
    dev = np.zeros((2, 2))
    least = np.zeros(n)
    for v in range(nodes):
        for k in range(1, times):
            for m in range(2):
                below = np.floor((x[v, m] - radius[k, m] - lower[m]) / step[m] - 1e-9)
                above = np.ceil((x[v, m] + radius[k, m] - lower[m]) / step[m] + 1e-9)
                if around[m]:
                    span[m, 0] = int(below)
                    span[m, 1] = int(min(above, below + counts[m]))
                else:
                    span[m, 0] = int(min(max(below, 0.0), counts[m] - 1.0))
                    span[m, 1] = int(max(min(above, counts[m] * 1.0), span[m, 0] + 1.0))
                dev[m, 0] = max(-spread[m], offset[v, m] - drift[k, m])
                dev[m, 1] = min(spread[m], offset[v, m] + drift[k, m])
            worst = np.inf
            least[:] = np.inf
            for turn in range(span[0, 0], span[0, 1]):
                i = turn % counts[0]
                for other in range(span[1, 0], span[1, 1]):
                    j = other % counts[1]
                    here = price_time
                    for m in range(2):
                        s, g0, g1 = alpha[m], low[i, j, m], high[i, j, m]
                        square = 0.0
                        if g0 > 0.0:
                            square = g0 * g0
                        elif g1 < 0.0:
                            square = g1 * g1
                        mixed = min(
                            min(g0 * dev[m, 0], g0 * dev[m, 1]),
                            min(g1 * dev[m, 0], g1 * dev[m, 1]),
                        )
                        here += price_effort * (s * (2.0 - s) * square + 2.0 * s * mixed)
                    for p in range(n):
                        d = diagonal[i, j, p]
                        if p != first and p != second and d < 0.0:
                            here += d * speed[k, p] * speed[k, p]
                        least[p] = min(least[p], d)
                    a, c, b = diagonal[i, j, first], diagonal[i, j, second], cross[i, j]
                    here += _least_form(a, b, c, speed[k, first], speed[k, second])
                    if a > 0.0 and c > 0.0:
                        ratio = np.sqrt(a / c)
                        a, c = a - b * ratio, c - b / ratio
                    least[first] = min(least[first], a)
                    least[second] = min(least[second], c)
                    worst = min(worst, here)
            rate[v, k] = worst
            for p in range(n):
                weight[v, k, p] = max(0.0, least[p])
            if least[first] < 0.0 or least[second] < 0.0:
                weight[v, k, first] = weight[v, k, second] = 0.0
    return rate, weight
