"""Dynamic programming over (set of clusters, last node), one layer of set sizes at a time.

States are kept in arrays and found by open-addressing hashing. A state is dropped when its
length plus the ng-route bound of its completion cannot beat the cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dmoc.jit import njit


class Layer(NamedTuple):
    """States of one set size: clusters visited as bits, last node, length so far, and the number of
    the state before in its layer."""

    mask: np.ndarray
    node: np.ndarray
    length: np.ndarray
    parent: np.ndarray

    @staticmethod
    def of(room: int) -> Layer:
        """Memory for `room` states."""
        kinds = (np.uint64, np.int32, np.float64, np.int32)
        return Layer(*(np.empty(room, dtype=kind) for kind in kinds))


@njit
def expand(  # type: ignore[no-untyped-def]
    arcs, price, cluster, needs, memories, togo, cut, layer, slot, out
):
    """States `out` of the next layer from `layer`; returns their number, −1 if there is no room.

    Arcs, memories and the cost-to-go at the next position (T + n,) as in `ng_backward`; slot
    (2^p,) int32 work space, at least twice as long as the outputs.
    """
    link, to, group = arcs
    members, bits, _, rows = memories
    mask, node, length, _ = layer
    out_mask, out_node, out_length, out_parent = out
    wrap = np.uint64(len(slot) - 1)
    one = np.uint64(1)
    slot[:] = -1
    found = 0
    room = len(out_mask)
    for s in range(len(node)):
        visited = mask[s]
        u = node[s]
        h = cluster[u]
        memory = 0
        for b in range(bits[h]):
            if (visited >> np.uint64(members[h, b])) & one:
                memory |= 1 << b
        base = rows[h, memory]
        come = length[s]
        for a in range(link[u], link[u + 1]):
            g = group[a]
            v = to[a]
            value = come + price[a]
            if not value + togo[base[g] + v] < cut:
                continue
            bit = one << np.uint64(g)
            if visited & bit or (needs[g] & ~visited) != 0:
                continue
            union = visited | bit
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
                at = (at + one) & wrap
    return found
