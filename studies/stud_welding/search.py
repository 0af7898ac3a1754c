"""Sequences of a model, found with few solved edges.

Estimates come from the nominal station: what an edge was estimated to cost there, times the ratio
of the straight lines' costs here and there, times the median of what solved edges cost against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from sequencing import gtsp
from sequencing.cycle.lazy import LazyStop, solve_lazily
from sequencing.cycle_types import CycleCost
from sequencing.gtsp.stop import Stop
from studies.stud_welding.model import Model, travels

MAX_REPAIRS = 30
#: Enough to close the gap on small stations; on large ones the gap stays conditional on less.
EXACT_STATES = 20_000


@dataclass(frozen=True)
class Found:
    """A cycle with its cost, and how far (on which condition) it may be from the best."""

    nodes: tuple[int, ...]
    cost: CycleCost
    conditional_gap_percent: float | None
    conditional_factor: float
    edges: int


class TableOracle:
    """`CostOracle` of a model whose estimates are a table (V, V)."""

    def __init__(self, model: Model, table: Array) -> None:
        self.model, self.table = model, table

    def bound(self, pairs: np.ndarray) -> Array:
        """Zeros: nothing is claimed to be proven about a changed assumption."""
        return np.zeros(len(pairs))

    def estimate(self, pairs: np.ndarray) -> Array:
        """Entries of the table."""
        return np.asarray(self.table[pairs[:, 0], pairs[:, 1]])

    def evaluate(self, pairs: np.ndarray) -> Array:
        """Solved costs at screening quality."""
        return self.model.edges.evaluate(pairs)


def best_sequence(
    model: Model,
    table: Array,
    given: Sequence[tuple[int, ...]],
    limit: int,
    gap: float = 0.02,
    only: Sequence[int] | None = None,
) -> Found | None:
    """The best cycle found with at most `limit` solved edges beyond those of the `given` cycles.

    `only` restricts it to some nodes. Never dearer than the given ones; None if there is none.
    """
    nodes, edges = model.nodes, model.edges
    costed = [(model.cost_of(cycle), cycle) for cycle in given]
    factor, table = _calibrated(model, table)
    prices = nodes.weld_cost
    if only is not None:
        prices = np.full(nodes.num_nodes, np.inf)
        prices[list(only)] = nodes.weld_cost[list(only)]
    problem = nodes.problem(np.zeros(table.shape), model.station, node_cost=prices)
    result = solve_lazily(
        problem,
        TableOracle(model, table),
        LazyStop(gap, "conditional", limit),
        edges.seed,
        known=dict(edges.costs),
        strict=False,
        symmetric=edges.symmetric,
        factor=factor,
        tours=2,
        exact=Stop(states=EXACT_STATES),
        bound_each_round=False,
    )
    if result.tour.found:
        cycle = from_home(result.tour.nodes, nodes.home)
        costed.append((model.cost_of(cycle), cycle))
    good = [(cost, cycle) for cost, cycle in costed if cost is not None]
    if not good:
        return None
    cost, cycle = min(good, key=lambda item: (item[0].total, item[1]))
    low = result.conditional_bound
    missing = 100.0 * max(0.0, 1.0 - low / cost.total) if np.isfinite(low) else None
    return Found(cycle, cost, missing, factor, len(edges.costs))


def _calibrated(model: Model, table: Array) -> tuple[float, Array]:
    """The 5 % quantile of true / estimate around its median, and the table times that median."""
    ratios = [
        cost / table[pair]
        for pair, cost in model.edges.costs.items()
        if np.isfinite(cost) and np.isfinite(table[pair])
    ]
    if len(ratios) < 6:
        return 0.9, table
    middle = float(np.median(ratios))
    return min(1.0, float(np.quantile(ratios, 0.05)) / middle), table * middle


def sequence_by(
    model: Model, table: Array, node_cost: Array | None = None
) -> tuple[int, ...] | None:
    """The cycle of least estimated cost whose travels all have motions (repaired until they do)."""
    costs = _without_failed(model, table)
    for _ in range(MAX_REPAIRS):
        problem = model.nodes.problem(costs, model.station, node_cost=node_cost)
        tour = gtsp.solve(problem, seed=model.edges.seed)
        if not tour.found:
            return None
        if model.cost_of(tour.nodes) is not None:
            return from_home(tour.nodes, model.nodes.home)
        costs = _without_failed(model, costs)
    return None


def best_poses(
    model: Model, table: Array, order: Sequence[int], true_costs: bool = True
) -> tuple[int, ...] | None:
    """The poses of least cost for a given order of clusters, by dynamic programming.

    With `true_costs` solved travels replace their entries in `table` until the best way through
    the poses holds nothing else; without, the table decides and failed travels are taken out.
    """
    if true_costs:
        table = _calibrated(model, table)[1]
    costs = _without_failed(model, table)
    solved: set[tuple[int, int]] = set()
    for _ in range(10 * MAX_REPAIRS):
        if true_costs:
            for (i, j), value in model.edges.costs.items():
                costs[i, j] = costs[j, i] = value
        cycle = _through(model, costs, order)
        if cycle is None:
            return None
        pairs = travels(cycle)
        new = {(min(i, j), max(i, j)) for i, j in pairs.tolist()} - solved
        cost = model.cost_of(cycle)
        solved |= new
        if cost is None:
            costs = _without_failed(model, costs)
        elif not true_costs or not new:
            return cycle
    return None


def _through(model: Model, costs: Array, order: Sequence[int]) -> tuple[int, ...] | None:
    """Best cycle through the layers of `order`; the first layer is tried node by node."""
    nodes = model.nodes
    layers = [np.flatnonzero(nodes.cluster_of == cluster) for cluster in order]
    best, found = np.inf, None
    for first in layers[0]:
        value = np.array([nodes.weld_cost[first]])
        back, here = [], np.array([first])
        for layer in layers[1:]:
            steps = value[:, None] + costs[np.ix_(here, layer)]
            back.append(np.argmin(steps, axis=0))
            value = steps.min(axis=0) + nodes.weld_cost[layer]
            here = layer
        value = value + costs[here, first]
        last = int(np.argmin(value))
        if value[last] < best:
            best, cycle = float(value[last]), [last]
            for step in reversed(back):
                cycle.append(int(step[cycle[-1]]))
            places = cycle[::-1]
            found = (int(first), *(int(layer[k]) for layer, k in zip(layers[1:], places[1:])))
    return found


def _without_failed(model: Model, table: Array) -> Array:
    costs = table.copy()
    for (i, j), value in model.edges.costs.items():
        if not np.isfinite(value):
            costs[i, j] = costs[j, i] = np.inf
    return costs


def from_home(nodes: tuple[int, ...], home: int | None) -> tuple[int, ...]:
    """The cycle rotated to begin at home."""
    if home is None or home not in nodes:
        return tuple(int(v) for v in nodes)
    at = nodes.index(home)
    return tuple(int(v) for v in (*nodes[at:], *nodes[:at]))
