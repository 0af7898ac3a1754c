"""Problems: what they mean, and what is refused."""

import numpy as np
import pytest

from dmoc.errors import DmocError, ProblemError
from sequencing.gtsp import (
    GtspProblem,
    Stop,
    Tour,
    problem_from_graph,
    problem_to_graph,
    solve,
    tour_to_graph,
)

nx = pytest.importorskip("networkx")


def ring(n=6):
    """n nodes on a ring, clusters of two neighbours."""
    k = np.arange(n)
    way = np.abs(k[:, None] - k[None, :])
    return np.minimum(way, n - way).astype(float), k // 2


def code_of(**fields):
    cost, labels = ring()
    fields = {"cost": cost, "cluster_of": labels, **fields}
    with pytest.raises(ProblemError) as caught:
        GtspProblem(**fields)
    return [fault.code for fault in caught.value.faults]


def with_entry(value):
    cost, _ = ring()
    cost[1, 4] = value
    return cost


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"cost": with_entry(np.nan)}, "gtsp-cost-nan"),
        ({"cost": with_entry(-np.inf)}, "gtsp-cost-minus-inf"),
        ({"cost": with_entry(1e30)}, "gtsp-cost-huge"),
        ({"cost": np.zeros((6, 5))}, "gtsp-shape"),
        ({"cost": "text"}, "gtsp-not-numeric"),
        ({"cluster_of": [0, 0, 1, 1, 3, 3]}, "gtsp-cluster-empty"),
        ({"cluster_of": [0, 0, 1, 1, 9, 9]}, "gtsp-cluster-empty"),
        ({"cluster_of": [0, 0, -1, 1, 2, 2]}, "gtsp-cluster-range"),
        ({"cluster_of": [0, 0, 0.5, 1, 2, 2]}, "gtsp-not-integer"),
        ({"node_cost": [0, 0, np.nan, 0, 0, 0]}, "gtsp-cost-nan"),
        ({"node_cost": [0, 0]}, "gtsp-shape"),
        ({"home": 9}, "gtsp-node-range"),
        ({"home": 0, "start": 2}, "gtsp-home-and-path"),
        ({"start": 0, "end": 1}, "gtsp-ends-same-cluster"),
        ({"exit_of": [2, 1, 2, 3, 4, 5]}, "gtsp-exit-cluster"),
        ({"exit_of": [0, 1, 2, 3, 4, 17]}, "gtsp-node-range"),
        ({"precedence": [(0, 1), (1, 2), (2, 0)]}, "gtsp-precedence-cycle"),
        ({"precedence": nx.DiGraph([(0, 0)])}, "gtsp-precedence-cycle"),
        ({"precedence": [(0, 7)]}, "gtsp-precedence-range"),
        ({"precedence": [(1, 0)], "home": 0}, "gtsp-precedence-first"),
        ({"precedence": [(1, 0)], "start": 1}, "gtsp-precedence-first"),
        ({"precedence": [(2, 0)], "end": 4}, "gtsp-precedence-last"),
        ({"precedence": [1, 2]}, "gtsp-precedence-pairs"),
    ],
)
def test_bad_input_is_refused_with_a_code(fields, code):
    assert code in code_of(**fields)


@pytest.mark.parametrize(
    ("clusters", "code"),
    [
        ([[0, 1], [2, 3], []], "gtsp-cluster-empty"),
        ([[0, 1], [1, 2], [3, 4, 5]], "gtsp-cluster-overlap"),
        ([[0, 1], [2, 3], [4]], "gtsp-node-without-cluster"),
        ([[0, 1], [2, 3], [4, 8]], "gtsp-node-range"),
    ],
)
def test_lists_of_clusters_must_partition_the_nodes(clusters, code):
    with pytest.raises(ProblemError) as caught:
        GtspProblem.from_clusters(ring()[0], clusters)
    assert code in [fault.code for fault in caught.value.faults]


def test_all_faults_are_reported_at_once():
    assert {"gtsp-cost-nan", "gtsp-node-range"} <= set(
        code_of(cost=with_entry(np.nan), home=-3, end=77)
    )


def test_arrays_are_read_only_copies():
    cost, labels = ring()
    problem = GtspProblem(cost, labels)
    cost[0, 1] = 99.0
    assert problem.cost[0, 1] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        problem.cost[0, 1] = 5.0


