"""One normal form for all kinds of problem, so that every kernel knows only one.

Cycle, path, home, fixed ends, node costs, exit nodes and missing nodes all become: a closed tour
over clusters of consecutive nodes, with at most one pinned cluster, the depot (cluster 0 with the
one node 0), which comes first. Node costs are split half to the incoming, half to the outgoing
edge, which keeps a symmetric problem symmetric.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sequencing.gtsp.problem import GtspProblem
from sequencing.gtsp.validation import closure


@dataclass(frozen=True, eq=False)
class NormalForm:
    """A closed problem in the form of the kernels.

    cost      (N, N) float64; forbidden edges and edges inside a cluster are `penalty`.
    ptr       (M + 1,) int64: cluster g holds nodes ptr[g] … ptr[g+1]−1.
    cluster   (N,) int64.
    origin    (N,) node of the problem, −1 for a depot that stands for the ends of a path.
    origin_cluster (M,) cluster of the problem, −1 for that depot.
    pinned    cluster 0 is the depot and comes first.
    before    (M, M) bool, transitive closure of the precedences.
    penalty   more than any admissible tour can cost above another one.
    whole     every admissible tour has a whole-number cost (bounds may be rounded up).
    empty     a cluster has no available node: there is no tour.
    """

    cost: np.ndarray
    ptr: np.ndarray
    cluster: np.ndarray
    origin: np.ndarray
    origin_cluster: np.ndarray
    pinned: bool
    before: np.ndarray
    penalty: float
    whole: bool
    empty: bool

    @property
    def num_clusters(self) -> int:
        return len(self.ptr) - 1

    @property
    def num_nodes(self) -> int:
        return len(self.cost)

    @property
    def ordered(self) -> bool:
        """True if there are precedences."""
        return bool(self.before.any())

    def lift(self, nodes: Iterable[int]) -> tuple[int, ...]:
        """Nodes of the problem for nodes of the normal form.

        A free cycle is turned to begin in cluster 0.
        """
        nodes = list(nodes)
        out = [int(self.origin[v]) for v in nodes if self.origin[v] >= 0]
        if not self.pinned and not self.ordered and out:
            groups = [int(self.origin_cluster[self.cluster[v]]) for v in nodes]
            k = groups.index(min(groups))
            out = out[k:] + out[:k]
        return tuple(out)

    def lower(self, nodes: Iterable[int]) -> np.ndarray | None:
        """Nodes of the normal form for a warm start; None if it is no tour of this problem."""
        place = {int(v): k for k, v in enumerate(self.origin) if v >= 0}
        if any(int(v) not in place for v in nodes):
            return None
        out = [place[int(v)] for v in nodes]
        if self.pinned:
            if self.origin[0] < 0:
                out = [0, *out]
            elif 0 in out:
                k = out.index(0)
                out = out[k:] + out[:k]
        array = np.array(out, dtype=np.int64)
        if sorted(self.cluster[array]) != list(range(self.num_clusters)):
            return None
        visited = self.cluster[array]
        if self.before[np.ix_(visited, visited)][np.tril_indices(len(visited))].any():
            return None
        return array


def normal_form(problem: GtspProblem) -> NormalForm:
    """The normal form of a problem."""
    keep = np.isfinite(problem.node_cost)
    for special in (problem.home, problem.start, problem.end):
        if special is not None:
            same = problem.cluster_of == problem.cluster_of[special]
            keep &= ~same | (np.arange(problem.num_nodes) == special)
    order = np.argsort(problem.cluster_of, kind="stable")
    order = order[keep[order]]
    first = None if problem.home is None else int(problem.cluster_of[problem.home])
    if first is not None:  # the home cluster comes first
        order = np.concatenate(
            [
                order[problem.cluster_of[order] == first],
                order[problem.cluster_of[order] != first],
            ]
        )
    labels = problem.cluster_of[order]
    travel = problem.cost[np.ix_(problem.exit_of[order], order)]
    half = problem.node_cost[order] / 2
    travel = travel + half[:, None] + half[None, :]
    groups = [g for g in range(problem.num_clusters) if g != first]
    if first is not None:
        groups.insert(0, first)
    empty = bool(np.setdiff1d(groups, labels).size)
    if problem.path:
        travel = _with_open_ends(travel, half, order, problem)
        order = np.concatenate([[-1], order])
        labels = np.concatenate([[-1], labels])
        groups.insert(0, -1)
    rank = {g: k for k, g in enumerate(groups)}
    cluster = np.array([rank[int(g)] for g in labels], dtype=np.int64)
    counts = np.bincount(cluster, minlength=len(groups))
    ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    pairs = [(rank[a], rank[b]) for a, b in problem.precedence]
    pinned = problem.path or problem.home is not None
    pairs = [p for p in pairs if not (pinned and p[0] == 0)]  # the depot is first anyway
    inside = cluster[:, None] == cluster[None, :]
    usable = np.isfinite(travel) & ~inside
    largest = float(np.abs(travel[usable]).max()) if usable.any() else 1.0
    penalty = 1.0 + 2.0 * (len(groups) + 1) * largest
    cost = np.where(usable, travel, penalty)
    finite = problem.cost[np.isfinite(problem.cost) & ~np.eye(problem.num_nodes, dtype=bool)]
    weights = problem.node_cost[keep]
    return NormalForm(
        cost=np.ascontiguousarray(cost),
        ptr=ptr,
        cluster=cluster,
        origin=order.astype(np.int64),
        origin_cluster=np.array(groups, dtype=np.int64),
        pinned=pinned,
        before=closure(pairs, len(groups)),
        penalty=penalty,
        whole=bool((finite == np.rint(finite)).all() and (weights == np.rint(weights)).all()),
        empty=empty,
    )


def _with_open_ends(
    travel: np.ndarray, half: np.ndarray, order: np.ndarray, problem: GtspProblem
) -> np.ndarray:
    """Add a depot as node 0: it costs nothing to leave for a first and reach from a last node."""
    size = len(order) + 1
    out = np.full((size, size), np.inf)
    out[1:, 1:] = travel
    out[0, 1:] = half
    out[1:, 0] = half
    if problem.start is not None:
        out[0, 1:][order != problem.start] = np.inf
    if problem.end is not None:
        out[1:, 0][order != problem.end] = np.inf
    return out
