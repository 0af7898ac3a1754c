"""Continuous-time proof of clearance along a cubic Hermite curve, by adaptive bisection.

On a part of the curve with middle q_m and |q_j(s) − q_j(q_m)| ≤ δ_j, no point x of piece p moves
farther than Σ_j R_pj δ_j, R_pj the largest distance of the piece to the axis of joint j at q_m:
turn the joints one after the other from the base, each turn moves x on an arc of that radius, for
what lies beyond the joint has not changed its shape yet. Seen from piece a, piece b moves only
with the joints that move one of the two and not both. A pair whose distance at q_m exceeds that
bound plus the tracking error is free on the whole part.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from planning.jit import kernel
from planning.kernels.gjk import FAR, clearly_farther, gjk
from planning.kernels.kinematics import (
    joint_poses,
    place_pieces,
    reach_of_piece,
    relative_motion,
)
from planning.kernels.scene import tip_position, tube_stray

__all__ = ["prove"]

ROUNDING_M = 1e-9


@kernel
def _blossom(b: Any, j: int, x: float, y: float, z: float) -> float:
    """Blossom of the cubic Bézier coordinate b[:, j] at (x, y, z)."""
    p0 = b[0, j] + x * (b[1, j] - b[0, j])
    p1 = b[1, j] + x * (b[2, j] - b[1, j])
    p2 = b[2, j] + x * (b[3, j] - b[2, j])
    p0, p1 = p0 + y * (p1 - p0), p1 + y * (p2 - p1)
    return p0 + z * (p1 - p0)


@kernel
def _middle_and_spread(b: Any, lo: float, hi: float, q: Any, delta: Any) -> None:
    """q at the middle of [lo, hi] and δ: the control points of the part enclose the curve."""
    mid = 0.5 * (lo + hi)
    for j in range(q.shape[0]):
        q[j] = _blossom(b, j, mid, mid, mid)
        spread = abs(_blossom(b, j, lo, lo, lo) - q[j])
        spread = max(spread, abs(_blossom(b, j, lo, lo, hi) - q[j]))
        spread = max(spread, abs(_blossom(b, j, lo, hi, hi) - q[j]))
        delta[j] = max(spread, abs(_blossom(b, j, hi, hi, hi) - q[j]))


@kernel
def _tip_motion(
    chain: Any, joints: Any, tip: Any, x: float, y: float, z: float, delta: Any
) -> float:
    """Largest displacement of the tool tip on a part of the curve [m]."""
    total = 0.0
    joint = int(tip[0])
    for j in range(1, chain.info.shape[0]):
        if not chain.above[joint, j]:
            continue
        radius = 1.0
        if chain.info[j, 1] == 0:
            ax, ay, az = joints[j, 12], joints[j, 13], joints[j, 14]
            rx, ry, rz = x - joints[j, 9], y - joints[j, 10], z - joints[j, 11]
            dx, dy, dz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
            radius = np.sqrt(dx * dx + dy * dy + dz * dz)
        total += radius * delta[j - 1]
    return total


@kernel
def prove(
    chain: Any, solids: Any, pairs: Any, pose: Any, moving: int, bezier: Any, tracking: float,
    tip: Any, lines: Any, exempt: Any, max_depth: int, max_failures: int,
    where: Any, place: Any,
) -> tuple[int, int, float]:  # fmt: skip
    """Prove every interval of `bezier` (N, 4, n) free.

    Failure f: `where[f]` = interval and pair, `place[f]` = λ in [0, 1] and the bound of the
    distance there. Returns how many failures, how many configurations were evaluated, and the
    smallest distance bound met. Each pair is reported once an interval; the search ends at
    `max_failures`.
    """
    # Arrays taken out of their tuples once: inside the loops each access would count references.
    info, size, verts = solids.info, solids.size, solids.verts
    near_start, near = solids.near_start, solids.near
    piece, surplus = pairs.piece, pairs.extra
    num_intervals, n = bezier.shape[0], bezier.shape[2]
    count = piece.shape[0]
    joints = np.empty((chain.info.shape[0], 15))
    q, delta = np.empty(n), np.empty(n)
    reach = np.zeros((pose.shape[0], n))
    s, out = np.empty((4, 15)), np.empty(8)
    axes = np.zeros((count, 3))
    open_pairs = np.empty((max_depth + 2, count), dtype=np.int64)
    left = np.empty(max_depth + 2, dtype=np.int64)
    failed = np.zeros(count, dtype=np.bool_)
    node_lo, node_depth = np.empty(max_depth + 2), np.empty(max_depth + 2, dtype=np.int64)
    covered = np.zeros(lines.shape[0], dtype=np.bool_)
    failures = evaluations = 0
    smallest = 1e300
    for i in range(num_intervals):
        failed[:] = False
        left[0] = count
        for m in range(count):
            open_pairs[0, m] = m
        # Depth first: a node at depth d takes the pairs left open by its parent in row d and
        # leaves those that stay open in row d + 1 for both children.
        stack = 1
        node_lo[0], node_depth[0] = 0.0, 0
        while stack > 0:
            stack -= 1
            lo, depth = node_lo[stack], node_depth[stack]
            width = 0.5**depth
            _middle_and_spread(bezier[i], lo, lo + width, q, delta)
            joint_poses(chain.info, chain.frame, q, joints)
            place_pieces(joints, info, solids.frame, size, moving, pose)
            for p in range(moving):
                reach_of_piece(
                    joints, chain.info, chain.above, info[p, 0], pose, size, p,
                    reach[p],
                )  # fmt: skip
            for k in range(lines.shape[0]):
                x, y, z = tip_position(joints, tip)
                stray = tube_stray(x, y, z, lines[k])
                stray += _tip_motion(chain, joints, tip, x, y, z, delta)
                covered[k] = stray <= lines[k, 7]
            evaluations += 1
            still = 0
            for at in range(left[depth]):
                m = open_pairs[depth, at]
                if failed[m]:
                    continue
                skip = False
                for k in range(lines.shape[0]):
                    if covered[k] and exempt[k, m]:
                        skip = True
                if skip:
                    continue
                a, b = piece[m, 0], piece[m, 1]
                motion = relative_motion(
                    chain.above, info[a, 0], info[b, 0], reach[a], reach[b], delta
                )
                must = tracking + surplus[m] + ROUNDING_M
                need = must + motion
                if clearly_farther(pose, size, a, b, need):
                    continue
                status = gjk(
                    info, size, verts, near_start, near, pose,
                    a, b, axes[m], need, -1e300, s, out,
                )  # fmt: skip
                smallest = min(smallest, out[0] - surplus[m])
                if status == FAR or out[7] > need:
                    continue
                touching = out[0] <= must
                if touching:
                    # Contact is a failure here, unless the tip lies in a tube that exempts it:
                    # then a shorter part may be proven.
                    for k in range(lines.shape[0]):
                        if exempt[k, m]:
                            x, y, z = tip_position(joints, tip)
                            if tube_stray(x, y, z, lines[k]) < lines[k, 7]:
                                touching = False
                if touching or depth == max_depth:
                    if failures < max_failures:
                        where[failures, 0], where[failures, 1] = i, m
                        place[failures, 0], place[failures, 1] = lo + 0.5 * width, out[7]
                    failures += 1
                    failed[m] = True
                    if failures >= max_failures:
                        return failures, evaluations, smallest
                    continue
                open_pairs[depth + 1, still] = m
                still += 1
            if still > 0:
                left[depth + 1] = still
                node_lo[stack], node_depth[stack] = lo + 0.5 * width, depth + 1
                node_lo[stack + 1], node_depth[stack + 1] = lo, depth + 1
                stack += 2
    return failures, evaluations, smallest
