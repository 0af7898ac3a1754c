"""Touching or not: single configurations, batches and straight segments.

Arguments as in `planning.kernels.scene`. "Touching" means not proven farther than `inflation`.
"""

from __future__ import annotations

from typing import Any

from planning.jit import inner, kernel
from planning.kernels.gjk import FAR, clearly_farther, gjk
from planning.kernels.kinematics import ball_reach, joint_poses, place_pieces, relative_motion
from planning.kernels.scene import inside_tubes, skipped

__all__ = ["first_contacts", "segment_contact"]


@inner
def _contact(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, q: Any, inflation: float,
    tip: Any, lines: Any, exempt: Any, inside: Any, joints: Any, axis: Any, s: Any, out: Any,
) -> int:  # fmt: skip
    """A touching pair at q (n,), or −1."""
    # Arrays taken out of their tuples once: inside the loop each access would count references.
    info, size, verts = solids.info, solids.size, solids.verts
    near_start, near = solids.near_start, solids.near
    piece, extra = pairs.piece, pairs.extra
    joint_poses(chain.info, chain.frame, q, joints)
    place_pieces(joints, info, solids.frame, size, moving, pose)
    inside_tubes(joints, tip, lines, inside)
    for m in range(piece.shape[0]):
        a, b = piece[m, 0], piece[m, 1]
        limit = inflation + extra[m]
        if clearly_farther(pose, size, a, b, limit) or skipped(exempt, inside, m):
            continue
        axis[0] = axis[1] = axis[2] = 0.0
        status = gjk(
            info, size, verts, near_start, near, pose, a, b, axis, limit, limit, s, out
        )  # fmt: skip
        if status != FAR and out[7] <= limit:
            return m
    return -1


@kernel
def first_contacts(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, q: Any, inflation: float,
    tip: Any, lines: Any, exempt: Any, inside: Any, work: Any, first: Any,
) -> None:  # fmt: skip
    """first[k] = index of a touching pair at q[k] (K, n), or −1."""
    joints, s, out, axis = work.joints, work.s, work.out, work.axis
    for k in range(q.shape[0]):
        first[k] = _contact(
            chain, solids, pairs, pose, moving, q[k], inflation, tip, lines, exempt, inside,
            joints, axis, s, out,
        )  # fmt: skip


CHUNK = 16


@inner
def _near_chunk(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, joints: Any, delta: Any,
    inflation: float, reach: Any, sweep: Any, chosen: Any,
) -> int:  # fmt: skip
    """Pairs that can touch while |Δq_j| ≤ δ_j from the configuration in `joints` and `pose`."""
    info, size = solids.info, solids.size
    piece, extra = pairs.piece, pairs.extra
    above = chain.above
    for p in range(moving):
        ball_reach(joints, chain.info, above, info[p, 0], pose, size[p, 12], p, reach[p])
        sweep[p] = 0.0
        for j in range(delta.shape[0]):
            sweep[p] += reach[p, j] * delta[j]
    count = 0
    for m in range(piece.shape[0]):
        a, b = piece[m, 0], piece[m, 1]
        # First as if the two moved towards each other: balls alone leave few pairs to look at.
        gap = inflation + extra[m] + sweep[a] + (sweep[b] if b < moving else 0.0)
        if gap >= 0.0:
            gap += size[a, 12] + size[b, 12]
            dx = pose[b, 12] - pose[a, 12]
            dy = pose[b, 13] - pose[a, 13]
            dz = pose[b, 14] - pose[a, 14]
            if dx * dx + dy * dy + dz * dz > gap * gap:
                continue
        motion = relative_motion(above, info[a, 0], info[b, 0], reach[a], reach[b], delta)
        if not clearly_farther(pose, size, a, b, inflation + extra[m] + motion):
            chosen[count] = m
            count += 1
    return count


@inner
def _chosen_contact(
    solids: Any, pairs: Any, pose: Any, chosen: Any, count: int, inflation: float, exempt: Any,
    inside: Any, axes: Any, s: Any, out: Any,
) -> int:  # fmt: skip
    """A touching pair among the chosen ones, at the poses given, or −1."""
    info, size, verts = solids.info, solids.size, solids.verts
    near_start, near = solids.near_start, solids.near
    piece, extra = pairs.piece, pairs.extra
    for i in range(count):
        m = chosen[i]
        a, b = piece[m, 0], piece[m, 1]
        limit = inflation + extra[m]
        if clearly_farther(pose, size, a, b, limit) or skipped(exempt, inside, m):
            continue
        status = gjk(
            info, size, verts, near_start, near, pose, a, b, axes[i], limit, limit, s, out
        )  # fmt: skip
        if status != FAR and out[7] <= limit:
            return m
    return -1


@inner
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


@kernel
def segment_contact(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, q0: Any, q1: Any, parts: int,
    inflation: float, tip: Any, lines: Any, exempt: Any, inside: Any, work: Any,
) -> int:  # fmt: skip
    """A touching pair on the segment, at its ends and at least parts − 1 inner points, or −1.

    Long segments are looked at coarsely first, then in chunks of sixteen parts; in a chunk only
    the pairs that its motion can bring together are tested, ends first and then by halving.
    """
    n = q0.shape[0]
    joints, s, out, axis = work.joints, work.s, work.out, work.axis
    q, delta, reach, chosen, axes = work.q, work.delta, work.reach, work.order, work.axes
    chunks = (parts + CHUNK - 1) // CHUNK
    if chunks < 1:
        chunks = 1
    for k in range(chunks, -1, -1):
        if chunks == 1:
            break
        for j in range(n):
            q[j] = q0[j] + k / chunks * (q1[j] - q0[j])
        hit = _contact(
            chain, solids, pairs, pose, moving, q, inflation, tip, lines, exempt, inside, joints,
            axis, s, out,
        )  # fmt: skip
        if hit >= 0:
            return hit
    for p in range(pose.shape[0]):  # pieces that stand still reach nowhere
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
        joint_poses(chain.info, chain.frame, q, joints)
        place_pieces(joints, solids.info, solids.frame, solids.size, moving, pose)
        found = _near_chunk(
            chain,
            solids,
            pairs,
            pose,
            moving,
            joints,
            delta,
            inflation,
            reach,
            work.sweep,
            chosen,
        )
        for i in range(found):
            axes[i, 0] = axes[i, 1] = axes[i, 2] = 0.0
        for at in range(total + 1):
            k = _halving(at, total)
            if chunks == 1 or 0 < k < total:
                for j in range(n):
                    q[j] = q0[j] + (c + k / total) / chunks * (q1[j] - q0[j])
                joint_poses(chain.info, chain.frame, q, joints)
                place_pieces(joints, solids.info, solids.frame, solids.size, moving, pose)
                inside_tubes(joints, tip, lines, inside)
                hit = _chosen_contact(
                    solids, pairs, pose, chosen, found, inflation, exempt, inside, axes, s, out
                )
                if hit >= 0:
                    return hit
    return -1
