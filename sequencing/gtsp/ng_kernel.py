"""ng-route relaxation: walks of m visits that may return to a cluster only after forgetting it.

Every cluster g has a neighbourhood N_g of clusters it can remember (Baldacci, Mingozzi, Roberti
2011). A state is (position k, node v, memory P ⊆ N_g(v)); going on to v' of cluster g' ∉ P leads
to the memory (P ∪ {g}) ∩ N_g'. A tour is such a walk, so its minimum is a lower bound, and the
least cost-to-go from (k, v, S ∩ N) bounds every completion of a partial tour through the set S.

States of one position are stored as one row: cluster g begins at offset[g], memory P of g at
offset[g] + P · size_g, then its nodes.
"""

from __future__ import annotations

import numpy as np

from sequencing.gtsp.jit import jit


@jit
def memory_steps(members, bits, needs, steps):  # type: ignore[no-untyped-def]
    """steps[h, g, P]: the memory on arrival in g from h with memory P, −1 where g is remembered.

    members (m, B) clusters of N_g by bit, bits (m,) their number, needs (m,) masks of clusters
    that must come before. A cluster that must come after g is treated as visited too late: going
    from h to g with g before h is refused.
    """
    m = len(bits)
    for h in range(m):
        for g in range(m):
            for memory in range(1 << bits[h]):
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
                        for i in range(bits[g]):
                            if members[g, i] == known:
                                arrival |= 1 << i
                steps[h, g, memory] = -1 if refused else arrival


@jit
def ng_backward(  # type: ignore[no-untyped-def]
    turned, back, ptr, early, late, bits, offset, steps, forward, cut, out
):
    """out (m+1, T): least cost-to-go of every state; states that cannot beat `cut` are +inf.

    turned (n, n) transposed cost with multipliers; back (n,) to the root; forward (m+1, n) the
    walk bound of what came before. Returns nothing; the bound is `ng_first`.
    """
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
        out[k] = np.inf
        for h in range(m):
            if not early[h] <= k <= late[h]:
                continue
            alive = False
            for u in range(ptr[h], ptr[h + 1]):
                alive |= forward[k, u] < cut
            if not alive:
                continue
            size = ptr[h + 1] - ptr[h]
            first = ptr[h]
            for memory in range(1 << bits[h]):
                count = 0
                for b in range(bits[h]):
                    count += (memory >> b) & 1
                if count > k - 1:
                    continue
                row = offset[h] + memory * size
                here = out[k, row : row + size]
                for g in range(m):
                    arrival = steps[h, g, memory]
                    if arrival < 0 or not early[g] <= k + 1 <= late[g]:
                        continue
                    width = ptr[g + 1] - ptr[g]
                    there = offset[g] + arrival * width
                    for v in range(width):
                        rest = out[k + 1, there + v]
                        if rest == np.inf:
                            continue
                        source = turned[ptr[g] + v, first : first + size]
                        for u in range(size):
                            value = rest + source[u]
                            here[u] = value if value < here[u] else here[u]
                for u in range(size):
                    if not forward[k, first + u] + here[u] < cut:
                        here[u] = np.inf


@jit
def ng_trace(cost, leave, ptr, offset, steps, togo, path):  # type: ignore[no-untyped-def]
    """Cost of the best ng-route, and its clusters in path (m,), from `ng_backward`'s table."""
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
    memory = 0
    for k in range(1, m + 1):
        path[k - 1] = of
        if k == m:
            break
        least = np.inf
        next_at, next_of, next_memory = -1, -1, 0
        for g in range(m):
            arrival = steps[of, g, memory]
            if arrival < 0:
                continue
            there = offset[g] + arrival * (ptr[g + 1] - ptr[g]) - ptr[g]
            for v in range(ptr[g], ptr[g + 1]):
                value = cost[at, v] + togo[k + 1, there + v]
                if value < least:
                    least, next_at, next_of, next_memory = value, v, g, arrival
        at, of, memory = next_at, next_of, next_memory
    return best


@jit
def ng_arcs(  # type: ignore[no-untyped-def]
    cost, leave, ptr, early, late, bits, offset, steps, togo, cut, arc, first
):
    """Least cost of an ng-route through each arc: arc (n, n), first (n,) as the first visit.

    An arc whose value is not below `cut` is in no tour that beats it. Runs forward over the
    states that `ng_backward` left alive.
    """
    m = len(ptr) - 1
    total = togo.shape[1]
    arc[:] = np.inf
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
        for h in range(m):
            size = ptr[h + 1] - ptr[h]
            for memory in range(1 << bits[h]):
                row = offset[h] + memory * size
                for u in range(size):
                    length = here[row + u]
                    if length == np.inf:
                        continue
                    source = cost[ptr[h] + u]
                    through = arc[ptr[h] + u]
                    for g in range(m):
                        arrival = steps[h, g, memory]
                        if arrival < 0 or not early[g] <= k + 1 <= late[g]:
                            continue
                        width = ptr[g + 1] - ptr[g]
                        target = offset[g] + arrival * width
                        for v in range(width):
                            value = length + source[ptr[g] + v]
                            whole = value + togo[k + 1, target + v]
                            if whole < cut:
                                if whole < through[ptr[g] + v]:
                                    through[ptr[g] + v] = whole
                                if value < there[target + v]:
                                    there[target + v] = value
        here, there = there, here
