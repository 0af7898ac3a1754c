"""The second try of a coordination map: blocks that exact solids prove free.

Distances come from the project's GJK, which ends as soon as a separating plane proves the pair
farther apart than asked, or a point of both proves it nearer. Whatever it cannot decide stays
blocked.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, HIT, SOLVED, gjk
from planning.collision.kernels.layout import Solids
from planning.collision.packed import pack_solids
from planning.collision.pieces import Piece
from sequencing.timing.clearance.arms import ArmShapes
from sequencing.timing.clearance.block_kernels import (
    block_motion,
    num_levels,
    push_quarters,
    segment_distance,
)
from sequencing.timing.clearance.swept import SweptPath


@dataclass(frozen=True, eq=False)
class ExactPair:
    """Solids of two arms, packed together, and their poses (K, C, 15) along one path each."""

    solids: Solids
    poses_a: np.ndarray
    poses_b: np.ndarray


def pack_pair(first: Sequence[Piece], second: Sequence[Piece]) -> Solids:
    """The solids of two arms for the kernel, the first arm's in front."""
    return pack_solids([*first, *second])


def solid_poses(shapes: ArmShapes, rotation: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Poses (K, C, 15) of an arm's solids in the world from its joints' frames at K samples.

    Rotation row by row (9), origin (3), and the centre of the ball around the solid (3).
    """
    turn = rotation[:, shapes.joint]
    local = shapes.pose
    turned = turn @ local[None, :, :3, :3]
    place = np.einsum("kcab,cb->kca", turn, local[:, :3, 3]) + origin[:, shapes.joint]
    centre = np.array([piece.box_centre_m for piece in shapes.pieces])
    ball = np.einsum("kcab,cb->kca", turned, centre) + place
    return np.concatenate([turned.reshape(*turned.shape[:2], 9), place, ball], axis=2)


@njit
def _kernel(
    info,
    size,
    verts,
    near_start,
    near_vertex,
    poses_a,
    poses_b,
    ends_a,
    radius_a,
    travel_a,
    ends_b,
    radius_b,
    travel_b,
    pairs,
    clearance,
    blocked,
):
    """Free the blocks of `blocked`; returns the number of distances asked for."""
    cells = blocked.shape[0]
    levels = num_levels(cells)
    count = pairs.shape[0]
    solids_a = poses_a.shape[1]
    near = np.empty((levels + 1, count), dtype=np.int64)
    near_count = np.zeros(levels + 1, dtype=np.int64)
    for m in range(count):
        near[0, m] = m
    near_count[0] = count
    pose = np.empty((solids_a + poses_b.shape[1], 15))
    axis, work, out = np.empty(3), np.empty((4, 15)), np.empty(8)
    stack = np.empty((4 * levels + 4, 3), dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, 0
    top = 1
    tests = 0
    while top > 0:
        top -= 1
        i0, j0, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        size_cells = cells >> depth
        if not blocked[i0 : i0 + size_cells, j0 : j0 + size_cells].any():
            continue
        ma, mb = 2 * i0 + size_cells, 2 * j0 + size_cells
        left = 0
        hit = False
        for m in range(near_count[depth]):
            pair = near[depth, m]
            a, b = pairs[pair, 0], pairs[pair, 1]
            way = block_motion(travel_a, a, i0, travel_b, b, j0, size_cells)
            rough = segment_distance(ends_a[ma, a], ends_b[mb, b]) - radius_a[a] - radius_b[b]
            if rough > clearance + way:
                continue
            tests += 1
            pose[a] = poses_a[ma, a]
            pose[solids_a + b] = poses_b[mb, b]
            axis[:] = 0.0
            found = gjk(
                info,
                size,
                verts,
                near_start,
                near_vertex,
                pose,
                a,
                solids_a + b,
                axis,
                clearance + way,
                clearance - way,
                work,
                out,
            )
            if found == FAR or (found == SOLVED and out[0] > clearance + way):
                continue
            near[depth + 1, left] = pair
            left += 1
            if found in (HIT, SOLVED) and out[0] <= clearance:
                # The block's centre collides, so the block is not free whatever the others do:
                # they go to its parts untested, behind the pair that is likely to decide there.
                near[depth + 1, left - 1] = near[depth + 1, 0]
                near[depth + 1, 0] = pair
                for rest in range(m + 1, near_count[depth]):
                    near[depth + 1, left] = near[depth, rest]
                    left += 1
                # Overlapping cores are a hit of unknown depth: out[0] is not below zero then.
                hit = out[0] + way <= clearance
                break
        near_count[depth + 1] = left
        if left == 0:
            blocked[i0 : i0 + size_cells, j0 : j0 + size_cells] = 0
            continue
        if hit or size_cells == 1:
            continue
        top = push_quarters(stack, top, i0, j0, depth, size_cells)
    return tests


def free_blocks(
    path_a: SweptPath,
    path_b: SweptPath,
    clearance_m: float,
    exact: ExactPair,
    pairs: np.ndarray,
    blocked: np.ndarray,
) -> int:
    """Free what exact solids prove free of `blocked` (N, N); returns distances asked for."""
    solids = exact.solids
    return int(
        _kernel(
            solids.info,
            solids.size,
            solids.verts,
            solids.near_start,
            solids.near,
            exact.poses_a,
            exact.poses_b,
            path_a.ends_m,
            path_a.radius_m,
            path_a.travel_m,
            path_b.ends_m,
            path_b.radius_m,
            path_b.travel_m,
            pairs,
            clearance_m,
            blocked,
        )
    )
