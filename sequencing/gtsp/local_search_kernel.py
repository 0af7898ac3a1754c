"""Local search of the memetic: insertion, 2-opt, segment insertion (3-opt), swap; then clusters.

The neighbourhoods of Gutin and Karapetyan 2010 on the normal form. Every move is first
improvement; after each sweep the nodes are optimised for the order. With precedences only
insertion within its window is used.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit
from sequencing.gtsp.cluster_optimisation import closed_cost, optimise_clusters
from sequencing.gtsp.rng import below
from sequencing.gtsp.ruin_recreate_kernel import insert_cheapest


@njit
def two_opt(cost, turned, order, node, first, symmetric):  # type: ignore[no-untyped-def]
    """One sweep of segment reversals with the nodes kept; returns the gain.

    first is 1 when the depot is pinned. In an asymmetric problem the reversed inside of a
    segment is paid for by running sums.
    """
    m = len(order)
    gain = 0.0
    for i in range(first, m - 1):
        inside = 0.0
        before = node[i - 1] if i > 0 else node[m - 1]
        for j in range(i + 1, m):
            if i == 0 and j == m - 1:
                continue
            if not symmetric:
                inside += cost[node[j], node[j - 1]] - cost[node[j - 1], node[j]]
            after = node[j + 1] if j + 1 < m else node[0]
            delta = (
                cost[before, node[j]] + cost[node[i], after]
                - cost[before, node[i]] - cost[node[j], after] + inside
            )  # fmt: skip
            if delta < -1e-9:
                a, b = i, j
                while a < b:
                    order[a], order[b] = order[b], order[a]
                    node[a], node[b] = node[b], node[a]
                    a += 1
                    b -= 1
                gain -= delta
                inside = -inside
                if not symmetric:
                    inside = 0.0
                    for k in range(i + 1, j + 1):
                        inside += cost[node[k], node[k - 1]] - cost[node[k - 1], node[k]]
    return gain


@njit
def move_segments(cost, order, node, first, longest, work_order, work_node):  # type: ignore[no-untyped-def]
    """One sweep of moving segments of 2 … longest clusters (or-3opt); returns the gain."""
    m = len(order)
    gain = 0.0
    for i in range(first, m - 1):
        for length in range(2, longest + 1):
            j = i + length - 1
            if j >= m or length > m - 3:
                break
            before = node[i - 1] if i > 0 else node[m - 1]
            after = node[j + 1] if j + 1 < m else node[0]
            head, tail = node[i], node[j]
            freed = cost[before, head] + cost[tail, after] - cost[before, after]
            best = freed - 1e-9
            at = -1
            for k in range(m):  # between k and k + 1, both outside the segment
                a = k
                b = k + 1 if k + 1 < m else 0
                if i <= a <= j or i <= b <= j:
                    continue
                added = cost[node[a], head] + cost[tail, node[b]] - cost[node[a], node[b]]
                if added < best:
                    best = added
                    at = a
            if at < 0:
                continue
            gain += freed - best
            count = 0
            for k in range(m):
                if not i <= k <= j:
                    work_order[count] = order[k]
                    work_node[count] = node[k]
                    count += 1
                    if k == at:
                        for s in range(i, j + 1):
                            work_order[count] = order[s]
                            work_node[count] = node[s]
                            count += 1
            order[:] = work_order
            node[:] = work_node
    return gain


@njit
def swap_sweep(cost, order, node, first):  # type: ignore[no-untyped-def]
    """One sweep of exchanging two clusters that are not neighbours; returns the gain."""
    m = len(order)
    gain = 0.0
    for i in range(first, m):
        for j in range(i + 2, m):
            if i == 0 and j == m - 1:
                continue
            a, b = node[i - 1] if i > 0 else node[m - 1], node[i + 1]
            c, d = node[j - 1], node[j + 1] if j + 1 < m else node[0]
            u, v = node[i], node[j]
            delta = (
                cost[a, v] + cost[v, b] + cost[c, u] + cost[u, d]
                - cost[a, u] - cost[u, b] - cost[c, v] - cost[v, d]
            )  # fmt: skip
            if delta < -1e-9:
                node[i], node[j] = v, u
                order[i], order[j] = order[j], order[i]
                gain -= delta
    return gain


@njit
def reinsert_sweep(  # type: ignore[no-untyped-def]
    cost, turned, into, outof, ptr, before, ordered, pinned, state, order, node, edge
):
    """Take each cluster out once and put it back at its cheapest place and node."""
    m = len(order)
    sequence = order.copy()
    for k in range(m - 1, 0, -1):
        j = below(state, k + 1)
        sequence[k], sequence[j] = sequence[j], sequence[k]
    for g in sequence:
        if (pinned and g == 0) or m < 3:
            continue
        at = 0
        while order[at] != g:
            at += 1
        for k in range(at, m - 1):
            order[k] = order[k + 1]
            node[k] = node[k + 1]
        for k in range(m - 1):
            edge[k] = cost[node[k - 1 if k > 0 else m - 2], node[k]]
        insert_cheapest(
            cost, turned, into, outof, ptr, before, ordered, pinned, 0.0, state,
            order, node, edge, m - 1, g,
        )  # fmt: skip


@njit
def local_search(  # type: ignore[no-untyped-def]
    cost, turned, into, outof, ptr, before, ordered, pinned, symmetric, state, order, node
):
    """Improve order and node (M,) to a local optimum of all moves; returns the cost."""
    m = len(order)
    dist = np.empty(len(cost))
    parent = np.empty(len(cost), dtype=np.int64)
    edge = np.empty(m)
    work_order = np.empty(m, dtype=np.int64)
    work_node = np.empty(m, dtype=np.int64)
    first = 1 if pinned else 0
    longest = min(50, m // 2)
    best = optimise_clusters(cost, ptr, order, m, node, dist, parent)
    kept_order = order.copy()
    kept_node = node.copy()
    while True:
        reinsert_sweep(
            cost, turned, into, outof, ptr, before, ordered, pinned, state, order, node, edge
        )
        if not ordered and m > 3:
            two_opt(cost, turned, order, node, first, symmetric)
            move_segments(cost, order, node, first, longest, work_order, work_node)
            swap_sweep(cost, order, node, first)
        optimise_clusters(cost, ptr, order, m, node, dist, parent)
        value = closed_cost(cost, node, m)
        if value < best - 1e-9:
            best = value
            kept_order[:] = order
            kept_node[:] = node
        else:
            break
    order[:] = kept_order
    node[:] = kept_node
    return best
