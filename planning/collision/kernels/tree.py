"""Two trees that grow towards each other, without leaving compiled code.

J. J. Kuffner, S. M. LaValle, RRT-Connect, ICRA 2000. Configurations are scaled by `scale`
(n,), so that lengths are metres of a typical robot point. Random numbers come from the caller.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.jit import njit
from planning.collision.kernels.segment import segment_contact

TRAPPED = -1


@njit(plain=True, inner=True)
def _nearest(nodes: Any, count: int, scale: Any, q: Any) -> tuple[int, float]:
    """The node nearest to q, and how far it is."""
    best, at = 1e300, 0
    for k in range(count):
        total = 0.0
        for j in range(q.shape[0]):
            step = (nodes[k, j] - q[j]) * scale[j]
            total += step * step
        if total < best:
            best, at = total, k
    return at, np.sqrt(best)


@njit(plain=True, inner=True)
def _extend(
    scan: Any,
    nodes: Any,
    parent: Any,
    count: int,
    scale: Any,
    target: Any,
    reach_m: float,
    blocked: Any,
) -> int:
    """Adds the node that lies at most `reach_m` from the tree towards `target` (n,), if the way is
    free: its number, or `TRAPPED`.
    """
    near, away = _nearest(nodes, count, scale, target)
    share = 1.0 if away <= reach_m else reach_m / away
    for j in range(target.shape[0]):
        nodes[count, j] = nodes[near, j] + share * (target[j] - nodes[near, j])
    if share == 1.0:  # exactly, so that the trees meet
        for j in range(target.shape[0]):
            nodes[count, j] = target[j]
    hit = segment_contact(scan, nodes[near], nodes[count], True)
    if hit >= 0:
        blocked[hit] += 1
        return TRAPPED
    parent[count] = near
    return count


@njit(plain=True, inner=True)
def _is(nodes: Any, at: int, q: Any) -> bool:
    """Whether a node is exactly q."""
    for j in range(q.shape[0]):  # noqa: SIM110 (numba compiles no all() of a generator)
        if nodes[at, j] != q[j]:
            return False
    return True


@njit(plain=True)
def grow_trees(
    scan: Any,
    scale: Any,
    reach_m: float,
    drawn: Any,
    nodes: Any,
    parent: Any,
    count: Any,
    meeting: Any,
    blocked: Any,
) -> tuple[int, int]:
    """Grow the trees until they meet: iterations and checks; `meeting` (2,) holds the two nodes.

    `nodes` (2, R, n) begin with start and goal, `parent` (2, R) and `count` (2,) say how far they
    are filled; `drawn` (K, n) are the random configurations, one an iteration; `blocked` (M,)
    counts how often a pair was in the way. Without a meeting `meeting[0]` is −1: the draws or the
    room for nodes are used up.
    """
    meeting[0] = meeting[1] = -1
    checks = 0
    room = nodes.shape[1] - 1
    for k in range(drawn.shape[0]):
        tree = k % 2
        other = 1 - tree
        if count[tree] >= room:
            return k, checks
        checks += 1
        new = _extend(
            scan, nodes[tree], parent[tree], count[tree], scale, drawn[k], reach_m, blocked
        )
        if new < 0:
            continue
        count[tree] += 1
        while count[other] < room:
            checks += 1
            met = _extend(
                scan,
                nodes[other],
                parent[other],
                count[other],
                scale,
                nodes[tree, new],
                reach_m,
                blocked,
            )
            if met < 0:
                break
            count[other] += 1
            if _is(nodes[other], met, nodes[tree, new]):
                meeting[tree], meeting[other] = new, met
                return k + 1, checks
    return drawn.shape[0], checks
