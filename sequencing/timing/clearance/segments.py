"""Distances of segments, the cores of capsules."""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np

from dmoc.jit import njit


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
