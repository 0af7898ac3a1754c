"""Coordination maps: for two fixed paths, which pairs of path times are free of collision.

A map has N x N closed cells over (s_a, s_b) in [0, T_a] x [0, T_b]. A cell is called free only if
the distance of every pair of solids at a centre exceeds what both can move within the cell plus
the clearance, so a free cell is free everywhere in it, between samples included. Blocks of cells
are settled at once by a quadtree: pairs found apart in a block are not looked at inside it. What
capsules cannot settle is tried again with the exact solids, then called blocked. Their distances
come from the project's GJK, which ends as soon as a separating plane proves the pair farther apart
than asked, or a point of both proves it nearer; whatever it cannot decide stays blocked.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, HIT, SOLVED, gjk
from planning.collision.kernels.layout import Solids
from sequencing.timing.clearance.arms import ArmShapes
from sequencing.timing.clearance.segments import segment_distance
from sequencing.timing.clearance.swept import SweptPath

CELLS = 64


@dataclass(frozen=True, eq=False)
class CoordinationMap:
    """`blocked` (N, N) uint8; None where the paths' swept boxes or solids never come near."""

    blocked: np.ndarray | None

    @property
    def all_free(self) -> bool:
        """True if no pair of times can collide."""
        return self.blocked is None

    def turned(self) -> CoordinationMap:
        """The map of the same paths named in the other order."""
        return CoordinationMap(
            None if self.blocked is None else np.ascontiguousarray(self.blocked.T)
        )


class ExactPair(NamedTuple):
    """Solids of two arms, packed together, and their poses (K, C, 15) along one path each."""

    solids: Solids
    poses_a: np.ndarray
    poses_b: np.ndarray


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
def _block_motion(travel_a, a, i0, travel_b, b, j0, size):
    """How far pieces a and b can move, together, between the centre of a block and its rim [m]."""
    ma, mb = 2 * i0 + size, 2 * j0 + size
    return max(
        travel_a[2 * (i0 + size), a] - travel_a[ma, a],
        travel_a[ma, a] - travel_a[2 * i0, a],
    ) + max(
        travel_b[2 * (j0 + size), b] - travel_b[mb, b],
        travel_b[mb, b] - travel_b[2 * j0, b],
    )


@njit
def _free_blocks(path_a, path_b, pairs, clearance, exact, blocked):
    """Free the blocks of `blocked` that capsules, or the solids of `exact`, prove free.

    A block starts at cell (i0, j0) and is `size` cells wide; paths are sampled at 2 N + 1 points,
    so its centre is sample (2 i0 + size, 2 j0 + size).
    """
    cells = blocked.shape[0]
    levels = 1  # of a quadtree over the cells, the single ones included
    while (1 << (levels - 1)) < cells:
        levels += 1
    count = pairs.shape[0]
    near = np.empty((levels + 1, count), dtype=np.int64)
    near_count = np.zeros(levels + 1, dtype=np.int64)
    for m in range(count):
        near[0, m] = m
    near_count[0] = count
    if exact is not None:
        solids = exact.solids
        solids_a = exact.poses_a.shape[1]
        pose = np.empty((solids_a + exact.poses_b.shape[1], 15))
        axis, work, out = np.empty(3), np.empty((4, 15)), np.empty(8)
    stack = np.empty((4 * levels + 4, 3), dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, 0
    top = 1
    while top > 0:
        top -= 1
        i0, j0, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        size = cells >> depth
        if not blocked[i0 : i0 + size, j0 : j0 + size].any():
            continue
        ma, mb = 2 * i0 + size, 2 * j0 + size
        left = 0
        hit = False
        for m in range(near_count[depth]):
            pair = near[depth, m]
            a, b = pairs[pair, 0], pairs[pair, 1]
            way = _block_motion(path_a.travel_m, a, i0, path_b.travel_m, b, j0, size)
            rough = segment_distance(path_a.ends_m[ma, a], path_b.ends_m[mb, b])
            rough = rough - path_a.radius_m[a] - path_b.radius_m[b]
            if rough > clearance + way:
                continue
            if exact is not None:
                pose[a] = exact.poses_a[ma, a]
                pose[solids_a + b] = exact.poses_b[mb, b]
                axis[:] = 0.0
                found = gjk(
                    solids, pose, a, solids_a + b, axis, clearance + way, clearance - way, work, out
                )
                if found == FAR or (found == SOLVED and out[0] > clearance + way):
                    continue
            near[depth + 1, left] = pair
            left += 1
            if exact is None:
                hit = hit or rough + way <= clearance
            elif found in (HIT, SOLVED) and out[0] <= clearance:
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
            blocked[i0 : i0 + size, j0 : j0 + size] = 0
            continue
        if hit or size == 1:
            continue
        half = size // 2
        for di in range(2):
            for dj in range(2):
                stack[top, 0] = i0 + di * half
                stack[top, 1] = j0 + dj * half
                stack[top, 2] = depth + 1
                top += 1


def coordination_map(
    path_a: SweptPath,
    path_b: SweptPath,
    clearance_m: float,
    exact: ExactPair | None = None,
) -> CoordinationMap:
    """Map of two swept paths (of 2 N pieces each); `exact` adds the second try with the solids."""
    low = np.maximum(path_a.box_m[0], path_b.box_m[0])
    high = np.minimum(path_a.box_m[1], path_b.box_m[1])
    if (low > high + clearance_m).any():
        return CoordinationMap(None)
    a, b = np.meshgrid(
        np.arange(len(path_a.radius_m)), np.arange(len(path_b.radius_m)), indexing="ij"
    )
    pairs = np.stack([a.ravel(), b.ravel()], axis=1)
    pairs = np.ascontiguousarray(pairs[path_a.moving[pairs[:, 0]] | path_b.moving[pairs[:, 1]]])
    cells = (path_a.ends_m.shape[0] - 1) // 2
    blocked = np.ones((cells, cells), dtype=np.uint8)
    _free_blocks(path_a, path_b, pairs, clearance_m, None, blocked)
    if exact is not None and blocked.any():
        _free_blocks(path_a, path_b, pairs, clearance_m, exact, blocked)
    return CoordinationMap(blocked if blocked.any() else None)
