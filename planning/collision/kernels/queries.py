"""Queries over a whole scene: which pairs are near, the smallest distance, touching or not."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.jit import njit
from planning.collision.kernels.depth import signed_distance
from planning.collision.kernels.distance import FAR, SOLVED, clearly_farther, gjk, outer_bound
from planning.collision.kernels.poses import (
    joint_poses,
    place_pieces,
    point_gradient,
    reach_of_piece,
    weight_of_piece,
)


@njit(plain=True, inner=True)
def tip_position(view: Any) -> tuple[float, float, float]:
    """The tool tip in the world."""
    joints, tip = view.work.joints, view.tip
    j = int(tip[0])
    x, y, z = tip[1], tip[2], tip[3]
    return (
        joints[j, 9] + joints[j, 0] * x + joints[j, 1] * y + joints[j, 2] * z,
        joints[j, 10] + joints[j, 3] * x + joints[j, 4] * y + joints[j, 5] * z,
        joints[j, 11] + joints[j, 6] * x + joints[j, 7] * y + joints[j, 8] * z,
    )


@njit(plain=True, inner=True)
def tube_stray(x: float, y: float, z: float, line: Any) -> float:
    """Distance of a point to the segment of a departure line [m]."""
    px, py, pz = x - line[0], y - line[1], z - line[2]
    along = px * line[3] + py * line[4] + pz * line[5]
    along = 0.0 if along < 0.0 else (line[6] if along > line[6] else along)
    dx, dy, dz = px - along * line[3], py - along * line[4], pz - along * line[5]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(plain=True, inner=True)
def inside_tubes(view: Any) -> None:
    """inside[l]: whether the tip lies in the tube of line l."""
    lines = view.lines
    if lines.shape[0] == 0:
        return
    x, y, z = tip_position(view)
    for k in range(lines.shape[0]):
        view.inside[k] = tube_stray(x, y, z, lines[k]) <= lines[k, 7]


@njit(plain=True)
def place(view: Any, q: Any) -> None:
    """Joints, pieces and what tubes the tip is in, at one q (n,)."""
    joint_poses(view.chain.info, view.chain.frame, q, view.work.joints)
    place_pieces(view.work.joints, view.solids, view.moving, view.pose)
    inside_tubes(view)


@njit(plain=True, inner=True)
def skipped(view: Any, m: int) -> bool:
    """Whether pair m is ignored by one of the tubes that the tip is in."""
    for k in range(view.exempt.shape[0]):  # noqa: SIM110 (numba compiles no any() of a generator)
        if view.inside[k] and view.exempt[k, m]:
            return True
    return False


@njit(plain=True)
def smallest_distances(view: Any, q: Any, cap: float, phi: Any, nearest: Any, deep: Any) -> None:
    """phi[k] = min(cap, smallest distance at q[k]), nearest[k] its pair (−1: none below cap).

    deep[k] is set where some pair overlaps or is undecided: there phi is only an upper bound and
    all near pairs have to be measured.
    """
    solids, pose, work = view.solids, view.pose, view.work
    size = solids.size
    piece, surplus = view.pairs.piece, view.pairs.extra
    s, out, axes, bound, order = work.s, work.out, work.axes, work.bound, work.order
    count = piece.shape[0]
    for m in range(count):
        axes[m, 0] = axes[m, 1] = axes[m, 2] = 0.0
    for k in range(q.shape[0]):
        place(view, q[k])
        phi[k], nearest[k], deep[k] = cap, -1, False
        found = 0
        for m in range(count):
            lowest = outer_bound(pose, size, piece[m, 0], piece[m, 1])
            lowest -= surplus[m]
            if lowest >= cap or skipped(view, m):
                continue
            # Insertion by bound: the nearest pair first makes the others stop early.
            at = found
            while at > 0 and bound[at - 1] > lowest:
                bound[at], order[at] = bound[at - 1], order[at - 1]
                at -= 1
            bound[at], order[at] = lowest, m
            found += 1
        for i in range(found):
            if bound[i] >= phi[k]:
                break
            m = order[i]
            extra = surplus[m]
            status = gjk(
                solids, pose, piece[m, 0], piece[m, 1], axes[m], phi[k] + extra, -1e300, s, out
            )
            if status == FAR:
                continue
            if status != SOLVED:
                deep[k] = True
            if out[0] - extra < phi[k]:
                phi[k], nearest[k] = out[0] - extra, m
        if phi[k] <= 0.0:
            deep[k] = True  # the bounds that order the pairs say nothing about depths


@njit(plain=True)
def near_pairs(view: Any, q: Any, cap: float, grown: Any, index: Any, values: Any) -> int:
    """All pairs nearer than `cap` at the configurations q (K, n), with gradients.

    Row r: `index[r]` = configuration, pair; `values[r]` = distance, nearest points (3, 3), normal
    from a to b (3), gradient n·(∂b/∂q − ∂a/∂q) (n,). Where the bounds of `gjk` do not meet the
    larger of two lower bounds stands (of overlapping pieces: minus the depth). Returns the number
    of rows there are; rows beyond the room given are only counted.
    """
    solids, pose, work = view.solids, view.pose, view.work
    size = solids.size
    piece, surplus = view.pairs.piece, view.pairs.extra
    s, out, normal, axes = work.s, work.out, work.axis, work.axes
    count = piece.shape[0]
    for m in range(count):
        axes[m, 0] = axes[m, 1] = axes[m, 2] = 0.0
    rows = 0
    for k in range(q.shape[0]):
        place(view, q[k])
        for m in range(count):
            a, b = piece[m, 0], piece[m, 1]
            limit = cap + surplus[m]
            if clearly_farther(pose, size, a, b, limit) or skipped(view, m):
                continue
            if not signed_distance(solids, pose, a, b, axes[m], limit, s, grown, out, normal):
                continue
            if rows < index.shape[0]:
                index[rows, 0], index[rows, 1] = k, m
                values[rows, 0] = out[0] - surplus[m]
                for c in range(6):
                    values[rows, 1 + c] = out[1 + c]
                for c in range(3):
                    values[rows, 7 + c] = normal[c]
                contact_gradient(view, m, values[rows])
            rows += 1
    return rows


@njit(plain=True, inner=True)
def contact_gradient(view: Any, m: int, row: Any) -> None:
    """Gradient of a distance row of pair m from its points and normal, into `row[10:]`."""
    joints, chain, info = view.work.joints, view.chain, view.solids.info
    a, b = view.pairs.piece[m, 0], view.pairs.piece[m, 1]
    for j in range(10, row.shape[0]):
        row[j] = 0.0
    point_gradient(joints, chain, info[b, 0], row[4:7], row[7:10], 1.0, row[10:])
    point_gradient(joints, chain, info[a, 0], row[1:4], row[7:10], -1.0, row[10:])


@njit(plain=True)
def engine_rows(view: Any, q: Any, index: Any, values: Any) -> None:
    """Gradients of rows whose distance, points and normal an engine has measured."""
    for r in range(index.shape[0]):
        joint_poses(view.chain.info, view.chain.frame, q[index[r, 0]], view.work.joints)
        contact_gradient(view, index[r, 1], values[r])


@njit(plain=True)
def reach_batch(view: Any, q: Any, reach: Any, weight: Any) -> None:
    """R_j(q) and w_j(q) (K, n): maxima over all moving pieces."""
    chain, solids, pose = view.chain, view.solids, view.pose
    joints, one = view.work.joints, view.work.delta
    for k in range(q.shape[0]):
        place(view, q[k])
        for j in range(q.shape[1]):
            reach[k, j] = weight[k, j] = 0.0
        for p in range(view.moving):
            reach_of_piece(joints, chain, solids, pose, p, one)
            for j in range(q.shape[1]):
                if one[j] > reach[k, j]:
                    reach[k, j] = one[j]
            weight_of_piece(joints, chain, solids, pose, p, weight[k])


@njit(plain=True)
def tips_at(view: Any, q: Any, out: Any) -> None:
    """Tip positions (K, 3) at rows of q."""
    for k in range(q.shape[0]):
        joint_poses(view.chain.info, view.chain.frame, q[k], view.work.joints)
        out[k, 0], out[k, 1], out[k, 2] = tip_position(view)


@njit(plain=True)
def candidate_pairs(view: Any, q: Any, cap: float, chosen: Any) -> int:
    """Pairs at one q (n,) whose balls and boxes come nearer than `cap`; leaves the poses behind."""
    pose, size = view.pose, view.solids.size
    piece, surplus = view.pairs.piece, view.pairs.extra
    place(view, q)
    count = 0
    for m in range(piece.shape[0]):
        bound = outer_bound(pose, size, piece[m, 0], piece[m, 1])
        if bound >= cap + surplus[m] or skipped(view, m):
            continue
        chosen[count] = m
        count += 1
    return count
