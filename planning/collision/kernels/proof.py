"""Continuous-time proof of clearance along a cubic Hermite curve, by adaptive bisection.

On a part of the curve with middle q_m and |q_j(s) − q_j(q_m)| ≤ δ_j, no point x of piece p moves
farther than Σ_j R_pj δ_j, R_pj the largest distance of the piece to the axis of joint j at q_m:
turn the joints one after the other from the base, each turn moves x on an arc of that radius, for
what lies beyond the joint has not changed its shape yet. Seen from piece a, piece b moves only
with the joints that move one of the two and not both. A pair whose distance at q_m exceeds that
bound plus the tracking error is free on the whole part.

The same bisection finds a clearance that is kept everywhere: a level, at first what is wanted,
that gives way where a configuration is nearer (branch and bound on the smallest distance).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, SOLVED, clearly_farther, gjk
from planning.collision.kernels.poses import (
    joint_poses,
    place_pieces,
    reach_of_piece,
    relative_motion,
)
from planning.collision.kernels.queries import skipped, tip_position, tube_stray

ROUNDING_M = 1e-9


class Bisection(NamedTuple):
    """Workspace: the pairs still open at every depth (D, M) and how many (D,), which pairs have
    failed in the interval (M,), at which evaluation the reach of a piece was computed (P,), and the
    stack of parts (D,).
    """

    open_pairs: npt.NDArray[np.int64]
    left: npt.NDArray[np.int64]
    failed: npt.NDArray[np.bool_]
    reached: npt.NDArray[np.int64]
    lo: npt.NDArray[np.float64]
    width: npt.NDArray[np.float64]
    depth: npt.NDArray[np.int64]


def bisection_workspace(pieces: int, pairs: int, max_depth: int) -> Bisection:
    """Room for that many pieces, pairs of them and halvings."""
    rows = max_depth + 2
    return Bisection(
        np.empty((rows, pairs), dtype=np.int64),
        np.empty(rows, dtype=np.int64),
        np.zeros(pairs, dtype=bool),
        np.zeros(pieces, dtype=np.int64),
        np.empty(rows),
        np.empty(rows),
        np.empty(rows, dtype=np.int64),
    )


@njit(plain=True, inner=True)
def _blossom(b: Any, j: int, x: float, y: float, z: float) -> float:
    """Blossom of the cubic Bézier coordinate b[:, j] at (x, y, z)."""
    p0 = b[0, j] + x * (b[1, j] - b[0, j])
    p1 = b[1, j] + x * (b[2, j] - b[1, j])
    p2 = b[2, j] + x * (b[3, j] - b[2, j])
    p0, p1 = p0 + y * (p1 - p0), p1 + y * (p2 - p1)
    return p0 + z * (p1 - p0)


@njit(plain=True, inner=True)
def _middle_and_spread(b: Any, lo: float, hi: float, q: Any, delta: Any) -> None:
    """q at the middle of [lo, hi] and δ: the control points of the part enclose the curve."""
    mid = 0.5 * (lo + hi)
    for j in range(q.shape[0]):
        q[j] = _blossom(b, j, mid, mid, mid)
        spread = abs(_blossom(b, j, lo, lo, lo) - q[j])
        for k in range(3):
            other = abs(_blossom(b, j, lo if k < 2 else hi, lo if k < 1 else hi, hi) - q[j])
            if other > spread:
                spread = other
        delta[j] = spread


@njit(plain=True, inner=True)
def _tip_motion(view: Any, x: float, y: float, z: float, delta: Any) -> float:
    """Largest displacement of the tool tip on a part of the curve [m]."""
    total = 0.0
    chain, joints, joint = view.chain, view.work.joints, int(view.tip[0])
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


@njit(plain=True)
def prove(
    view: Any,
    bezier: Any,
    tracking: float,
    tree: Any,
    max_failures: int,
    where: Any,
    place: Any,
    wanted: float,
    tolerance: float,
    level_depth: int,
) -> tuple[int, int, float, float]:
    """Prove every interval of `bezier` (N, 4, n) free; depth at most that of the `tree`.

    Failure f: `where[f]` = interval and pair, `place[f]` = λ in [0, 1] and the bound of the
    distance there. Each pair is reported once an interval; the search ends at `max_failures`.
    Returns how many failures, how many configurations were evaluated, the smallest distance met at
    one of them (1e300: none was measured), and a distance that nothing undercuts anywhere if there
    is no failure: at most `wanted`, at least `tracking`; where something is nearer than `wanted`,
    about `tolerance` below the smallest distance. It gives way to what `level_depth` halvings can
    prove.
    """
    chain, solids, pose, work, lines = view.chain, view.solids, view.pose, view.work, view.lines
    info, size, piece, surplus = solids.info, solids.size, view.pairs.piece, view.pairs.extra
    s, out, axes = work.s, work.out, work.axes
    q, delta, reach = work.q, work.delta, work.reach
    open_pairs, left, failed, reached = tree.open_pairs, tree.left, tree.failed, tree.reached
    node_lo, node_width, node_depth = tree.lo, tree.width, tree.depth
    num_intervals, n = bezier.shape[0], bezier.shape[2]
    count, max_depth = piece.shape[0], left.shape[0] - 2
    level = wanted if wanted > tracking else tracking
    for m in range(count):
        axes[m, 0] = axes[m, 1] = axes[m, 2] = 0.0
    for p in range(pose.shape[0]):  # pieces that stand still reach nowhere
        reached[p] = 0
        for j in range(n):
            reach[p, j] = 0.0
    failures = evaluations = 0
    smallest = 1e300
    for i in range(num_intervals):
        left[0] = count
        for m in range(count):
            failed[m] = False
            open_pairs[0, m] = m
        # Depth first: a node at depth d takes the pairs left open by its parent in row d and
        # leaves those that stay open in row d + 1 for both children.
        stack = 1
        node_lo[0], node_width[0], node_depth[0] = 0.0, 1.0, 0
        while stack > 0:
            stack -= 1
            lo, width, depth = node_lo[stack], node_width[stack], node_depth[stack]
            _middle_and_spread(bezier[i], lo, lo + width, q, delta)
            joint_poses(chain.info, chain.frame, q, work.joints)
            place_pieces(work.joints, solids, view.moving, pose)
            x, y, z = tip_position(view)
            for k in range(lines.shape[0]):
                stray = tube_stray(x, y, z, lines[k])
                stray += _tip_motion(view, x, y, z, delta)
                view.inside[k] = stray <= lines[k, 7]
            evaluations += 1
            still = 0
            for at in range(left[depth]):
                m = open_pairs[depth, at]
                if failed[m] or skipped(view, m):
                    continue
                a, b = piece[m, 0], piece[m, 1]
                for p in (a, b):
                    # Only here: deep parts have few open pairs, and reaches are most of the work.
                    if p < view.moving and reached[p] != evaluations:
                        reached[p] = evaluations
                        reach_of_piece(work.joints, chain, solids, pose, p, reach[p])
                motion = relative_motion(
                    chain.above, info[a, 0], info[b, 0], reach[a], reach[b], delta
                )
                away = surplus[m] + ROUNDING_M
                if clearly_farther(pose, size, a, b, level + away + motion):
                    continue
                status = gjk(solids, pose, a, b, axes[m], level + away + motion, -1e300, s, out)
                if status == FAR or out[7] > level + away + motion:
                    continue
                # Contact is a failure here, unless the tip lies in a tube that exempts it: then a
                # shorter part may be proven.
                excused = False
                for k in range(lines.shape[0]):
                    if view.exempt[k, m] and tube_stray(x, y, z, lines[k]) < lines[k, 7]:
                        excused = True
                if not excused:
                    if status == SOLVED and out[0] - surplus[m] < smallest:
                        smallest = out[0] - surplus[m]
                    if out[0] - surplus[m] - tolerance < level:
                        level = out[0] - surplus[m] - tolerance
                if depth >= level_depth and out[7] - away - motion < level:
                    level = out[7] - away - motion
                if level < tracking:
                    level = tracking
                if out[7] > level + away + motion:
                    continue
                touching = not excused and out[0] <= tracking + away
                if touching or depth == max_depth:
                    if failures < max_failures:
                        where[failures, 0], where[failures, 1] = i, m
                        place[failures, 0], place[failures, 1] = lo + 0.5 * width, out[7]
                    failures += 1
                    failed[m] = True
                    if failures >= max_failures:
                        return failures, evaluations, smallest, level
                    continue
                open_pairs[depth + 1, still] = m
                still += 1
            if still > 0:
                left[depth + 1] = still
                half = 0.5 * width
                node_lo[stack], node_width[stack], node_depth[stack] = lo + half, half, depth + 1
                stack += 1
                node_lo[stack], node_width[stack], node_depth[stack] = lo, half, depth + 1
                stack += 1
    return failures, evaluations, smallest, level
