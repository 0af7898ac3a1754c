"""Checks of a GTSP before any solver sees it: every fault at once, each with its remedy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from dmoc.errors import Fault, ProblemError
from dmoc.order_graph import circle_of


class Problem(Protocol):
    """What the checks read of a `GtspProblem`."""

    @property
    def cost(self) -> np.ndarray: ...
    @property
    def cluster_of(self) -> np.ndarray: ...
    @property
    def node_cost(self) -> np.ndarray: ...
    @property
    def home(self) -> int | None: ...
    @property
    def start(self) -> int | None: ...
    @property
    def end(self) -> int | None: ...
    @property
    def precedence(self) -> Any: ...
    @property
    def exit_of(self) -> np.ndarray: ...
    @property
    def path(self) -> bool: ...
    @property
    def num_nodes(self) -> int: ...
    @property
    def num_clusters(self) -> int: ...
    def tour_cost(self, nodes: Sequence[int]) -> float: ...


def frozen_array(value: Any, name: str, dtype: Any, ndim: int) -> np.ndarray:
    """A read-only copy of `value` as an array of `ndim` dimensions."""
    try:
        raw = np.asarray(value)
        array = np.array(raw, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise ProblemError.of(
            "gtsp-not-numeric", field=name, value=str(error), legal="an array of numbers"
        ) from error
    if array.ndim != ndim or array.size == 0:
        raise ProblemError.of(
            "gtsp-shape",
            field=name,
            value=f"shape {array.shape}",
            legal=f"{ndim} dimension(s), not empty",
        )
    if np.issubdtype(array.dtype, np.integer) and not np.array_equal(raw, array):
        raise ProblemError.of(
            "gtsp-not-integer", field=name, value="fractions", legal="whole numbers"
        )
    array.flags.writeable = False
    return array


def precedence_pairs(precedence: Any) -> tuple[tuple[int, int], ...]:
    """Sorted pairs (before, after) of a networkx DiGraph or of an iterable of pairs."""
    if precedence is None:
        return ()
    edges = precedence.edges() if hasattr(precedence, "edges") else precedence
    try:
        return tuple(sorted({(int(a), int(b)) for a, b in edges}))
    except (TypeError, ValueError) as error:
        raise ProblemError.of(
            "gtsp-precedence-pairs",
            field="precedence",
            value=str(error),
            legal="pairs (before, after) of cluster numbers, or a DiGraph over them",
        ) from error


def cluster_labels(clusters: Sequence[Sequence[int]], num_nodes: int) -> np.ndarray:
    """cluster_of (V,) from lists of nodes; overlap, gaps and empty lists are faults."""
    faults: list[Fault] = []
    labels = np.full(num_nodes, -1, dtype=np.int64)
    for g, nodes in enumerate(clusters):
        where = f"clusters[{g}]"
        if len(nodes) == 0:
            faults.append(_fault("gtsp-cluster-empty", where, "no nodes", "at least one node"))
        for node in nodes:
            if not 0 <= int(node) < num_nodes:
                faults.append(_fault("gtsp-node-range", where, str(node), f"0 … {num_nodes - 1}"))
            elif labels[int(node)] >= 0:
                other = f"node {node}, already in cluster {labels[int(node)]}"
                faults.append(_fault("gtsp-cluster-overlap", where, other, "disjoint clusters"))
            else:
                labels[int(node)] = g
    missing = np.flatnonzero(labels < 0)
    if missing.size and not faults:
        text = ", ".join(map(str, missing[:5]))
        faults.append(_fault("gtsp-node-without-cluster", "clusters", text, "every node in one"))
    if faults:
        raise ProblemError(faults)
    return labels


def check_problem(problem: Problem) -> None:
    """Raise `ProblemError` with all faults of a problem, or return."""
    faults = _shape_faults(problem)
    if not faults:
        faults = _number_faults(problem) + _special_node_faults(problem)
    if not faults:
        faults = _precedence_faults(problem)
    if faults:
        raise ProblemError(faults)


def closure(pairs: Sequence[tuple[int, int]], size: int) -> np.ndarray:
    """before (size, size) bool: the transitive closure of the pairs."""
    before = np.zeros((size, size), dtype=np.bool_)
    for a, b in pairs:
        before[a, b] = True
    for k in range(size):
        before |= np.outer(before[:, k], before[k])
    return before


def faults_of_tour(problem: Problem, nodes: Sequence[int]) -> tuple[str, ...]:
    """Sentences saying why `nodes` is no admissible tour of `problem`."""
    index = [int(v) for v in nodes]
    if any(not 0 <= v < problem.num_nodes for v in index):
        return ("a node number is outside the problem",)
    out = []
    visited = [int(problem.cluster_of[v]) for v in index]
    if sorted(visited) != list(range(problem.num_clusters)):
        return ("not exactly one node of every cluster",)
    for key, at in (("home", 0), ("start", 0), ("end", -1)):
        wanted = getattr(problem, key)
        if wanted is not None and index[at] != wanted:
            out.append(f"{key} is node {wanted}, the tour has {index[at]} there")
    place = {g: k for k, g in enumerate(visited)}
    out += [
        f"cluster {a} must come before cluster {b}"
        for a, b in problem.precedence
        if place[a] > place[b]
    ]
    if not np.isfinite(problem.tour_cost(index)):
        out.append("it uses a forbidden edge or node")
    return tuple(out)


def _fault(code: str, field: str, value: str, legal: str, fix: str = "") -> Fault:
    return Fault(code, field=field, value=value, legal=legal, fix=fix)


def _shape_faults(problem: Problem) -> list[Fault]:
    size = problem.cost.shape[0]
    faults = []
    if problem.cost.shape != (size, size):
        faults.append(_fault("gtsp-shape", "cost", f"shape {problem.cost.shape}", "square (V, V)"))
    for key in ("cluster_of", "node_cost", "exit_of"):
        shape = getattr(problem, key).shape
        if shape != (size,):
            faults.append(_fault("gtsp-shape", key, f"shape {shape}", f"({size},) as cost"))
    if faults:
        return faults
    labels = problem.cluster_of
    if labels.min() < 0:
        return [_fault("gtsp-cluster-range", "cluster_of", str(labels.min()), "0 … M−1")]
    if labels.max() >= size:
        text = f"cluster {labels.max()} with {size} nodes"
        return [_fault("gtsp-cluster-empty", "cluster_of", text, "0 … M−1, none empty")]
    empty = np.flatnonzero(np.bincount(labels) == 0)
    if empty.size:
        text = "no node in cluster " + ", ".join(map(str, empty[:5]))
        faults.append(_fault("gtsp-cluster-empty", "cluster_of", text, "every cluster has a node"))
    return faults


def _number_faults(problem: Problem) -> list[Fault]:
    faults = []
    off = ~np.eye(problem.num_nodes, dtype=bool)
    for key, array, used in (
        ("cost", problem.cost, off),
        ("node_cost", problem.node_cost, np.ones(problem.num_nodes, dtype=bool)),
    ):
        for code, bad in (
            ("gtsp-cost-nan", np.isnan(array) & used),
            ("gtsp-cost-minus-inf", np.isneginf(array) & used),
        ):
            if bad.any():
                at = ", ".join(map(str, np.argwhere(bad)[0]))
                what = "NaN" if code.endswith("nan") else "-inf"
                fix = "use inf for an edge or node that must not be used"
                faults.append(_fault(code, f"{key}[{at}]", what, "finite or inf", fix))
        finite = np.isfinite(array) & used
        if finite.any() and np.abs(array[finite]).max() > 1e15:
            text = f"{np.abs(array[finite]).max():g}"
            fix = "use inf to forbid an edge"
            faults.append(_fault("gtsp-cost-huge", key, text, "at most 1e15", fix))
    return faults


def _special_node_faults(problem: Problem) -> list[Fault]:
    size = problem.num_nodes
    faults = []
    for key in ("home", "start", "end"):
        node = getattr(problem, key)
        if node is not None and not 0 <= node < size:
            faults.append(_fault("gtsp-node-range", key, str(node), f"0 … {size - 1}"))
    if problem.home is not None and problem.path:
        fix = "path=False for a cycle, or start instead of home for a path"
        faults.append(
            _fault("gtsp-home-and-path", "home", "home with a path", "home only for cycles", fix)
        )
    leaves = problem.exit_of
    if leaves.min() < 0 or leaves.max() >= size:
        return [*faults, _fault("gtsp-node-range", "exit_of", str(leaves), f"0 … {size - 1}")]
    other = np.flatnonzero(problem.cluster_of[leaves] != problem.cluster_of)
    if other.size:
        text = f"node {other[0]} leaves at node {leaves[other[0]]} of another cluster"
        faults.append(_fault("gtsp-exit-cluster", "exit_of", text, "a node of the same cluster"))
    ends = (problem.start, problem.end)
    if not faults and None not in ends and problem.num_clusters > 1:
        a, b = (int(problem.cluster_of[v]) for v in ends)
        if a == b:
            text = f"both in cluster {a}"
            faults.append(_fault("gtsp-ends-same-cluster", "end", text, "two different clusters"))
    if not faults and problem.num_clusters == 1 and None not in ends and ends[0] != ends[1]:
        text = f"{ends[0]} and {ends[1]}, one cluster"
        faults.append(_fault("gtsp-ends-same-cluster", "end", text, "the same node"))
    return faults


def _precedence_faults(problem: Problem) -> list[Fault]:
    pairs = problem.precedence
    count = problem.num_clusters
    wrong = [p for p in pairs if not (0 <= p[0] < count and 0 <= p[1] < count)]
    if wrong:
        text = f"pair {wrong[0]}"
        return [_fault("gtsp-precedence-range", "precedence", text, f"clusters 0 … {count - 1}")]
    if not pairs:
        return []
    circle = circle_of(pairs)
    if circle:
        text = "clusters " + " -> ".join(map(str, circle))
        return [_fault("gtsp-precedence-cycle", "precedence", text, "no circle")]
    before = closure(pairs, count)
    faults = []
    first = problem.home if problem.home is not None else problem.start
    if first is not None and before[:, problem.cluster_of[first]].any():
        g = int(problem.cluster_of[first])
        text = f"cluster {np.flatnonzero(before[:, g])[0]} before cluster {g}, which is first"
        faults.append(_fault("gtsp-precedence-first", "precedence", text, "nothing before it"))
    if problem.end is not None and before[problem.cluster_of[problem.end]].any():
        g = int(problem.cluster_of[problem.end])
        text = f"cluster {g}, which is last, before cluster {np.flatnonzero(before[g])[0]}"
        faults.append(_fault("gtsp-precedence-last", "precedence", text, "nothing after it"))
    return faults
