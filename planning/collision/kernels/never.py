"""Proof that two pieces of a robot never touch, whatever the joints between them do."""

from __future__ import annotations

from typing import Any

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, clearly_farther, gjk
from planning.collision.kernels.poses import (
    joint_poses,
    place_piece,
    reach_of_piece,
    relative_motion,
)


@njit(plain=True)
def never_touch(
    chain: Any,
    solids: Any,
    pose: Any,
    a: int,
    b: int,
    lower: Any,
    upper: Any,
    least: float,
    most_cells: int,
    work: Any,
    stack: Any,
) -> bool:
    """Whether pieces a and b stay farther apart than `least` over the box [lower, upper] of q.

    Bisects the box in the joints between the two; a cell is done when the distance at its centre
    exceeds the largest relative motion in it (`kernels.proof`). False as well when
    `most_cells` cells do not suffice: the pair then stays among those that are checked.
    `stack` (256, 2, n) is workspace.
    """
    n = lower.shape[0]
    ja, jb = solids.info[a, 0], solids.info[b, 0]
    joints, s, out, axis = work.joints, work.s, work.out, work.axis
    ra, rb, q, delta = work.reach[a], work.reach[b], work.q, work.delta
    for c in range(3):
        axis[c] = 0.0
    for j in range(n):
        ra[j] = rb[j] = 0.0
        stack[0, 0, j] = 0.5 * (lower[j] + upper[j])
        stack[0, 1, j] = 0.5 * (upper[j] - lower[j])
    for j in range(n):
        if chain.above[ja, j + 1] == chain.above[jb, j + 1]:
            stack[0, 1, j] = 0.0
    depth, cells = 1, 0
    while depth > 0:
        depth -= 1
        cells += 1
        if cells > most_cells or depth > 250:
            return False
        for j in range(n):
            q[j], delta[j] = stack[depth, 0, j], stack[depth, 1, j]
        joint_poses(chain.info, chain.frame, q, joints)
        for p in (a, b):
            place_piece(joints, solids, p, pose)
        reach_of_piece(joints, chain, solids, pose, a, ra)
        reach_of_piece(joints, chain, solids, pose, b, rb)
        need = least + relative_motion(chain.above, ja, jb, ra, rb, delta)
        if clearly_farther(pose, solids.size, a, b, need):
            continue
        status = gjk(solids, pose, a, b, axis, need, -1e300, s, out)
        if status == FAR or out[7] > need:
            continue
        if out[7] <= least:
            return False
        widest, extent = 0, -1.0
        for j in range(n):
            motion = (ra[j] if ra[j] > rb[j] else rb[j]) * delta[j]
            if motion > extent:
                widest, extent = j, motion
        delta[widest] *= 0.5
        for sign in (-1.0, 1.0):
            for j in range(n):
                stack[depth, 0, j], stack[depth, 1, j] = q[j], delta[j]
            stack[depth, 0, widest] += sign * delta[widest]
            depth += 1
    return True
