"""Dynamic programming over (set of clusters, last node), one layer of set sizes at a time.

States are kept in arrays and found by open-addressing hashing. A state is dropped when its
length plus the ng-route bound of its completion cannot beat the cut.
"""

from __future__ import annotations

import numpy as np

from sequencing.gtsp.jit import jit


@jit
def expand(  # type: ignore[no-untyped-def]
    cost, ptr, cluster, needs, members, bits, offset, steps, togo, cut,
    mask, node, length, count, slot, out_mask, out_node, out_length, out_parent,
):  # fmt: skip
    """States of the next layer from `count` states; returns their number, −1 if there is no room.

    cost (n, n) with multipliers; togo (T,) cost-to-go at the next position; slot (2^p,) int32
    work space, at least twice as long as the outputs.
    """
    m = len(ptr) - 1
    size = len(slot)
    wrap = np.uint64(size - 1)
    slot[:] = -1
    found = 0
    room = len(out_mask)
    for s in range(count):
        visited = mask[s]
        u = node[s]
        h = cluster[u]
        memory = 0
        for b in range(bits[h]):
            if (visited >> np.uint64(members[h, b])) & np.uint64(1):
                memory |= 1 << b
        base = length[s]
        row = cost[u]
        for g in range(m):
            bit = np.uint64(1) << np.uint64(g)
            if visited & bit or (needs[g] & ~visited) != 0:
                continue
            arrival = steps[h, g, memory]
            if arrival < 0:
                continue
            target = offset[g] + arrival * (ptr[g + 1] - ptr[g]) - ptr[g]
            union = visited | bit
            for v in range(ptr[g], ptr[g + 1]):
                value = base + row[v]
                if not value + togo[target + v] < cut:
                    continue
                key = (union ^ (np.uint64(v + 1) * np.uint64(0x9E3779B97F4A7C15))) * np.uint64(
                    0xBF58476D1CE4E5B9
                )
                at = (key ^ (key >> np.uint64(29))) & wrap
                while True:
                    k = slot[at]
                    if k < 0:
                        if found >= room:
                            return -1
                        slot[at] = found
                        out_mask[found] = union
                        out_node[found] = v
                        out_length[found] = value
                        out_parent[found] = s
                        found += 1
                        break
                    if out_mask[k] == union and out_node[k] == v:
                        if value < out_length[k]:
                            out_length[k] = value
                            out_parent[k] = s
                        break
                    at = (at + np.uint64(1)) & wrap
    return found
