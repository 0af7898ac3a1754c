"""Bounded dynamic programming: the default exact method.

With the cost of a good tour as the cut: Lagrangian multipliers on the walk relaxation, then on
ng-route relaxations with growing memories, removal of the nodes and arcs that cannot be in a
better tour, and a search over the (set of clusters, node) states that the bounds leave. Where the
states do not fit into the limit, the answer is the proven lower bound.

States are kept in arrays, one layer of set sizes at a time, and found by open-addressing hashing.
One is dropped when its length plus the ng-route bound of its completion cannot beat the cut.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dmoc.jit import njit
from sequencing.gtsp.normalise import NormalForm
from sequencing.gtsp.relaxation import Relaxation
from sequencing.gtsp.rooted import Rooted, rooted_problems

BYTES_A_STATE = 44  # mask, node, length, parent and its share of the hash table
LAYERS = 12  # full ones at most: a search ends, however many clusters there are


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


def search_states(relaxation: Relaxation, limit: int) -> tuple[bool, np.ndarray | None]:
    """(finished, nodes): the best tour cheaper than the cut, None if there is none.

    At most `limit` states are kept in one layer and 12 times that in all; beyond that the search
    gives up unfinished.
    The nodes (m,) are those of the rooted problem.
    """
    r = relaxation
    r.fill_memory()
    price, leave = r.backward(r.lam)
    firsts = (
        leave + r.togo[1][r.tables.offset[r.cluster] + np.arange(len(r.node)) - r.ptr[r.cluster]]
    )
    start = np.flatnonzero((firsts < r.limit) & (r.needs[r.cluster] == 0))
    mask = np.uint64(1) << r.cluster[start].astype(np.uint64)
    node = start.astype(np.int32)
    layer = Layer(mask, node, leave[start], np.zeros_like(node))
    kept = [(layer.node, layer.parent)]
    needs = r.needs.astype(np.uint64)
    total = len(start)
    for k in range(1, r.m):
        room = min(max(4096, 4 * len(layer.node)), limit)
        while True:
            slots = np.empty(1 << int(2 * room - 1).bit_length(), dtype=np.int32)
            out = Layer.of(room)
            known = (r.arcs, price, r.cluster, needs, r.tables, r.togo[k + 1], r.limit)
            count = expand(*known, layer, slots, out)
            if count >= 0:
                break
            if room >= limit:
                return False, None
            room = min(4 * room, limit)
        layer = Layer(*(part[:count].copy() for part in out))
        kept.append((layer.node, layer.parent))
        total += count
        if count == 0:
            return True, None
        if total > LAYERS * limit:
            return False, None
    ends = layer.length + r.back[layer.node]
    at = int(np.argmin(ends)) if len(ends) else -1
    if at < 0 or not ends[at] < r.limit:
        return True, None
    path = []
    for k in range(r.m - 1, -1, -1):
        node, parent = kept[k]
        path.append(int(node[at]))
        at = int(parent[at])
    return True, r.node[np.array(path[::-1])]


LARGEST_SETS = 63  # clusters in one 64-bit mask
FIRST_STEPS, NG_STEPS, LATER_STEPS = (8, 16), 40, 15
FIRST_STATES = 100_000  # in one layer of the first search
STATES_A_ROW = 20  # later: a search that costs about as much as the next relaxation
LARGEST_LAYER = 8_000_000  # states; some minutes at most


def bounded_dp(
    form: NormalForm,
    upper: float,
    tolerance: float,
    states: int | None,
    memory_bytes: int,
) -> tuple[np.ndarray | None, float]:
    """A tour of the normal form cheaper than `upper` (None: none was found) and a lower bound.

    upper is the cost of a known tour (inf: none); a tour counts as cheaper only by more than
    `tolerance`. states: most states in one layer (0: relaxations only, None: what
    `memory_bytes` allows). The lower bound is proven; it is ≥ min(upper, answer) − tolerance
    where the search was complete. Where one rooted problem stays open, the others are only
    bounded, and only as far as that matters.
    """
    most = min(LARGEST_LAYER, memory_bytes // (2 * BYTES_A_STATE)) if states is None else states
    best: np.ndarray | None = None
    bound = math.inf
    multipliers: np.ndarray | None = None
    for rooted in rooted_problems(form):
        enough = bound if bound < upper - tolerance else math.inf
        nodes, low, multipliers = _solve_rooted(
            rooted, upper - tolerance, most if enough == math.inf else 0, enough, multipliers
        )
        if nodes is not None:
            full = np.concatenate([[rooted.root], rooted.node[nodes]])
            cost = math.fsum(form.cost[full, np.roll(full, -1)])
            if cost < upper:
                best, upper = full, cost
        bound = min(bound, low)
    return best, min(bound, upper) if math.isfinite(upper) else bound


def _solve_rooted(
    rooted: Rooted, cut: float, most: int, enough: float, multipliers: np.ndarray | None
) -> tuple[np.ndarray | None, float, np.ndarray]:
    """(better nodes or None, proven bound, multipliers) of one rooted problem.

    Without states (`most` 0) it ends after the first relaxation, or at a bound of `enough`.
    """
    relaxation = Relaxation(rooted, cut, multipliers)
    relaxation.walk_phase()
    for steps in FIRST_STEPS:  # the first few, with all arcs, are the dearest
        relaxation.ng_phase(steps)
    steps = NG_STEPS
    while not relaxation.closed and relaxation.bound < enough:
        relaxation.ng_phase(steps)
        steps = LATER_STEPS
        if relaxation.closed or most == 0:
            break
        rows = relaxation.rows_a_position
        grown = relaxation.enlarge_memory()
        if relaxation.m <= LARGEST_SETS:
            limit = min(most, max(FIRST_STATES, STATES_A_ROW * rows)) if grown else most
            finished, nodes = search_states(relaxation, limit)
            if finished and nodes is None:
                return None, cut, relaxation.lam
            if finished and nodes is not None:
                return nodes, _rooted_cost(rooted, nodes), relaxation.lam
        if not grown:
            break
    return None, cut if relaxation.closed else min(relaxation.bound, cut), relaxation.lam


def _rooted_cost(rooted: Rooted, nodes: np.ndarray) -> float:
    travel = rooted.cost[nodes[:-1], nodes[1:]]
    return math.fsum([rooted.leave[nodes[0]], *travel, rooted.back[nodes[-1]]])
