"""Overlap of two oriented boxes by the fifteen separating axes, in numba."""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def boxes_overlap(first, half_a, second, half_b, offset):
    """True unless a face normal or a cross product of edges separates the boxes.

    `first`, `second` (3, 3) are the boxes' axes as columns, `half` (3,) half their edges, `offset`
    (3,) from the one centre to the other, all in the world.
    """
    turn = first.T @ second
    shift = first.T @ offset
    size = np.abs(turn) + 1e-12
    for i in range(3):
        reach = half_a[i] + half_b[0] * size[i, 0] + half_b[1] * size[i, 1] + half_b[2] * size[i, 2]
        if abs(shift[i]) > reach:
            return False
    for j in range(3):
        along = shift[0] * turn[0, j] + shift[1] * turn[1, j] + shift[2] * turn[2, j]
        reach = half_b[j] + half_a[0] * size[0, j] + half_a[1] * size[1, j] + half_a[2] * size[2, j]
        if abs(along) > reach:
            return False
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            along = shift[i2] * turn[i1, j] - shift[i1] * turn[i2, j]
            reach = half_a[i1] * size[i2, j] + half_a[i2] * size[i1, j]
            reach += half_b[j1] * size[i, j2] + half_b[j2] * size[i, j1]
            if abs(along) > reach:
                return False
    return True
