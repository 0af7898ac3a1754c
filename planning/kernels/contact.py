"""Touching or not: single configurations, batches and straight segments.

Arguments as in `planning.kernels.scene`. "Touching" means not proven farther than `inflation`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from planning.jit import kernel
from planning.kernels.gjk import FAR, gjk, outer_bound
from planning.kernels.kinematics import joint_poses, place_pieces
from planning.kernels.scene import inside_tubes, skipped

__all__ = ["first_contacts", "segment_contact"]


@kernel
def _contact(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, q: Any, inflation: float,
    tip: Any, lines: Any, exempt: Any, joints: Any, inside: Any, axis: Any, s: Any, out: Any,
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
        if outer_bound(pose, size, a, b) > limit or skipped(exempt, inside, m):
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
    tip: Any, lines: Any, exempt: Any, first: Any,
) -> None:  # fmt: skip
    """first[k] = index of a touching pair at q[k] (K, n), or −1."""
    joints = np.empty((chain.info.shape[0], 15))
    s, out, axis = np.empty((4, 15)), np.empty(8), np.empty(3)
    inside = np.zeros(lines.shape[0], dtype=np.bool_)
    for k in range(q.shape[0]):
        first[k] = _contact(
            chain, solids, pairs, pose, moving, q[k], inflation, tip, lines, exempt,
            joints, inside, axis, s, out,
        )  # fmt: skip


@kernel
def segment_contact(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, q0: Any, q1: Any, parts: int,
    inflation: float, tip: Any, lines: Any, exempt: Any,
) -> int:  # fmt: skip
    """A touching pair on the segment, at its end and parts − 1 inner points, or −1.

    The end comes first, then points by halving, so that a hit is met early; the start counts as
    checked. `parts` is rounded up to a power of two.
    """
    joints = np.empty((chain.info.shape[0], 15))
    s, out, axis = np.empty((4, 15)), np.empty(8), np.empty(3)
    inside = np.zeros(lines.shape[0], dtype=np.bool_)
    q = np.empty(q0.shape[0])
    total = 1
    while total < parts:
        total *= 2
    hit = _contact(
        chain, solids, pairs, pose, moving, q1, inflation, tip, lines, exempt, joints,
        inside, axis, s, out,
    )  # fmt: skip
    step = total
    while hit < 0 and step > 1:
        step //= 2
        for k in range(step, total, 2 * step):
            t = k / total
            for j in range(q.shape[0]):
                q[j] = q0[j] + t * (q1[j] - q0[j])
            hit = _contact(
                chain, solids, pairs, pose, moving, q, inflation, tip, lines, exempt,
                joints, inside, axis, s, out,
            )  # fmt: skip
            if hit >= 0:
                break
    return hit
