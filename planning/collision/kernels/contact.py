"""Touching or not, at single configurations and batches of them.

Arguments as in `kernels.queries`. "Touching" means not proven farther than `inflation`.
"""

from __future__ import annotations

from typing import Any

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, clearly_farther, gjk
from planning.collision.kernels.poses import joint_poses, place_pieces
from planning.collision.kernels.queries import inside_tubes, skipped


@njit(plain=True, inner=True)
def contact_at(
    chain: Any,
    solids: Any,
    pairs: Any,
    pose: Any,
    moving: int,
    q: Any,
    inflation: float,
    tip: Any,
    lines: Any,
    exempt: Any,
    inside: Any,
    joints: Any,
    axis: Any,
    s: Any,
    out: Any,
) -> int:
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
        status = gjk(info, size, verts, near_start, near, pose, a, b, axis, limit, limit, s, out)
        if status != FAR and out[7] <= limit:
            return m
    return -1


@njit(plain=True)
def first_contacts(
    chain: Any,
    solids: Any,
    pairs: Any,
    pose: Any,
    moving: int,
    q: Any,
    inflation: float,
    tip: Any,
    lines: Any,
    exempt: Any,
    inside: Any,
    work: Any,
    first: Any,
) -> None:
    """first[k] = index of a touching pair at q[k] (K, n), or −1."""
    joints, s, out, axis = work.joints, work.s, work.out, work.axis
    for k in range(q.shape[0]):
        first[k] = contact_at(
            chain,
            solids,
            pairs,
            pose,
            moving,
            q[k],
            inflation,
            tip,
            lines,
            exempt,
            inside,
            joints,
            axis,
            s,
            out,
        )
