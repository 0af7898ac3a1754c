"""Slow oracle: is a point inside a closed mesh? The solid angle of all triangles seen from it."""

from __future__ import annotations

import numpy as np


def inside(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Winding number > 1/2 for points (P, 3): van Oosterom and Strackee's formula."""
    result = []
    corners = vertices[faces]
    for point in points:
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        result.append(np.sum(2 * np.arctan2(above, below)) / (4 * np.pi) > 0.5)
    return np.array(result)
