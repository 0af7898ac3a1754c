"""Cluster optimisation: the best nodes for a given order of clusters, by layered shortest paths.

Fischetti, Salazar-González, Toth 1997. O(Σ k_i k_{i+1}) for one anchored node of the first
cluster, times the nodes of the smallest cluster for the exact optimum.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit


@njit
def next_layer(cost, dist, parent, first, last, begin, end):  # type: ignore[no-untyped-def]
    """Shortest lengths to nodes begin … end−1 from those of the layer before, first … last−1."""
    for v in range(begin, end):
        best = np.inf
        origin = first
        for u in range(first, last):
            length = dist[u] + cost[u, v]
            if length < best:
                best = length
                origin = u
        dist[v] = best
        parent[v] = origin


@njit
def close_tour(cost, dist, parent, first, last, size, node):  # type: ignore[no-untyped-def]
    """Lead the last layer back to node[0]; fills node[1:size] and returns the closed cost."""
    best = np.inf
    at = first
    for u in range(first, last):
        length = dist[u] + cost[u, node[0]]
        if length < best:
            best = length
            at = u
    for k in range(size - 1, 0, -1):
        node[k] = at
        at = parent[at]
    return best


@njit
def optimise_anchored(cost, ptr, order, size, node, dist, parent):  # type: ignore[no-untyped-def]
    """Best nodes for `order[:size]` with the node of order[0] kept; returns the closed cost.

    cost (N, N) float64; ptr (M+1,); order (≥size,) clusters; node (≥size,) nodes, overwritten;
    dist (N,) float64 and parent (N,) int64 are work space.
    """
    first, last = node[0], node[0] + 1
    dist[first] = 0.0
    for k in range(1, size):
        begin, end = ptr[order[k]], ptr[order[k] + 1]
        next_layer(cost, dist, parent, first, last, begin, end)
        first, last = begin, end
    return close_tour(cost, dist, parent, first, last, size, node)


@njit
def optimise_windows(cost, ptr, order, active, edge, size, node, dist, parent):  # type: ignore[no-untyped-def]
    """As `optimise_anchored`, but only the nodes of positions marked in `active` may change.

    edge[k] is the cost from node[k−1] to node[k] before; edge[0] closes the tour.
    """
    first, last = node[0], node[0] + 1
    dist[first] = 0.0
    free = False
    for k in range(1, size):
        v = node[k]
        if not active[k] and not free:  # both ends are kept: no choice
            dist[v] = dist[first] + edge[k]
            parent[v] = first
            first, last = v, v + 1
            continue
        free = active[k]
        if free:
            begin, end = ptr[order[k]], ptr[order[k] + 1]
        else:
            begin, end = v, v + 1
        next_layer(cost, dist, parent, first, last, begin, end)
        first, last = begin, end
    return close_tour(cost, dist, parent, first, last, size, node)


@njit
def optimise_clusters(cost, ptr, order, size, node, dist, parent):  # type: ignore[no-untyped-def]
    """Exact optimum over all nodes for the cyclic `order[:size]`; the order is not turned.

    One anchored pass for every node of the smallest cluster. Returns the closed cost.
    """
    if size == 1:
        return 0.0
    small = 0
    for k in range(size):
        if ptr[order[k] + 1] - ptr[order[k]] < ptr[order[small] + 1] - ptr[order[small]]:
            small = k
    turned = np.empty(size, dtype=np.int64)
    trial = np.empty(size, dtype=np.int64)
    chosen = np.empty(size, dtype=np.int64)
    for k in range(size):
        turned[k] = order[(small + k) % size]
    best = np.inf
    for v in range(ptr[turned[0]], ptr[turned[0] + 1]):
        trial[0] = v
        length = optimise_anchored(cost, ptr, turned, size, trial, dist, parent)
        if length < best:
            best = length
            chosen[:] = trial
    for k in range(size):
        node[(small + k) % size] = chosen[k]
    return best


@njit
def closed_cost(cost, node, size):  # type: ignore[no-untyped-def]
    """Σ cost[node_k, node_{k+1}], closed; 0 for one node."""
    total = 0.0
    if size == 1:
        return total
    for k in range(size - 1):
        total += cost[node[k], node[k + 1]]
    return total + cost[node[size - 1], node[0]]
