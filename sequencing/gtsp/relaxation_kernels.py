"""ng-route relaxation: walks of m visits that may return to a cluster only after forgetting it.

Every cluster g has a neighbourhood N_g of clusters it can remember (Baldacci, Mingozzi, Roberti
2011). A state is (position k, node v, memory P ⊆ N_g(v)); going on to v' of cluster g' ∉ P leads
to the memory (P ∪ {g}) ∩ N_g'. A tour is such a walk, so its minimum is a lower bound, and the
least cost-to-go from (k, v, S ∩ N) bounds every completion of a partial tour through the set S.

States of one position are stored as one row of T numbers: cluster g begins at offset[g], memory P
of g at offset[g] + P · size_g, then its nodes; n numbers +inf follow, where refused steps point.
Only the arcs that are left are run through.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dmoc.jit import njit


class Arcs(NamedTuple):
    """link (n+1,): those out of u are link[u] … link[u+1]−1; to, group (A,) end and its cluster."""

    link: np.ndarray
    to: np.ndarray
    group: np.ndarray


class Memory(NamedTuple):
    """members (m, B) clusters of N_g by bit, bits (m,) their number, offset (m,) as above;
    rows[h, P, g]: where node 0 would stand in the row on arrival in g from h with memory P."""

    members: np.ndarray
    bits: np.ndarray
    offset: np.ndarray
    rows: np.ndarray


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
                # Over all nodes without asking where they may stand: a loop without branches is
                # vectorised, and what stands too early or too late is crossed out afterwards.
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


@njit
def memory_rows(memories, needs, ptr, total):  # type: ignore[no-untyped-def]
    """Fill the rows of `memories`.

    A node v of g then stands at rows[h, P, g] + v; refused steps get `total`, the first +inf.
    needs (m,) are masks of clusters that must come before. A cluster that must come after g is
    treated as visited too late: going from h to g with g before h is refused.
    """
    members, bits, offset, rows = memories
    m = len(bits)
    for h in range(m):
        for memory in range(1 << bits[h]):
            for g in range(m):
                refused = g == h or (needs[h] >> g) & 1 == 1
                arrival = 0
                for i in range(bits[g]):
                    if members[g, i] == h:
                        arrival |= 1 << i
                for b in range(bits[h]):
                    if (memory >> b) & 1:
                        known = members[h, b]
                        if known == g or (needs[known] >> g) & 1 == 1:
                            refused = True
                            break
                        for i in range(bits[g]):
                            if members[g, i] == known:
                                arrival |= 1 << i
                here = offset[g] + arrival * (ptr[g + 1] - ptr[g]) - ptr[g]
                rows[h, memory, g] = total if refused else here


@njit
def ng_backward(  # type: ignore[no-untyped-def]
    arcs, price, back, ptr, early, late, memories, forward, cut, out
):
    """out (m+1, T + n): least cost-to-go of every state; states that cannot beat `cut` are +inf.

    price (A,) costs of the arcs with multipliers; back (n,) to the root; forward (m+1, n) the walk
    bound of what came before.
    """
    link, to, group = arcs
    _, bits, offset, rows = memories
    m = len(ptr) - 1
    out[m] = np.inf
    for g in range(m):
        size = ptr[g + 1] - ptr[g]
        if late[g] < m:
            continue
        for memory in range(1 << bits[g]):
            row = offset[g] + memory * size
            for v in range(size):
                if forward[m, ptr[g] + v] + back[ptr[g] + v] < cut:
                    out[m, row + v] = back[ptr[g] + v]
    for k in range(m - 1, 0, -1):
        here = out[k]
        there = out[k + 1]
        here[:] = np.inf
        for h in range(m):
            if not early[h] <= k <= late[h]:
                continue
            size = ptr[h + 1] - ptr[h]
            for memory in range(1 << bits[h]):
                count = 0
                for b in range(bits[h]):
                    count += (memory >> b) & 1
                # Before position k there were k − 1 visits: more cannot be remembered.
                if count > k - 1:
                    continue
                row = offset[h] + memory * size - ptr[h]
                base = rows[h, memory]
                for u in range(ptr[h], ptr[h + 1]):
                    come = forward[k, u]
                    if come == np.inf:  # (≥ cut would not do: what follows may be negative)
                        continue
                    best = np.inf
                    for a in range(link[u], link[u + 1]):
                        value = price[a] + there[base[group[a]] + to[a]]
                        best = value if value < best else best
                    if come + best < cut:
                        here[row + u] = best


@njit
def ng_trace(arcs, price, leave, ptr, memories, togo, path):  # type: ignore[no-untyped-def]
    """Cost of the best ng-route, and its clusters in path (m,), from `ng_backward`'s table."""
    link, to, group = arcs
    _, _, offset, rows = memories
    m = len(ptr) - 1
    best = np.inf
    at, of = -1, -1
    for g in range(m):
        for v in range(ptr[g], ptr[g + 1]):
            value = leave[v] + togo[1, offset[g] + v - ptr[g]]
            if value < best:
                best, at, of = value, v, g
    if at < 0:
        return best
    memory = 0  # a walk begins remembering nothing
    for k in range(1, m + 1):
        path[k - 1] = of
        if k == m:
            break
        base = rows[of, memory]
        least = np.inf
        next_at, next_of, place = -1, -1, 0
        for a in range(link[at], link[at + 1]):
            spot = base[group[a]] + to[a]
            value = price[a] + togo[k + 1, spot]
            if value < least:
                least, next_at, next_of, place = value, to[a], group[a], spot
        at, of = next_at, next_of
        memory = (place - offset[of]) // (ptr[of + 1] - ptr[of])  # the row says it, see above
    return best


@njit
def ng_arcs(arcs, price, leave, ptr, memories, togo, cut, through, first):  # type: ignore[no-untyped-def]
    """Least cost of an ng-route through each arc: through (A,), first (n,) as the first visit.

    An arc whose value is not below `cut` is in no tour that beats it. Runs forward over the
    states that `ng_backward` left alive.
    """
    link, to, group = arcs
    _, bits, offset, rows = memories
    m = len(ptr) - 1
    total = togo.shape[1]
    through[:] = np.inf
    first[:] = np.inf
    here = np.full(total, np.inf)
    there = np.full(total, np.inf)
    for g in range(m):
        row = offset[g] - ptr[g]
        for v in range(ptr[g], ptr[g + 1]):
            if leave[v] + togo[1, row + v] < cut:
                here[row + v] = leave[v]
                first[v] = leave[v] + togo[1, row + v]
    for k in range(1, m):
        there[:] = np.inf
        rest = togo[k + 1]
        for h in range(m):
            size = ptr[h + 1] - ptr[h]
            for memory in range(1 << bits[h]):
                row = offset[h] + memory * size - ptr[h]
                base = rows[h, memory]
                for u in range(ptr[h], ptr[h + 1]):
                    length = here[row + u]
                    if length == np.inf:
                        continue
                    for a in range(link[u], link[u + 1]):
                        spot = base[group[a]] + to[a]
                        value = length + price[a]
                        whole = value + rest[spot]
                        if whole < cut:
                            through[a] = whole if whole < through[a] else through[a]
                            there[spot] = value if value < there[spot] else there[spot]
        here, there = there, here
