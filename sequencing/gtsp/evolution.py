"""Memetic search (Gutin and Karapetyan 2010): population, order crossover, improvement.

Every offspring inherits a part of one parent and the order of the rest from the other, gets the
best nodes for its order, sometimes a double bridge, and is improved by a short annealed
ruin-and-recreate, which measured better on the same CPU time than the local search of the paper's
reference 12 (docs/gtsp.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sequencing.gtsp.arrays import Arrays, stream
from sequencing.gtsp.normalise import NormalForm
from sequencing.gtsp.ruin_recreate_kernel import anneal, insert_cheapest


def random_order(form: NormalForm, generator: np.random.Generator) -> np.ndarray:
    """A random order of the clusters that keeps the precedences; the depot first."""
    if not form.ordered:
        rest = generator.permutation(np.arange(1 if form.pinned else 0, form.num_clusters))
        return np.concatenate([[0], rest]) if form.pinned else rest
    waiting = form.before.sum(axis=0)
    out: list[int] = []
    left = set(range(form.num_clusters))
    while left:
        ready = [g for g in sorted(left) if waiting[g] == 0]
        g = 0 if form.pinned and not out else int(generator.choice(ready))
        out.append(g)
        left.remove(g)
        waiting = waiting - form.before[g]
    return np.array(out, dtype=np.int64)


def insertion_tour(arrays: Arrays, generator: np.random.Generator, state: np.ndarray) -> np.ndarray:
    """A tour (M,) of nodes: clusters in random order, each at its cheapest place and node."""
    form = arrays.form
    m = form.num_clusters
    sequence = random_order(form, generator)
    order = np.empty(m, dtype=np.int64)
    node = np.empty(m, dtype=np.int64)
    edge = np.zeros(m)
    order[0] = sequence[0]
    node[0] = generator.integers(form.ptr[sequence[0]], form.ptr[sequence[0] + 1])
    for size, g in enumerate(sequence[1:], start=1):
        insert_cheapest(arrays.tables, 0.0, state, order, node, edge, size, g)
    return node


HOT = 0.5  # first temperature, in typical edges
COLD = 0.01
LARGEST_RUIN = 15
BLINK = 0.01
SLICE = 20_000


def ruin_recreate(
    arrays: Arrays,
    iterations: int,
    generator: np.random.Generator,
    start: np.ndarray | None = None,
    goal: float = -math.inf,
    hot: float = HOT,
    report: Callable[[int, np.ndarray, float], None] | None = None,
) -> tuple[np.ndarray, float]:
    """Best nodes (M,) and their cost after `iterations`; `report(done, nodes, cost)` each slice."""
    state = stream(generator)
    current = insertion_tour(arrays, generator, state) if start is None else start.copy()
    best = current.copy()
    cost = math.inf
    for begin in range(0, max(iterations, 1), SLICE):
        end = min(begin + SLICE, iterations)
        span = (begin, end, max(iterations, 1))
        heat = (hot * arrays.scale, COLD * arrays.scale)
        cost, done = anneal(
            arrays.tables, current, best, span, heat, LARGEST_RUIN, BLINK, goal, state
        )
        if report is not None:
            report(done, best, cost)
        if cost <= goal:
            break
    return best, float(cost)


MUTATION = 0.3
Report = Callable[[int, np.ndarray, float], None]


def order_crossover(
    one: np.ndarray,
    two: np.ndarray,
    cluster: np.ndarray,
    ordered: bool,
    pinned: bool,
    generator: np.random.Generator,
) -> np.ndarray:
    """Nodes (M,) of a child: a stretch of `one`, the other clusters in the order of `two`.

    With precedences the stretch begins at the first cluster; then the child keeps them.
    """
    m = len(one)
    if ordered or pinned:
        begin = 0 if ordered else int(generator.integers(0, m))
        length = int(generator.integers(1, m))
        part = one[begin : begin + length]
    else:
        part = np.roll(one, -int(generator.integers(m)))[: int(generator.integers(1, m))]
        two = np.roll(two, -int(generator.integers(m)))
    taken = np.zeros(m, dtype=bool)
    taken[cluster[part]] = True
    rest = two[~taken[cluster[two]]]
    if ordered or not pinned:
        return np.concatenate([part, rest])
    split = int(generator.integers(0, len(rest) + 1))
    child = np.concatenate([rest[:split], part, rest[split:]])
    at = int(np.flatnonzero(cluster[child] == 0)[0])
    return np.roll(child, -at)


def double_bridge(nodes: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Exchange two neighbouring stretches; the first position stays."""
    m = len(nodes)
    if m < 5:
        return nodes
    a, b, c = np.sort(generator.choice(np.arange(1, m), 3, replace=False))
    return np.concatenate([nodes[:a], nodes[b:c], nodes[a:b], nodes[c:]])


def memetic(
    arrays: Arrays,
    budget: int,
    population: int,
    generator: np.random.Generator,
    child_iterations: int,
    starts: list[np.ndarray],
    goal: float,
    report: Report,
) -> list[tuple[float, np.ndarray]]:
    """The final population, best first, as (cost, nodes).

    budget: iterations of ruin and recreate in all; a third of it builds the first population.
    starts: tours that are members of it. goal: stop at this cost.
    """
    state = stream(generator)
    form = arrays.form

    def polish(nodes: np.ndarray, iterations: int, hot: float) -> tuple[float, np.ndarray]:
        found, cost = ruin_recreate(arrays, iterations, generator, nodes, goal, hot)
        report(iterations, found, cost)
        return cost, found

    first = max(1, budget // (3 * population))
    members: list[tuple[float, np.ndarray]] = []
    spent = 0
    for k in range(population):
        seeded = k < len(starts)
        nodes = starts[k] if seeded else insertion_tour(arrays, generator, state)
        members.append(polish(nodes, first, 0.3 if seeded else 1.0))
        spent += first
        if members[-1][0] <= goal:
            break
    members.sort(key=lambda member: member[0])
    while spent + child_iterations <= budget and members[0][0] > goal and len(members) > 1:
        i, j = (int(generator.integers(len(members))) for _ in range(2))
        one, two = min(i, j), int(generator.integers(len(members)))
        if one == two:
            two = (one + 1) % len(members)
        child = order_crossover(
            members[one][1], members[two][1], form.cluster, form.ordered, form.pinned, generator
        )
        if not form.ordered and generator.random() < MUTATION:
            child = double_bridge(child, generator)
        _insert(members, polish(child, child_iterations, 0.3), population)
        spent += child_iterations
    return members


def _insert(
    members: list[tuple[float, np.ndarray]], child: tuple[float, np.ndarray], population: int
) -> None:
    """Keep the best, each cost once (equal cost is taken for the same tour)."""
    near = 1e-9 * max(1.0, abs(child[0]))
    if any(abs(child[0] - cost) <= near for cost, _ in members):
        return
    members.append(child)
    members.sort(key=lambda member: member[0])
    del members[population:]
