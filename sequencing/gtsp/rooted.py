"""Rooted problems for the exact solvers: one depot node, and the clusters still to visit.

A normal form with a depot is one rooted problem. A free cycle is one for each node of its
smallest cluster; with precedences, which are counted from the first cluster, one for each node
of every cluster that may come first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sequencing.gtsp.normalise import NormalForm


@dataclass(frozen=True, eq=False)
class Rooted:
    """m clusters over n nodes, with edges from and to a root.

    cost (n, n), leave (n,) root → node, back (n,) node → root: forbidden = inf;
    ptr (m+1,); needs (m,) bit mask of the clusters before each; node (n,) in the normal form;
    root: its node there.
    """

    cost: np.ndarray
    leave: np.ndarray
    back: np.ndarray
    ptr: np.ndarray
    needs: np.ndarray
    node: np.ndarray
    root: int


def rooted_problems(form: NormalForm) -> list[Rooted]:
    """The rooted problems whose best answer is the answer of the normal form."""
    if form.pinned:
        return [_rooted(form, 0, 0)]
    if form.ordered:
        groups = [g for g in range(form.num_clusters) if not form.before[:, g].any()]
    else:
        groups = [int(np.argmin(np.diff(form.ptr)))]
    return [_rooted(form, g, v) for g in groups for v in range(form.ptr[g], form.ptr[g + 1])]


def _rooted(form: NormalForm, group: int, root: int) -> Rooted:
    groups = [g for g in range(form.num_clusters) if g != group]
    node = np.flatnonzero(form.cluster != group)
    counts = np.diff(form.ptr)[groups]
    cost = np.where(form.cost >= form.penalty, np.inf, form.cost)
    needs = np.zeros(len(groups), dtype=np.int64)
    for k, g in enumerate(groups):
        for j, h in enumerate(groups):
            if form.before[h, g]:
                needs[k] |= 1 << j
    return Rooted(
        cost=np.ascontiguousarray(cost[np.ix_(node, node)]),
        leave=cost[root, node].copy(),
        back=cost[node, root].copy(),
        ptr=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        needs=needs,
        node=node.astype(np.int64),
        root=root,
    )


def smallest_first(rooted: Rooted) -> Rooted:
    """The same problem with its clusters by size."""
    sizes = np.diff(rooted.ptr)
    order = np.argsort(sizes, kind="stable")
    node = np.concatenate([np.arange(rooted.ptr[g], rooted.ptr[g + 1]) for g in order])
    rank = np.argsort(order)
    needs = np.zeros_like(rooted.needs)
    for g, mask in enumerate(rooted.needs):
        for h in range(len(sizes)):
            if (int(mask) >> h) & 1:
                needs[rank[g]] |= 1 << int(rank[h])
    return Rooted(
        cost=np.ascontiguousarray(rooted.cost[np.ix_(node, node)]),
        leave=rooted.leave[node],
        back=rooted.back[node],
        ptr=np.concatenate([[0], np.cumsum(sizes[order])]).astype(np.int64),
        needs=needs,
        node=rooted.node[node],
        root=rooted.root,
    )
