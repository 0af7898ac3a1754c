"""Two trees that grow towards each other, and shortcuts, without leaving compiled code.

Trees: J. J. Kuffner, S. M. LaValle, RRT-Connect, ICRA 2000. Configurations are scaled by `scale`
(n,), so that lengths are metres of a typical robot point. Random numbers come from the caller.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.jit import njit
from planning.kernels.segment import segment_contact

__all__ = ["grow_trees", "shorten"]

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
    scan: Any, nodes: Any, parent: Any, count: int, scale: Any, target: Any, reach_m: float,
    blocked: Any,
) -> int:  # fmt: skip
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
    scan: Any, scale: Any, reach_m: float, drawn: Any, nodes: Any, parent: Any, count: Any,
    meeting: Any, blocked: Any,
) -> tuple[int, int]:  # fmt: skip
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


@njit(plain=True, inner=True)
def _drop_knots(scan: Any, path: Any, count: int) -> tuple[int, int]:
    """Remove interior knots whose neighbours see each other, from the start on: knots, checks."""
    kept, checks = 0, 0
    for k in range(1, count - 1):
        checks += 1
        if segment_contact(scan, path[kept], path[k + 1], True) >= 0:
            kept += 1
            for j in range(path.shape[1]):
                path[kept, j] = path[k, j]
    kept += 1
    for j in range(path.shape[1]):
        path[kept, j] = path[count - 1, j]
    return kept + 1, checks


@njit(plain=True)
def shorten(
    scan: Any, scale: Any, path: Any, count: int, drawn: Any, patience: int, along: Any, ends: Any
) -> tuple[int, int]:
    """As `planning.shortcut.shortcut`, in place: knots and checks.

    `path` (count + 2 K, n) has room for two more knots a try; `drawn` (K, 2) in [0, 1), sorted by
    the caller; `along` (rows of path,) and `ends` (2, n) are workspace.
    """
    n = path.shape[1]
    count, checks = _drop_knots(scan, path, count)
    since = 0
    for k in range(drawn.shape[0]):
        if count <= 2 or since >= patience:
            break
        since += 1
        along[0] = 0.0
        for i in range(1, count):
            total = 0.0
            for j in range(n):
                step = (path[i, j] - path[i - 1, j]) * scale[j]
                total += step * step
            along[i] = along[i - 1] + np.sqrt(total)
        whole = along[count - 1]
        lo, hi = drawn[k, 0] * whole, drawn[k, 1] * whole
        first = 0
        while first < count - 2 and along[first + 1] <= lo:
            first += 1
        last = first
        while last < count - 2 and along[last + 1] <= hi:
            last += 1
        if first == last:
            continue
        total = 0.0
        for side in range(2):
            i, at = (first, lo) if side == 0 else (last, hi)
            length = along[i + 1] - along[i]
            share = (at - along[i]) / length if length > 1e-12 else 0.0
            for j in range(n):
                ends[side, j] = path[i, j] + share * (path[i + 1, j] - path[i, j])
        for j in range(n):
            step = (ends[1, j] - ends[0, j]) * scale[j]
            total += step * step
        if hi - lo - np.sqrt(total) <= 1e-3 * whole:
            continue
        checks += 1
        if segment_contact(scan, ends[0], ends[1], False) >= 0:
            continue
        # Knots first + 1 … last give way to the two ends.
        shift = 2 - (last - first)
        if shift > 0:
            for i in range(count - 1, last, -1):
                for j in range(n):
                    path[i + shift, j] = path[i, j]
        elif shift < 0:
            for i in range(last + 1, count):
                for j in range(n):
                    path[i + shift, j] = path[i, j]
        count += shift
        for j in range(n):
            path[first + 1, j], path[first + 2, j] = ends[0, j], ends[1, j]
        since = 0
    count, more = _drop_knots(scan, path, count)
    return count, checks + more
