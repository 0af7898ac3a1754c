"""networkx graphs in and out."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Any

import numpy as np

from dmoc.errors import ProblemError
from sequencing.gtsp.problem import GtspProblem, Tour

if TYPE_CHECKING:
    import networkx as nx


def problem_from_graph(
    graph: nx.Graph, weight: str = "weight", cluster: str = "cluster", **fields: Any
) -> tuple[GtspProblem, list[Hashable]]:
    """A problem and the graph's node for each of its nodes.

    A missing edge is forbidden; an undirected edge counts both ways. Node attributes: `cluster`
    (any value, one cluster a value, numbered in order of appearance) and, if there, `cost`.
    `fields` go to `GtspProblem`. Raises `ProblemError` where an attribute is missing.
    """
    labels = list(graph.nodes)
    place = {label: k for k, label in enumerate(labels)}
    missing = [label for label in labels if cluster not in graph.nodes[label]]
    loose = [(u, v) for u, v, data in graph.edges(data=True) if weight not in data]
    if missing or loose:
        name, at = (cluster, missing[0]) if missing else (weight, loose[0])
        raise ProblemError.of(
            "gtsp-graph-attribute",
            field=str(at),
            value=f"no attribute {name!r}",
            legal=f"every node has {cluster!r}, every edge {weight!r}",
        )
    numbers: dict[Any, int] = {}
    groups = [numbers.setdefault(graph.nodes[label][cluster], len(numbers)) for label in labels]
    cost = np.full((len(labels), len(labels)), np.inf)
    for u, v, data in graph.edges(data=True):
        cost[place[u], place[v]] = data[weight]
        if not graph.is_directed():
            cost[place[v], place[u]] = data[weight]
    node_cost = np.array([float(graph.nodes[label].get("cost", 0.0)) for label in labels])
    return GtspProblem(cost, np.array(groups), node_cost=node_cost, **fields), labels


def problem_to_graph(problem: GtspProblem) -> nx.DiGraph:
    """The usable edges as a directed graph: nodes with `cluster` and `cost`, edges `weight`."""
    import networkx as nx

    graph = nx.DiGraph(name=problem.name)
    for v in range(problem.num_nodes):
        graph.add_node(v, cluster=int(problem.cluster_of[v]), cost=float(problem.node_cost[v]))
    other = problem.cluster_of[:, None] != problem.cluster_of[None, :]
    for u, v in np.argwhere(other & np.isfinite(problem.cost)):
        graph.add_edge(int(u), int(v), weight=float(problem.cost[u, v]))
    return graph


def tour_to_graph(problem: GtspProblem, tour: Tour) -> nx.DiGraph:
    """The travels of a tour as a directed graph, with `weight` and the `position` of each."""
    import networkx as nx

    graph = nx.DiGraph(cost=tour.cost)
    for k, (u, v) in enumerate(problem.edges(tour.nodes)):
        graph.add_edge(int(u), int(v), weight=float(problem.cost[u, v]), position=k)
    return graph
