"""Poses that a plan can do without: by which rule they go, and what that may cost.

Turning a joint by 360° gives the same arm again, and a free spin of the tool many arms: some robots
have thousands of poses a stud. Where a station has more than `MOST_POSES`,

1. *turns*: of poses equal but for full turns those go that are more than 180° + `SEAM_RAD` from
   home (without one: from the middle of the limits) in a joint, unless all are;
2. *rank*: in every stud the dearest go until its share of `MOST_POSES` is left, judged by holding
   plus half of the two cheapest travels to two other studs, full turns not counted.

Travels are priced as straight lines without inertia: time under the limits at the mean holding rate
of both ends, and the price of speed. The least that any cycle through any pose costs by that price
(a relaxation, full turns for nothing) against the best cycle through the poses kept says what
pruning may cost at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from planning.station.station import Station
from planning.welds.poses import MOST_POSES, StudAlternatives
from sequencing.bounds.curves import shortest_time
from sequencing.cycle_types import Pruning
from sequencing.edges.nodes import StationNodes, station_nodes
from sequencing.gtsp.portfolio import solve
from sequencing.gtsp.stop import Stop

#: Poses that a stud keeps at least.
FEWEST = 12
#: How far beyond half a turn from home a joint may stand [rad].
SEAM_RAD = 0.6
TURN = 2.0 * np.pi
#: Numbers in one block of prices, and iterations a stud of a cycle that prices pruning.
_BLOCK, QUICK = 2_000_000, 400


def pruned(
    station: Station, found: Sequence[StudAlternatives], price: bool = True
) -> tuple[tuple[StudAlternatives, ...], Pruning | None]:
    """The poses that are worth planning with, and how they were chosen; None where all are.

    What it may cost takes some seconds and is left out (None) without `price`.
    """
    total = sum(len(item.alternatives) for item in found)
    if total <= MOST_POSES:
        return tuple(found), None
    nodes = station_nodes(station, found)
    first, near = _turns(station, nodes)
    share = max(FEWEST, MOST_POSES // len(nodes.studs))
    rows = np.flatnonzero(first == np.arange(len(first)))  # one of every arm, home too
    score = _scores(station, nodes, rows)
    kept = np.zeros(nodes.num_nodes, dtype=bool)
    left = np.full(int(nodes.cluster_of.max()) + 1, share)
    for row in rows[np.argsort(score, kind="stable")]:
        cluster = nodes.cluster_of[row]
        if left[cluster] > 0:
            same = np.flatnonzero(near & (first == row))
            kept[same] = True
            left[cluster] -= len(same)
    least = np.minimum.reduceat(score, np.flatnonzero(np.diff(nodes.cluster_of[rows], prepend=-1)))
    out = ~kept[rows]
    through = score[out] + least.sum() - least[nodes.cluster_of[rows[out]]]
    chosen = {(nodes.stud[v], int(nodes.alternative[v])) for v in np.flatnonzero(kept)}
    result = tuple(
        replace(
            item,
            alternatives=tuple(a for a in item.alternatives if (a.stud_id, a.index) in chosen),
        )
        for item in found
    )
    loss = None
    if price:
        loss = _loss(station, station_nodes(station, result), through.min(initial=np.inf))
    number = int(kept.sum()) - (nodes.home is not None)
    return result, Pruning(total, number, int((~near).sum()), loss)


def _loss(station: Station, nodes: StationNodes, through: float) -> float | None:
    """Percent of the best cycle's price by which one through any pose may be cheaper; those through
    the poses that went by rank cost `through` at least."""
    problem = nodes.problem(_prices(station, nodes.q_rad, nodes.q_rad), station)
    few = Stop(iterations=QUICK * problem.num_clusters, states=0)
    best = solve(problem, few)
    free = problem.replace(cost=_prices(station, nodes.q_rad, nodes.q_rad, _turning(station)))
    floor = min(through, solve(free, few, method="exact", initial=[best]).lower_bound)
    return 100.0 * max(0.0, 1.0 - floor / best.cost) if best.found else None


def _turning(station: Station) -> Array:
    """Joints (n,) that have room for a full turn."""
    robot = station.robot
    return np.asarray(robot.q_upper_rad - robot.q_lower_rad >= TURN - 1e-9)


def _turns(
    station: Station, nodes: StationNodes
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Number of the first node (V,) that is the same arm, and whether a node is near home."""
    robot, turning = station.robot, _turning(station)
    middle = 0.5 * (robot.q_lower_rad + robot.q_upper_rad)
    middle = middle if station.home_rad is None else np.asarray(station.home_rad)
    q = np.where(turning, nodes.q_rad % TURN, nodes.q_rad)
    keys = np.column_stack([nodes.cluster_of, np.cos(q), np.sin(q), np.where(turning, 0.0, q)])
    _, first, which = np.unique(keys.round(5) + 0.0, axis=0, return_index=True, return_inverse=True)
    first = first[which.ravel()]
    far = np.where(turning, np.abs(nodes.q_rad - middle), 0.0).max(axis=1)
    least = np.full(nodes.num_nodes, np.inf)
    np.minimum.at(least, first, far)
    return first, far <= np.maximum(np.pi + SEAM_RAD, least[first])


def _scores(station: Station, nodes: StationNodes, rows: npt.NDArray[np.int64]) -> Array:
    """Holding and half of the two cheapest travels to two other studs (C,), full turns free."""
    q, cluster = nodes.q_rad[rows], nodes.cluster_of[rows]
    begin = np.flatnonzero(np.diff(cluster, prepend=-1))
    turning, score = _turning(station), nodes.weld_cost[rows].copy()
    step = max(1, _BLOCK // (len(rows) * q.shape[1]))
    for at in range(0, len(rows), step):
        part = slice(at, at + step)
        least = np.minimum.reduceat(_prices(station, q[part], q, turning), begin, axis=1)
        least[np.arange(len(least)), cluster[part]] = np.inf
        least = np.sort(least, axis=1)
        if len(begin) > 1:
            score[part] += 0.5 * (least[:, 0] + least[:, 1 if len(begin) > 2 else 0])
    return score


def _prices(station: Station, start: Array, goal: Array, turning: Array | None = None) -> Array:
    """Price (K, L) of travels from rows of `start` to rows of `goal`; turns of joints for free."""
    robot, cost = station.robot, station.cost
    way = np.abs(start[:, None, :] - goal[None, :, :])
    if turning is not None:
        way = np.where(turning, np.abs((way + np.pi) % TURN - np.pi), way)
    size = way.shape[:2]
    flat = way.reshape(-1, way.shape[2])
    time = np.maximum(shortest_time(robot, flat), 1e-3).reshape(size)
    rates = [cost.holding_rate(robot.gravity_torque_nm(q)) for q in (start, goal)]
    price = time * 0.5 * (rates[0][:, None] + rates[1][None, :])
    return np.asarray(price + cost.velocity * (way * way).sum(axis=2) / time)
