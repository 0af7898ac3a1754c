"""What both kernels of a coordination map do with a block of cells: its depth, motion, quarters.

A block starts at cell (i0, j0) and is `size` cells wide; paths are sampled at 2 N + 1 points, so
its centre is sample (2 i0 + size, 2 j0 + size).
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from dmoc.jit import njit


@njit
def num_levels(cells):
    """Levels of a quadtree over `cells` x `cells`, the single cells included."""
    levels = 1
    while (1 << (levels - 1)) < cells:
        levels += 1
    return levels


@njit
def block_motion(travel_a, a, i0, travel_b, b, j0, size):
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
def push_quarters(stack, top, i0, j0, depth, size):
    """Put the four quarters of a block on the stack of (i0, j0, depth); returns its new top."""
    half = size // 2
    for di in range(2):
        for dj in range(2):
            stack[top, 0] = i0 + di * half
            stack[top, 1] = j0 + dj * half
            stack[top, 2] = depth + 1
            top += 1
    return top
