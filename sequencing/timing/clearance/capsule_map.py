"""Coordination maps: for two fixed paths, which pairs of path times are free of collision.

A map has N x N closed cells over (s_a, s_b) in [0, T_a] x [0, T_b]. A cell is called free only if
the distance of every pair of solids at a centre exceeds what both can move within the cell plus
the clearance, so a free cell is free everywhere in it, between samples included. Blocks of cells
are settled at once by a quadtree: pairs found apart in a block are not looked at inside it. What
capsules cannot settle is tried again with the exact solids, then called blocked.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.jit import njit
from sequencing.timing.clearance.block_kernels import (
    block_motion,
    num_levels,
    push_quarters,
    segment_distance,
)
from sequencing.timing.clearance.exact_map import ExactPair, free_blocks
from sequencing.timing.clearance.swept import SweptPath

CELLS = 64


@dataclass(frozen=True, eq=False)
class CoordinationMap:
    """`blocked` (N, N) uint8; None where the paths' swept boxes or solids never come near."""

    blocked: np.ndarray | None
    tests: int

    @property
    def all_free(self) -> bool:
        """True if no pair of times can collide."""
        return self.blocked is None

    def turned(self) -> CoordinationMap:
        """The map of the same paths named in the other order."""
        blocked = None if self.blocked is None else np.ascontiguousarray(self.blocked.T)
        return CoordinationMap(blocked, self.tests)


@njit
def _capsule_map(ends_a, radius_a, travel_a, ends_b, radius_b, travel_b, pairs, clearance, blocked):
    """Fill `blocked`; returns the number of distances computed."""
    cells = blocked.shape[0]
    levels = num_levels(cells)
    count = pairs.shape[0]
    near = np.empty((levels + 1, count), dtype=np.int64)
    near_count = np.zeros(levels + 1, dtype=np.int64)
    for m in range(count):
        near[0, m] = m
    near_count[0] = count
    stack = np.empty((4 * levels + 4, 3), dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, 0
    top = 1
    tests = 0
    while top > 0:
        top -= 1
        i0, j0, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        size = cells >> depth
        ma, mb = 2 * i0 + size, 2 * j0 + size
        left = 0
        hit = False
        for m in range(near_count[depth]):
            pair = near[depth, m]
            a, b = pairs[pair, 0], pairs[pair, 1]
            way = block_motion(travel_a, a, i0, travel_b, b, j0, size)
            tests += 1
            apart = segment_distance(ends_a[ma, a], ends_b[mb, b]) - radius_a[a] - radius_b[b]
            if apart <= clearance + way:
                near[depth + 1, left] = pair
                left += 1
                if apart + way <= clearance:
                    hit = True
        near_count[depth + 1] = left
        if left == 0:
            continue
        if hit or size == 1:
            for i in range(i0, i0 + size):
                for j in range(j0, j0 + size):
                    blocked[i, j] = 1
            continue
        top = push_quarters(stack, top, i0, j0, depth, size)
    return tests


def coordination_map(
    path_a: SweptPath,
    path_b: SweptPath,
    clearance_m: float,
    exact: ExactPair | None = None,
) -> CoordinationMap:
    """Map of two swept paths (of 2 N pieces each); `exact` adds the second try with the solids."""
    gap = clearance_m
    low = np.maximum(path_a.box_m[0], path_b.box_m[0])
    high = np.minimum(path_a.box_m[1], path_b.box_m[1])
    if (low > high + gap).any():
        return CoordinationMap(None, 0)
    a, b = np.meshgrid(
        np.arange(len(path_a.radius_m)), np.arange(len(path_b.radius_m)), indexing="ij"
    )
    pairs = np.stack([a.ravel(), b.ravel()], axis=1)
    pairs = np.ascontiguousarray(pairs[path_a.moving[pairs[:, 0]] | path_b.moving[pairs[:, 1]]])
    cells = (path_a.ends_m.shape[0] - 1) // 2
    blocked = np.zeros((cells, cells), dtype=np.uint8)
    tests = _capsule_map(
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
    if blocked.any() and exact is not None:
        tests += free_blocks(path_a, path_b, clearance_m, exact, pairs, blocked)
    return CoordinationMap(blocked if blocked.any() else None, int(tests))
