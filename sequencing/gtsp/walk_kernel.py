"""Walk relaxation: shortest walks of exactly m visits, clusters may repeat.

With multipliers λ on the clusters, an edge into v of cluster g costs c(u, v) − λ_g; then

    bound = min over walks + Σ λ_g,   since a tour visits every cluster once.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit


@njit
def walk_forward(cost, leave, ptr, early, late, out):  # type: ignore[no-untyped-def]
    """out (m+1, n): out[k, v] = least cost of k visits from the root, the last one at v.

    cost (n, n) and leave (n,) with multipliers already subtracted; early, late (m,): first and
    last position at which a cluster can stand.
    """
    m = len(ptr) - 1
    n = ptr[m]
    out[:] = np.inf
    for g in range(m):
        if early[g] <= 1:
            for v in range(ptr[g], ptr[g + 1]):
                out[1, v] = leave[v]
    for k in range(1, m):
        here = out[k]
        there = out[k + 1]
        for h in range(m):
            if not early[h] <= k <= late[h]:
                continue
            for u in range(ptr[h], ptr[h + 1]):
                length = here[u]
                if length == np.inf:
                    continue
                row = cost[u]
                for v in range(n):
                    value = length + row[v]
                    there[v] = value if value < there[v] else there[v]
        for g in range(m):
            if not early[g] <= k + 1 <= late[g]:
                for v in range(ptr[g], ptr[g + 1]):
                    there[v] = np.inf


@njit
def walk_backward(turned, back, ptr, early, late, out):  # type: ignore[no-untyped-def]
    """out (m+1, n): out[k, v] = least cost from v at position k through m visits to the root.

    turned (n, n) is the transposed cost with multipliers, back (n,) the way to the root.
    """
    m = len(ptr) - 1
    n = ptr[m]
    out[:] = np.inf
    for g in range(m):
        if late[g] >= m:
            for v in range(ptr[g], ptr[g + 1]):
                out[m, v] = back[v]
    for k in range(m - 1, 0, -1):
        here = out[k]
        for g in range(m):
            if not early[g] <= k + 1 <= late[g]:
                continue
            for v in range(ptr[g], ptr[g + 1]):
                rest = out[k + 1, v]
                if rest == np.inf:
                    continue
                row = turned[v]
                for u in range(n):
                    value = rest + row[u]
                    here[u] = value if value < here[u] else here[u]
        for h in range(m):
            if not early[h] <= k <= late[h]:
                for u in range(ptr[h], ptr[h + 1]):
                    here[u] = np.inf


@njit
def walk_trace(cost, ptr, cluster, forward, back, visits):  # type: ignore[no-untyped-def]
    """Count in visits (m,) how often the best walk visits each cluster; returns its cost."""
    m = len(ptr) - 1
    n = ptr[m]
    visits[:] = 0
    best = np.inf
    at = -1
    for v in range(n):
        if forward[m, v] + back[v] < best:
            best = forward[m, v] + back[v]
            at = v
    if at < 0:
        return best
    for k in range(m, 0, -1):
        visits[cluster[at]] += 1
        if k == 1:
            break
        least = np.inf
        origin = -1
        for u in range(n):
            value = forward[k - 1, u] + cost[u, at]
            if value < least:
                least = value
                origin = u
        at = origin
    return best
