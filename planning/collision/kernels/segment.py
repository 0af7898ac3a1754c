"""Touching or not on a straight segment: sampled densely, asking of a pair only what is not known.

A pair that is farther apart than L at one point of the segment is farther than L − v|t − t₀| at any
other one, where v bounds how fast it can approach (Σ_j R_j |Δq_j|, see `kernels.proof`).
So one look at a distant pair answers for many points, and a point at which all pairs are answered
for costs nothing. R_j is bounded for the whole chunk: turning the joints beyond j by δ_k moves no
point of a piece by more than Σ_k R_k δ_k towards or away from axis j.

"Touching" means not proven farther than `inflation`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.jit import njit
from planning.collision.kernels.contact import contact_at
from planning.collision.kernels.distance import FAR, clearly_farther, gjk, outer_bound
from planning.collision.kernels.layout import Query
from planning.collision.kernels.poses import (
    ball_reach,
    joint_poses,
    place_piece,
    relative_motion,
)
from planning.collision.kernels.queries import inside_tubes, place, skipped

CHUNK = 16
RECENT = 8


class Known(NamedTuple):
    """Workspace (M,) for the pairs that a chunk can bring together: their numbers, how far apart
    they were at least, where on the chunk that was, and how fast they can approach. `recent` (4,)
    are pairs that touched lately: they are asked first, which changes no answer to whether anything
    touches.
    """

    recent: npt.NDArray[np.int64]
    pair: npt.NDArray[np.int64]
    bound: npt.NDArray[np.float64]
    place: npt.NDArray[np.float64]
    speed: npt.NDArray[np.float64]


def known_workspace(pairs: int) -> Known:
    """Room for that many piece pairs."""
    recent = np.full(RECENT, -1, dtype=np.int64)
    return Known(
        recent, np.empty(pairs, dtype=np.int64), np.empty(pairs), np.empty(pairs), np.empty(pairs)
    )


class Scan(NamedTuple):
    """What `segment_contact` asks: the scene, by how much pairs are grown, how densely."""

    scene: Query
    inflation_m: float
    levers: Array  # (n,)
    known: Known


@njit(plain=True, inner=True)
def _near_pairs(view: Any, delta: Any, inflation: float, known: Any) -> int:
    """Pairs that can touch while |Δq_j| ≤ δ_j from the configuration that is placed."""
    chain, solids, pose, moving = view.chain, view.solids, view.pose, view.moving
    info, size = solids.info, solids.size
    piece, extra = view.pairs.piece, view.pairs.extra
    above, reach, sweep = chain.above, view.work.reach, view.work.sweep
    n = delta.shape[0]
    for p in range(moving):
        ball_reach(view.work.joints, chain, solids, pose, p, reach[p])
        # From the tip to the base: what the joints beyond add to the distance from an axis.
        beyond = 0.0
        for j in range(n - 1, -1, -1):
            here = reach[p, j]
            if chain.info[j + 1, 1] == 0 and here > 0.0:
                reach[p, j] = here + beyond
            beyond += here * delta[j]
        sweep[p] = 0.0
        for j in range(n):
            sweep[p] += reach[p, j] * delta[j]
    count = 0
    before = -1
    x = y = z = around = 0.0
    for m in range(piece.shape[0]):
        a, b = piece[m, 0], piece[m, 1]
        limit = inflation + extra[m]
        if a != before:  # pairs of one piece stand together
            before = a
            x, y, z = pose[a, 12], pose[a, 13], pose[a, 14]
            around = size[a, 12] + sweep[a]
        # First as if the two moved towards each other: balls alone leave few pairs to look at.
        gap = limit + around + size[b, 12] + sweep[b]
        dx, dy, dz = pose[b, 12] - x, pose[b, 13] - y, pose[b, 14] - z
        if gap < 0.0 or dx * dx + dy * dy + dz * dz > gap * gap:
            continue
        motion = sweep[a] + sweep[b]  # right where one of the two stands still
        if a < moving and b < moving:
            motion = relative_motion(above, info[a, 0], info[b, 0], reach[a], reach[b], delta)
        bound = outer_bound(pose, size, a, b)
        if bound > 0.0 and bound > limit + motion:
            continue
        known.pair[count] = m
        # Balls and boxes bound no depth.
        known.bound[count] = bound if bound > 0.0 else -1e300
        known.place[count], known.speed[count] = 0.5, 2.0 * motion
        count += 1
    return count


@njit(plain=True, inner=True)
def _recent_contact(view: Any, q: Any, inflation: float, recent: Any) -> int:
    """A pair among those that touched lately which touches at q, or −1."""
    solids, pose, work = view.solids, view.pose, view.work
    joint_poses(view.chain.info, view.chain.frame, q, work.joints)
    inside_tubes(view)
    for i in range(recent.shape[0]):
        m = recent[i]
        if m < 0 or skipped(view, m):
            continue
        a, b = view.pairs.piece[m, 0], view.pairs.piece[m, 1]
        for p in (a, b):
            if p < view.moving:
                place_piece(work.joints, solids, p, pose)
        limit = inflation + view.pairs.extra[m]
        if clearly_farther(pose, solids.size, a, b, limit):
            continue
        work.axis[0] = work.axis[1] = work.axis[2] = 0.0
        status = gjk(solids, pose, a, b, work.axis, limit, limit, work.s, work.out)
        if status != FAR and work.out[7] <= limit:
            return m
    return -1


@njit(plain=True, inner=True)
def _remember(recent: Any, m: int) -> int:
    """Pair m, now the first of those that touched lately."""
    at = 0
    while at < recent.shape[0] - 1 and recent[at] != m:
        at += 1
    while at > 0:
        recent[at] = recent[at - 1]
        at -= 1
    recent[0] = m
    return m


@njit(plain=True, inner=True)
def _halving(at: int, total: int) -> int:
    """0 … total (a power of two) in the order total, 0, total/2, total/4, 3 total/4, …"""
    if at == 0:
        return total
    if at == 1:
        return 0
    level = 1
    while 2 * level <= at - 1:
        level *= 2
    # `level` points lie at odd multiples of total / (2 level).
    return total // (2 * level) * (2 * (at - 1 - level) + 1)


@njit(plain=True)
def segment_contact(scan: Any, q0: Any, q1: Any, from_free: bool) -> int:
    """A touching pair on the segment from q0 to q1 (n,), or −1.

    Asked at its ends (not at q0 where that is known to be free, `from_free`) and at inner points so
    many that Σ_j levers_j |Δq_j| is at most 1 from one to the next. Long segments are looked at
    coarsely first, then in chunks of sixteen parts; in a chunk only the pairs that its motion can
    bring together are tested, ends first and then by halving.
    """
    view, inflation, levers, known = scan.scene, scan.inflation_m, scan.levers, scan.known
    solids, pose, work = view.solids, view.pose, view.work
    size, piece, extra = solids.size, view.pairs.piece, view.pairs.extra
    n = q0.shape[0]
    length = 0.0
    for j in range(n):
        length += abs(q1[j] - q0[j]) * levers[j]
    parts = int(np.ceil(length))
    if parts < 1:
        parts = 1
    s, out, axes = work.s, work.out, work.axes
    q, delta, reach = work.q, work.delta, work.reach
    for j in range(n):
        q[j] = q1[j]
    hit = _recent_contact(view, q, inflation, known.recent)
    if hit >= 0:
        return _remember(known.recent, hit)
    chunks = (parts + CHUNK - 1) // CHUNK
    if chunks < 1:
        chunks = 1
    for k in range(chunks, -1, -1):
        if chunks == 1 or (k == 0 and from_free):
            break
        for j in range(n):
            q[j] = q0[j] + k / chunks * (q1[j] - q0[j])
        hit = contact_at(view, q, inflation)
        if hit >= 0:
            return _remember(known.recent, hit)
    for p in range(pose.shape[0]):  # pieces that stand still reach nowhere
        work.sweep[p] = 0.0
        for j in range(n):
            reach[p, j] = 0.0
    # Points of a chunk: its ends (of a short segment only), then halves, quarters, …
    total = 1
    while total * chunks < parts:
        total *= 2
    for j in range(n):
        delta[j] = abs(q1[j] - q0[j]) * (0.5 / chunks)
    for c in range(chunks):
        for j in range(n):
            q[j] = q0[j] + (c + 0.5) / chunks * (q1[j] - q0[j])
        if total > 1:  # else the middle is none of the points
            hit = _recent_contact(view, q, inflation, known.recent)
            if hit >= 0:
                return _remember(known.recent, hit)
        place(view, q)
        found = _near_pairs(view, delta, inflation, known)
        for i in range(found):
            axes[i, 0] = axes[i, 1] = axes[i, 2] = 0.0
        for at in range(total + 1):
            k = _halving(at, total)
            if k == 0 and (chunks > 1 or from_free):
                continue
            if k == total and chunks > 1:
                continue
            t = k / total
            placed = False
            for i in range(found):
                m = known.pair[i]
                limit = inflation + extra[m]
                if known.bound[i] - known.speed[i] * abs(t - known.place[i]) > limit:
                    continue
                if not placed:
                    for j in range(n):
                        q[j] = q0[j] + (c + t) / chunks * (q1[j] - q0[j])
                    place(view, q)
                    placed = True
                if skipped(view, m):
                    continue
                a, b = piece[m, 0], piece[m, 1]
                bound = outer_bound(pose, size, a, b)
                if bound <= 0.0 or bound <= limit:
                    status = gjk(solids, pose, a, b, axes[i], limit, limit, s, out)
                    bound = out[7]
                    if status != FAR and bound <= limit:
                        return _remember(known.recent, m)
                known.bound[i], known.place[i] = bound, t
    return -1
