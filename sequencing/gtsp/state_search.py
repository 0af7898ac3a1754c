"""The exact search over states that the bounds leave, layer by layer."""

from __future__ import annotations

import numpy as np

from sequencing.gtsp.relaxation import Relaxation

BYTES_A_STATE = 44  # mask, node, length, parent and its share of the hash table
LAYERS = 12  # full ones at most: a search ends, however many clusters there are


def search_states(relaxation: Relaxation, limit: int) -> tuple[bool, np.ndarray | None, int]:
    """(finished, nodes, states): the best tour cheaper than the cut, None if there is none.

    At most `limit` states are kept in one layer and 12 times that in all; beyond that the search
    gives up unfinished.
    The nodes (m,) are those of the rooted problem; `states` counts all that were kept.
    """
    from sequencing.gtsp.state_kernel import expand

    r = relaxation
    r._memory_tables()
    price, leave = r.completion()
    firsts = leave + r.togo[1][r.offset[r.cluster] + np.arange(len(r.node)) - r.ptr[r.cluster]]
    start = np.flatnonzero((firsts < r.limit) & (r.needs[r.cluster] == 0))
    mask = np.uint64(1) << r.cluster[start].astype(np.uint64)
    node = start.astype(np.int32)
    length = leave[start]
    nodes_of = [node]
    parents_of: list[np.ndarray] = []
    needs = r.needs.astype(np.uint64)
    total = len(start)
    for k in range(1, r.m):
        room = min(max(4096, 4 * len(node)), limit)
        while True:
            slots = np.empty(1 << int(2 * room - 1).bit_length(), dtype=np.int32)
            out_mask = np.empty(room, dtype=np.uint64)
            out_node = np.empty(room, dtype=np.int32)
            out_length = np.empty(room)
            out_parent = np.empty(room, dtype=np.int32)
            count = expand(
                r.link, r.to, r.group, price, r.cluster, needs, r.members, r.bits, r.rows,
                r.togo[k + 1], r.limit, mask, node, length, len(node), slots, out_mask, out_node,
                out_length, out_parent,
            )  # fmt: skip
            if count >= 0:
                break
            if room >= limit:
                return False, None, total
            room = min(4 * room, limit)
        mask, node, length = out_mask[:count].copy(), out_node[:count].copy(), out_length[:count]
        nodes_of.append(node)
        parents_of.append(out_parent[:count].copy())
        total += count
        if count == 0:
            return True, None, total
        if total > LAYERS * limit:
            return False, None, total
    ends = length + r.back[node]
    at = int(np.argmin(ends)) if len(ends) else -1
    if at < 0 or not ends[at] < r.limit:
        return True, None, total
    path = []
    for k in range(r.m - 1, -1, -1):
        path.append(int(nodes_of[k][at]))
        if k:
            at = int(parents_of[k - 1][at])
    return True, r.node[np.array(path[::-1])], total
