"""What both kernels of a coordination map do with a block of cells: its depth, motion, quarters.

A block starts at cell (i0, j0) and is `size` cells wide; paths are sampled at 2 N + 1 points, so
its centre is sample (2 i0 + size, 2 j0 + size).
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit

# mypy: disallow-untyped-defs=False


@njit
def segment_distance(first, second):
    """Distance [m] of segments (2, 3) and (2, 3); a segment may be a point.

    Minimises |p + s d - q - t e| over the unit square: the free minimum of s, clamped, then t
    for that s, clamped, then s again.
    """
    dx = first[1, 0] - first[0, 0]
    dy = first[1, 1] - first[0, 1]
    dz = first[1, 2] - first[0, 2]
    ex = second[1, 0] - second[0, 0]
    ey = second[1, 1] - second[0, 1]
    ez = second[1, 2] - second[0, 2]
    rx = first[0, 0] - second[0, 0]
    ry = first[0, 1] - second[0, 1]
    rz = first[0, 2] - second[0, 2]
    a = dx * dx + dy * dy + dz * dz
    e = ex * ex + ey * ey + ez * ez
    b = dx * ex + dy * ey + dz * ez
    c = dx * rx + dy * ry + dz * rz
    f = ex * rx + ey * ry + ez * rz
    tiny = 1e-18
    s = 0.0
    t = 0.0
    if a <= tiny:
        if e > tiny:
            t = min(1.0, max(0.0, f / e))
    elif e <= tiny:
        s = min(1.0, max(0.0, -c / a))
    else:
        denominator = a * e - b * b
        if denominator > 1e-12 * a * e:
            s = min(1.0, max(0.0, (b * f - c * e) / denominator))
        t = (b * s + f) / e
        if t < 0.0:
            t = 0.0
            s = min(1.0, max(0.0, -c / a))
        elif t > 1.0:
            t = 1.0
            s = min(1.0, max(0.0, (b - c) / a))
    x = rx + s * dx - t * ex
    y = ry + s * dy - t * ey
    z = rz + s * dz - t * ez
    return np.sqrt(x * x + y * y + z * z)


@njit
def segment_distances(first, second):
    """Distances (A, B) [m] of all pairs of segments (A, 2, 3) and (B, 2, 3)."""
    out = np.empty((first.shape[0], second.shape[0]))
    for a in range(first.shape[0]):
        for b in range(second.shape[0]):
            out[a, b] = segment_distance(first[a], second[b])
    return out


# mypy: disallow-untyped-defs=False


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
