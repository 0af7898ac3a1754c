"""The old way to sequence: least approximate travel time, blind to effort and holding torque.

Such sequences tie massively (many poses differ only in joints that are not the slowest), and tied
ones differ a lot in cost: so several are drawn and the distribution is reported, not one draw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from planning.station.station import Station
from sequencing import gtsp
from sequencing.cycle_types import CycleCost
from sequencing.edges.estimates import least_time, travel_time
from sequencing.edges.nodes import StationNodes
from sequencing.edges.oracle import StationEdges

# Perturbation that chooses among tied sequences; far below any difference that matters.
TIE_BREAK = 1e-7
TIE_TOLERANCE = 1e-5
MAX_REPAIRS = 20


@dataclass(frozen=True)
class TimedSequence:
    """A sequence of least travel time: its nodes, that time [s], its cost at screening quality."""

    nodes: tuple[int, ...]
    time_s: float
    cost: CycleCost


def time_costs(station: Station, nodes: StationNodes, accelerating: bool = False) -> Array:
    """Approximate travel times (V, V) [s] between all nodes: the paper's max |Δq| / v, or
    `accelerating` what speed and acceleration limits leave."""
    q = nodes.q_rad
    time = least_time if accelerating else travel_time
    return time(station.robot, q[:, None, :], q[None, :, :])


def undirected(nodes: tuple[int, ...]) -> tuple[int, ...]:
    """The same for a cycle wherever it begins and whichever way it goes: both ways cost the same
    time and the same J."""
    first = nodes.index(min(nodes))
    there = nodes[first:] + nodes[:first]
    return min(there, (there[0], *reversed(there[1:])))


def middle_place(count: int) -> int:
    """Place of the median of `count` sorted costs; of an even number the cheaper of the middle two,
    so that the old method never looks worse than it is."""
    return max(0, count - 1) // 2


def time_based_sequences(
    oracle: StationEdges, count: int, seed: int, accelerating: bool = False
) -> tuple[TimedSequence, ...]:
    """Different ones of `count` drawn sequences of (tied) least travel time, costed with solved
    motions, cheapest first.

    Travels that turn out to have no motion are forbidden and the sequence is found again, as a
    planner-in-the-loop sequencer does. Sequences that are not tied with the fastest are dropped.
    """
    station, nodes = oracle.station, oracle.nodes
    times = time_costs(station, nodes, accelerating)
    found: dict[tuple[int, ...], TimedSequence] = {}
    for draw in range(count):
        rng = np.random.default_rng([seed, draw])
        noise = 1.0 + TIE_BREAK * rng.random(times.shape)
        sequence = _sequence(oracle, times, times * np.maximum(noise, noise.T), seed + draw)
        if sequence is not None:
            found.setdefault(undirected(sequence.nodes), sequence)
    if not found:
        return ()
    fastest = min(sequence.time_s for sequence in found.values())
    tied = [s for s in found.values() if s.time_s <= fastest * (1.0 + TIE_TOLERANCE)]
    return tuple(sorted(tied, key=lambda s: (s.cost.total, s.nodes)))


def _sequence(
    oracle: StationEdges, times: Array, perturbed: Array, seed: int
) -> TimedSequence | None:
    nodes = oracle.nodes
    costs = perturbed.copy()
    for (i, j), value in oracle.costs.items():
        if not np.isfinite(value):
            costs[i, j] = costs[j, i] = np.inf
    for _ in range(MAX_REPAIRS):
        problem = nodes.problem(costs, oracle.station, node_cost=np.zeros(nodes.num_nodes))
        tour = gtsp.solve(problem, seed=seed)
        if not tour.found:
            return None
        pairs = problem.edges(tour.nodes)
        travel = oracle.evaluate(pairs)
        if np.all(np.isfinite(travel)):
            welding = float(np.sum(nodes.weld_cost[list(tour.nodes)]))
            time = float(np.sum(times[pairs[:, 0], pairs[:, 1]]))
            return TimedSequence(tour.nodes, time, CycleCost(float(np.sum(travel)), welding))
        for i, j in pairs[~np.isfinite(travel)]:
            costs[i, j] = costs[j, i] = np.inf
    return None
