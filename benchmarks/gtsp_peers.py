"""Adapters to other solvers, for comparison only; each returns the cost it found or None.

All want whole-number costs. PyVRP: clients in mutually exclusive groups; OR-Tools: disjunctions
that allow one active node; LKH through elkai: the Noon–Bean transformation to an asymmetric TSP.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

import numpy as np

from sequencing.gtsp import GtspProblem

Peer = Callable[[GtspProblem, float], float | None]
FORBIDDEN = 10_000_000


def installed() -> dict[str, Peer]:
    """The peers that can be imported."""
    known: dict[str, Peer] = {"pyvrp": pyvrp, "ortools": ortools, "elkai": elkai}
    return {name: run for name, run in known.items() if importlib.util.find_spec(name)}


def matrix(problem: GtspProblem) -> np.ndarray:
    """Whole-number costs with a zero diagonal."""
    cost = np.where(np.isfinite(problem.cost), problem.cost, FORBIDDEN)
    np.fill_diagonal(cost, 0)
    return np.rint(cost).astype(np.int64)


def root_cluster(problem: GtspProblem) -> int:
    """The home's cluster, or the smallest one."""
    if problem.home is not None:
        return int(problem.cluster_of[problem.home])
    return int(np.argmin(np.bincount(problem.cluster_of)))


def pyvrp(problem: GtspProblem, seconds: float) -> float | None:
    """PyVRP (0.14 or later) from the root node (best of three where the root cluster is larger)."""
    from pyvrp import Model
    from pyvrp.stop import MaxRuntime

    cost = matrix(problem)
    roots = problem.clusters[root_cluster(problem)][:3]
    best = None
    for root in roots:
        model = Model()
        model.add_vehicle_type(1)
        places = {root: model.add_location(0, 0)}
        model.add_depot(places[root])
        for g, nodes in enumerate(problem.clusters):
            if g == root_cluster(problem):
                continue
            group = model.add_client_group(required=True)
            for v in nodes:
                places[v] = model.add_location(0, 0)
                model.add_client(places[v], required=False, group=group)
        for u, a in places.items():
            for v, b in places.items():
                if u != v:
                    model.add_edge(a, b, int(cost[u, v]))
        result = model.solve(MaxRuntime(seconds / len(roots)), display=False)
        if result.is_feasible():
            value = float(result.cost())
            best = value if best is None else min(best, value)
    return best


def ortools(problem: GtspProblem, seconds: float) -> float | None:
    """OR-Tools routing: guided local search from one root node."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    cost = matrix(problem)
    root = problem.clusters[root_cluster(problem)][0]
    nodes = [root] + [
        v for v in range(problem.num_nodes) if problem.cluster_of[v] != problem.cluster_of[root]
    ]
    manager = pywrapcp.RoutingIndexManager(len(nodes), 1, 0)
    routing = pywrapcp.RoutingModel(manager)
    small = cost[np.ix_(nodes, nodes)]

    def travel(a: int, b: int) -> int:
        return int(small[manager.IndexToNode(a), manager.IndexToNode(b)])

    routing.SetArcCostEvaluatorOfAllVehicles(routing.RegisterTransitCallback(travel))
    place = {v: k for k, v in enumerate(nodes)}
    for g, members in enumerate(problem.clusters):
        if g != root_cluster(problem):
            indices = [manager.NodeToIndex(place[v]) for v in members]
            routing.AddDisjunction(indices, FORBIDDEN * 10, 1)
    options = pywrapcp.DefaultRoutingSearchParameters()
    options.local_search_metaheuristic = (
        routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    )
    options.time_limit.FromMilliseconds(int(1000 * seconds))
    solution = routing.SolveWithParameters(options)
    if solution is None or solution.ObjectiveValue() >= FORBIDDEN:
        return None
    return float(solution.ObjectiveValue())


def elkai(problem: GtspProblem, seconds: float) -> float | None:
    """LKH on the Noon–Bean asymmetric TSP (one run; `seconds` cannot be given to it)."""
    import elkai as lkh

    cost = matrix(problem)
    size = problem.num_nodes
    usable = cost[problem.cluster_of[:, None] != problem.cluster_of[None, :]]
    big = int(usable[usable < FORBIDDEN].max()) * 3
    if size > 300 or big * (problem.num_clusters + 1) > 2**30:
        return None  # slow, and its 32-bit costs overflow
    out = np.full((size, size), big * 4, dtype=np.int64)
    follows = np.arange(size)
    for nodes in problem.clusters:
        for k, v in enumerate(nodes):
            follows[v] = nodes[(k + 1) % len(nodes)]
    before = np.argsort(follows)
    for nodes in problem.clusters:
        for v in nodes:
            others = problem.cluster_of != problem.cluster_of[v]
            # leaving a cluster from the node before v (in its ring) means that v was chosen
            out[before[v], others] = np.minimum(cost[v, others], big) + big
            if follows[v] != v:
                out[v, follows[v]] = 0
    np.fill_diagonal(out, 0)
    order = lkh.DistanceMatrix(out.tolist()).solve_tsp()[:-1]
    chosen = []
    for k, v in enumerate(order):
        if problem.cluster_of[order[k - 1]] != problem.cluster_of[v]:
            chosen.append(v)
    if len(chosen) != problem.num_clusters:
        return None
    return problem.tour_cost(chosen)
