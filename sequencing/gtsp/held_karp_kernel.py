"""Generalised Held–Karp: the table over sets of clusters and last nodes.

f(S, v) = shortest walk from the depot through all clusters of S, one node each, that ends at
v in S:

    f(S ∪ {g}, v) = min over h in S, u in h of f(S, u) + c(u, v)      for v in g, g not in S

Held and Karp 1962, generalised as in Björkenstam et al. (reference 11). Costs are whole numbers
(int32), so that a result is exact for the costs given. The table keeps, for each cluster, only
the sets that contain it; parents are recomputed.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit

INF = np.int32(1 << 29)


@njit
def squeeze(mask, g):  # type: ignore[no-untyped-def]
    """The mask without its bit g."""
    return ((mask >> (g + 1)) << g) | (mask & ((1 << g) - 1))


@njit
def fill(cost, ptr, leave, needs, base, low, table):  # type: ignore[no-untyped-def]
    """Fill the table.

    cost (n, n) int32 between nodes of the m clusters (no depot), ≤ INF; ptr (m+1,);
    leave (n,) int32 from the depot; needs (m,) mask of clusters that must come before;
    base (m,) offset of each cluster in table; low: number of clusters whose sets are run through
    for one gathered cost matrix.
    """
    m = len(ptr) - 1
    n = ptr[m]
    inf = np.int32(1 << 29)
    table[:] = inf
    for g in range(m):
        if needs[g] == 0:
            row = base[g] + squeeze(1 << g, g) * (ptr[g + 1] - ptr[g])
            for v in range(ptr[g], ptr[g + 1]):
                table[row + v - ptr[g]] = leave[v]
    turned = cost.T.copy()
    gathered = np.empty((n, n), dtype=np.int32)
    length = np.empty(n, dtype=np.int32)
    for high in range(1 << (m - low)):
        # columns: all nodes of the low clusters, then those of the clusters in `high`
        width = ptr[low]
        for v in range(n):
            for u in range(width):
                gathered[v, u] = turned[v, u]
        for h in range(low, m):
            if (high >> (h - low)) & 1:
                for v in range(n):
                    for u in range(ptr[h], ptr[h + 1]):
                        gathered[v, width + u - ptr[h]] = turned[v, u]
                width += ptr[h + 1] - ptr[h]
        for part in range(1 << low):
            mask = (high << low) | part
            alive = False
            at = 0
            for h in range(m):
                size = ptr[h + 1] - ptr[h]
                if (mask >> h) & 1:
                    row = base[h] + squeeze(mask, h) * size
                    for u in range(size):
                        value = table[row + u]
                        length[at + u] = value
                        alive |= value < inf
                    at += size
                elif h < low:
                    for u in range(size):
                        length[at + u] = inf
                    at += size
            if not alive:
                continue
            for g in range(m):
                if (mask >> g) & 1 or (needs[g] & ~mask) != 0:
                    continue
                row = base[g] + squeeze(mask | (1 << g), g) * (ptr[g + 1] - ptr[g])
                v = ptr[g]
                if (ptr[g + 1] - v) & 1:
                    best = inf
                    source = gathered[v]
                    for u in range(width):
                        best = min(best, np.int32(length[u] + source[u]))
                    table[row] = best
                    v += 1
                while v < ptr[g + 1]:  # two at a time share the lengths
                    best, second = inf, inf
                    source, other = gathered[v], gathered[v + 1]
                    for u in range(width):
                        best = min(best, np.int32(length[u] + source[u]))
                        second = min(second, np.int32(length[u] + other[u]))
                    table[row + v - ptr[g]] = best
                    table[row + v + 1 - ptr[g]] = second
                    v += 2


@njit
def trace(cost, ptr, back, base, table):  # type: ignore[no-untyped-def]
    """Optimal cost and nodes (m,) from a filled table; `back` (n,) leads to the depot."""
    m = len(ptr) - 1
    inf = np.int32(1 << 29)
    mask = (1 << m) - 1
    nodes = np.full(m, -1, dtype=np.int64)
    best = inf
    at, of = -1, -1
    for g in range(m):
        row = base[g] + squeeze(mask, g) * (ptr[g + 1] - ptr[g])
        for v in range(ptr[g], ptr[g + 1]):
            value = np.int32(table[row + v - ptr[g]] + back[v])
            if value < best:
                best, at, of = value, v, g
    if at < 0:
        return inf, nodes
    for k in range(m - 1, -1, -1):
        nodes[k] = at
        if k == 0:
            break
        wanted = table[base[of] + squeeze(mask, of) * (ptr[of + 1] - ptr[of]) + at - ptr[of]]
        mask &= ~(1 << of)
        to = at
        found = False
        for h in range(m):
            if not (mask >> h) & 1 or found:
                continue
            row = base[h] + squeeze(mask, h) * (ptr[h + 1] - ptr[h])
            for u in range(ptr[h], ptr[h + 1]):
                if table[row + u - ptr[h]] + cost[u, to] == wanted and wanted < inf:
                    at, of, found = u, h, True
                    break
    return best, nodes
