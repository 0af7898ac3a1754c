"""Slow oracles for the sequencer: every tour of a small problem, one after the other."""

from __future__ import annotations

import itertools
import math

import numpy as np

from sequencing.gtsp import GtspProblem


def all_tours(problem: GtspProblem):
    """Every admissible sequence of nodes, without any cleverness."""
    clusters = problem.clusters
    for order in itertools.permutations(range(problem.num_clusters)):
        for nodes in itertools.product(*(clusters[g] for g in order)):
            if not admissible(problem, order, nodes):
                continue
            yield nodes


def admissible(problem: GtspProblem, order, nodes) -> bool:
    place = {g: k for k, g in enumerate(order)}
    if problem.home is not None and nodes[0] != problem.home:
        return False
    if problem.start is not None and nodes[0] != problem.start:
        return False
    if problem.end is not None and nodes[-1] != problem.end:
        return False
    return all(place[a] < place[b] for a, b in problem.precedence)


def cost_of(problem: GtspProblem, nodes) -> float:
    total = 0.0
    for v in nodes:
        total += problem.node_cost[v]
    for u, v in itertools.pairwise(nodes):
        total += problem.cost[problem.exit_of[u], v]
    if not problem.path:
        u, v = nodes[-1], nodes[0]
        if len(nodes) > 1 or problem.exit_of[u] != v:
            total += problem.cost[problem.exit_of[u], v]
    return float(total)


def brute_force(problem: GtspProblem) -> float:
    """Cost of the best tour, inf if there is none."""
    return min((cost_of(problem, nodes) for nodes in all_tours(problem)), default=math.inf)


def random_problem(seed: int, clusters: int = 5, largest: int = 3) -> GtspProblem:
    """A random small problem with a random choice of every option."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, clusters + 1))
    sizes = rng.integers(1, largest + 1, size=m)
    labels = np.repeat(np.arange(m), sizes)
    rng.shuffle(labels)
    n = len(labels)
    cost = rng.integers(0, 30, size=(n, n)).astype(float)
    if rng.random() < 0.5:
        cost = cost + rng.random((n, n))
    if rng.random() < 0.3:
        cost -= 12.0
    if rng.random() < 0.4:
        cost = np.triu(cost, 1) + np.triu(cost, 1).T
    if rng.random() < 0.4:
        cost[rng.random((n, n)) < rng.choice([0.1, 0.3, 0.6])] = np.inf
    node_cost = rng.integers(0, 9, size=n).astype(float) if rng.random() < 0.5 else np.zeros(n)
    if rng.random() < 0.15:
        node_cost[rng.integers(n)] = np.inf
    exit_of = np.arange(n)
    if rng.random() < 0.3:
        for g in range(m):
            nodes = np.flatnonzero(labels == g)
            exit_of[nodes] = rng.permutation(nodes)
    fields: dict = {}
    kind = rng.choice(["cycle", "home", "path", "start", "end", "both"])
    ends = [int(rng.choice(np.flatnonzero(labels == g))) for g in (0, m - 1)]
    if kind == "home":
        fields["home"] = ends[0]
    elif kind == "path":
        fields["path"] = True
    elif kind == "start":
        fields["start"] = ends[0]
    elif kind == "end":
        fields["end"] = ends[1]
    elif kind == "both":
        fields["start"] = ends[0]
        fields["end"] = ends[1] if m > 1 else ends[0]
    if rng.random() < 0.5 and m > 1:
        # increasing in a random order that keeps the first and last cluster where they are
        rank = np.concatenate([[0], 1 + rng.permutation(m - 2), [m - 1]])
        pairs = [(a, b) for a in range(m) for b in range(m) if rank[a] < rank[b]]
        fields["precedence"] = [p for p in pairs if rng.random() < 0.3]
    return GtspProblem(cost, labels, node_cost=node_cost, exit_of=exit_of, **fields)