def test_tour_cost_and_faults():
    cost, labels = ring()
    problem = GtspProblem(cost, labels, node_cost=np.arange(6.0), precedence=[(1, 2)])
    assert problem.tour_cost([0, 2, 4]) == 6 + 6
    assert problem.faults([0, 2, 4]) == ()
    assert "cluster 1 must come before cluster 2" in problem.faults([0, 4, 2])[0]
    assert problem.faults([0, 2]) == ("not exactly one node of every cluster",)
    assert problem.faults([0, 2, 99])


def test_seam_is_left_at_its_other_end():
    # a seam between nodes 1 and 2; points 0 and 3 beside its ends
    cost = np.array([[0, 1, 9, 5], [1, 0, 0, 9], [9, 0, 0, 1], [5, 9, 1, 0.0]])
    problem = GtspProblem(cost, [0, 1, 1, 2], exit_of=[0, 2, 1, 3], node_cost=[0, 7, 7, 0], start=0)
    tour = solve(problem)
    assert tour.nodes == (0, 1, 3)
    assert tour.cost == 1 + 7 + 1
    assert problem.edges(tour.nodes).tolist() == [[0, 1], [2, 3]]


def test_replace_checks_again():
    problem = GtspProblem(*ring())
    assert problem.replace(home=3).home == 3
    assert not problem.path
    assert problem.replace(start=3).path
    with pytest.raises(ProblemError):
        problem.replace(home=99)


@pytest.mark.parametrize("method", ["auto", "heuristic", "exact", "held-karp"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_clusters_of_one_node(method, count):
    cost = np.arange(9.0).reshape(3, 3)[:count, :count]
    tour = solve(GtspProblem(cost, np.arange(count)), stop=50, method=method)
    assert tour.found
    assert tour.cost == GtspProblem(cost, np.arange(count)).tour_cost(range(count))


@pytest.mark.parametrize("method", ["auto", "heuristic", "exact", "held-karp"])
def test_no_tour_is_an_answer(method):
    cost = np.full((4, 4), np.inf)
    tour = solve(GtspProblem(cost, [0, 1, 2, 2]), stop=50, method=method)
    assert not tour.found
    assert tour.cost == np.inf
    assert tour.proven  # so small that the exact table answers for every method
    assert tour.gap == 0.0


def test_cluster_without_available_node_is_proven_infeasible():
    cost, labels = ring()
    tour = solve(GtspProblem(cost, labels, node_cost=[0, 0, np.inf, np.inf, 0, 0]))
    assert tour == Tour((), np.inf, np.inf, True, tour.method)


def test_options_are_checked():
    problem = GtspProblem(*ring())
    for options in ({"method": "magic"}, {"effort": "huge"}, {"stop": -4}):
        with pytest.raises(DmocError):
            solve(problem, **options)
    with pytest.raises(ProblemError):
        Stop(target_cost=float("nan"))


def test_graph_in_and_out():
    problem = GtspProblem(with_entry(np.inf), ring()[1], node_cost=np.arange(6.0))
    back, labels = problem_from_graph(problem_to_graph(problem))
    assert labels == list(range(6))
    other = problem.cluster_of[:, None] != problem.cluster_of[None, :]
    assert np.array_equal(back.cost[other], problem.cost[other])
    assert np.array_equal(back.node_cost, problem.node_cost)
    tour = solve(problem)
    graph = tour_to_graph(problem, tour)
    total = sum(w for *_, w in graph.edges(data="weight"))
    assert total + problem.node_cost[list(tour.nodes)].sum() == pytest.approx(tour.cost)


def test_graph_without_clusters_is_refused():
    with pytest.raises(ProblemError) as caught:
        problem_from_graph(nx.complete_graph(3))
    assert caught.value.faults[0].code == "gtsp-graph-attribute"


def test_undirected_graph_counts_both_ways():
    graph = nx.Graph()
    for name, g in (("a", "A"), ("b", "B"), ("c", "C")):
        graph.add_node(name, cluster=g)
    graph.add_weighted_edges_from([("a", "b", 1.0), ("b", "c", 2.0), ("c", "a", 4.0)])
    problem, labels = problem_from_graph(graph)
    tour = solve(problem)
    assert tour.cost == 7.0
    assert labels[tour.nodes[0]] == "a"
