r"""The lower bound of a travel: what leaving, reaching and the way between cost at least.

For a duration T, with both halves bounded by the leaving curves C of the two poses and the
quadratic form of the speeds by Cauchy–Schwarz,

.. math:: J \ge C_i(T/2) + C_j(T/2) + \sum_m d_m(T) \ell_m^2 / T ,

ℓ_m the way that joint m travels through the waypoints. It holds for every reference torque, so the
best of several is taken for each interval of T; the least over all T that the speed and
acceleration limits allow is the bound. The speed bound of `estimates` is kept where it is higher.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.jit import njit
from dmoc.motion.cost import Cost
from dmoc.robot.robot import Robot
from sequencing.bounds.curves import leaving_curves, shortest_time
from sequencing.bounds.field import cell_grid, field_cells, lie_terms
from sequencing.bounds.series import arm_series

# Scales of the reference torque on the two bearing joints, and whether the other joints' share of
# the quadratic form is spent on relieving these two. Small ones hold for long motions.
SCALES = (
    (1.0, 1.0, True),
    (1.0, 0.5, True),
    (0.75, 0.5, True),
    (0.75, 0.25, True),
    (0.5, 0.5, True),
    (0.5, 0.25, True),
    (0.35, 0.2, True),
    (0.35, 0.2, False),
    (0.25, 0.1, True),
    (0.25, 0.1, False),
    (0.23, 0.05, True),
    (0.2, 0.1, True),
    (0.15, 0.08, False),
    (0.1, 0.05, False),
    (0.05, 0.03, False),
)
HALF_TIMES_S = np.concatenate([np.arange(0.0, 1.0, 0.04), np.linspace(1.0, 3.0, 11)])


@dataclass(frozen=True)
class TravelBound:
    """Bounds of travels between the nodes it was made for: `Curves` of every reference torque c.

    `spent` (V, K+1, C), `weight` (V, K+1, C, n), `floor` (C,).
    """

    robot: Robot
    cost: Cost
    half_times_s: Array
    spent: Array
    weight: Array
    floor: Array

    def __call__(self, pairs: npt.NDArray[np.int64], waypoints: Array) -> Array:
        """Lower bounds (K,) of J for node pairs (K, 2) through `waypoints` (K, W, n)."""
        way = np.abs(np.diff(waypoints, axis=1)).sum(axis=1)
        shortest = shortest_time(self.robot, way)
        times = 2.0 * self.half_times_s
        result = np.empty(len(pairs))
        _least_of_pairs(pairs, way * way, shortest, times, self.spent, self.weight, result)
        i, j = pairs[:, 0], pairs[:, 1]
        return np.minimum(result, self._beyond(i, j, np.maximum(shortest, times[-1])))

    def _beyond(self, i: npt.NDArray[np.int64], j: npt.NDArray[np.int64], shortest: Array) -> Array:
        """For all T past the last time: only fields whose running cost is nowhere negative."""
        best = np.zeros(len(i))
        for c in np.flatnonzero(self.floor >= 0.0):
            rest = self.floor[c] * (shortest - 2.0 * self.half_times_s[-1])
            best = np.maximum(best, self.spent[i, -1, c] + self.spent[j, -1, c] + rest)
        return best


def power_bound(robot: Robot, cost: Cost, waypoints: Array) -> Array:
    r"""Lower bound (K,) from speeds, accelerations and the power balance, proven.

    Through `waypoints` (K, W, n) with polygon length ℓ, the ends differing in potential energy by
    D = |ΔV|, without friction and at rest at both ends: A = ∫‖q̇‖² dt ≥ ℓ²/T and ∫‖u‖² dt ≥ D²/A,
    both by Cauchy–Schwarz, and T ≥ T_min by the trapezoid of every joint:

    .. math:: J \ge \min_{T \ge T_{min},\; A \ge \ell^2/T} c_t T + c_v A + c_e D^2 / A .
    """
    steps = np.diff(waypoints, axis=1)
    length = np.linalg.norm(steps, axis=2).sum(axis=1)
    least = shortest_time(robot, np.abs(steps).sum(axis=1))
    # Between the ends only: at the other waypoints the arm has kinetic energy.
    energy = _potential(robot, waypoints[:, [0, -1]])
    change = np.abs(energy[:, 1] - energy[:, 0])
    root = np.sqrt(cost.effort) * change
    if cost.velocity == 0:
        return cost.time * least
    liked = root / np.sqrt(cost.velocity)  # the A that the energy alone would like
    if cost.time == 0:
        return cost.velocity * liked + root * np.sqrt(cost.velocity)
    with np.errstate(divide="ignore", invalid="ignore"):
        slow = np.where(liked > 0, length**2 / liked, np.inf)  # from this T on it can be had
        # Before, A = ℓ²/T binds, and c_t T + c_v ℓ²/T + (root/ℓ)² T is least at `turning`.
        price = cost.time + np.where(length > 0, (root / length) ** 2, 0.0)
        turning = length * np.sqrt(cost.velocity / price)
        bound = np.full(len(length), np.inf)
        for t in (np.maximum(least, np.minimum(turning, slow)), np.maximum(least, slow)):
            area = np.maximum(length**2 / t, liked)
            value = cost.time * t + cost.velocity * area
            value = value + np.where(area > 0, root**2 / area, 0.0)
            bound = np.where(np.isfinite(t) & (t > 0), np.minimum(bound, value), bound)
    return np.where(np.isfinite(bound), bound, 0.0)


def _potential(robot: Robot, waypoints: Array) -> Array:
    """V (K, W) [J] of the waypoints."""
    data = robot.model.createData()
    flat = waypoints.reshape(-1, waypoints.shape[-1])
    unique, back = np.unique(flat, axis=0, return_inverse=True)
    energy = np.array([pin.computePotentialEnergy(robot.model, data, q) for q in unique])
    return energy[back.ravel()].reshape(waypoints.shape[:2])


@njit
def _least_of_pairs(pairs, square, shortest, times, spent, weight, result):  # type: ignore[no-untyped-def]
    """Per pair the least over the intervals of T of the best over all reference torques.

    On an interval it is min over begin ≤ T ≤ end of start + rate·T + inertia/T; one that cannot
    be the least any more is left early. Sums run in one order on every machine.
    """
    for row in range(pairs.shape[0]):
        i, j = pairs[row, 0], pairs[row, 1]
        least = np.inf
        for k in range(1, times.shape[0]):
            end = times[k]
            if shortest[row] > end:
                continue
            begin = times[k - 1] if times[k - 1] > shortest[row] else shortest[row]
            best = -np.inf
            for c in range(spent.shape[2]):
                before = spent[i, k - 1, c] + spent[j, k - 1, c]
                rate = (spent[i, k, c] + spent[j, k, c] - before) / (end - times[k - 1])
                inertia = 0.0
                for m in range(square.shape[1]):
                    one, other = weight[i, k, c, m], weight[j, k, c, m]
                    inertia += (one if one < other else other) * square[row, m]
                at = np.sqrt(inertia / rate) if rate > 0.0 else end
                at = begin if at < begin else (end if at > end else at)
                value = before - rate * times[k - 1] + rate * at
                if inertia > 0.0:
                    value += inertia / at
                if value > best:
                    best = value
                    if best >= least:
                        break
            if best < least:
                least = best
        result[row] = least


def travel_bound(robot: Robot, cost: Cost, q_rad: Array) -> TravelBound | None:
    """Prepare the bound for the nodes `q_rad` (V, n); None where the theory does not apply.

    It needs two joints that turn, as all do, no matrices in the cost, and a price on effort.
    """
    plain = cost.state_matrix is None and cost.torque_matrix is None
    if robot.num_joints < 2 or robot.slides.any() or not plain or cost.effort == 0:
        return None
    series = arm_series(robot)
    grid = cell_grid(robot, series.bearing)
    terms = lie_terms(series, grid)
    curves = []
    for first, second, spend in SCALES:
        cells = field_cells(terms, cost, (first, second), series.bearing, spend)
        curves.append(leaving_curves(robot, cost, series, grid, cells, q_rad, HALF_TIMES_S))
    return TravelBound(
        robot,
        cost,
        HALF_TIMES_S,
        np.stack([curve.spent for curve in curves], axis=2),
        np.stack([curve.weight for curve in curves], axis=2),
        np.array([curve.floor for curve in curves]),
    )
