"""Distance from points to the surface or solid of a body (for authoring, not for planning)."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from planning.geometry.convex import cover_gap_m
from planning.geometry.shapes import Body, Shape


def body_distance_m(body: Body, point: Array) -> float:
    """Distance [m] from a world point (3,) to an obstacle: 0 inside a solid."""
    local = body.pose[:3, :3].T @ (np.asarray(point, dtype=float) - body.pose[:3, 3])
    shapes = (body.mesh,) if body.mesh is not None else body.shapes
    return min(_shape_distance(shape, local) for shape in shapes)


def _shape_distance(shape: Shape, point: Array) -> float:
    local = shape.pose[:3, :3].T @ (point - shape.pose[:3, 3])
    if shape.kind == "box":
        outside = np.maximum(np.abs(local) - 0.5 * np.array(shape.size_m), 0.0)
        return float(np.linalg.norm(outside))
    if shape.kind == "sphere":
        return max(float(np.linalg.norm(local)) - shape.size_m[0], 0.0)
    if shape.kind == "cylinder":
        radius, length = shape.size_m
        across = max(float(np.hypot(local[0], local[1])) - radius, 0.0)
        return float(np.hypot(across, max(abs(float(local[2])) - 0.5 * length, 0.0)))
    if shape.kind == "convex":
        return max(
            float(cover_gap_m([Shape("convex", vertices_m=shape.vertices_m)], local[None])[0]), 0.0
        )
    assert shape.vertices_m is not None
    assert shape.faces is not None
    return float(triangle_distance_m(shape.vertices_m[shape.faces], local).min())


def triangle_distance_m(corners: Array, point: Array) -> Array:
    """Distances (F,) from one point (3,) to triangles (F, 3, 3)."""
    origin, edge_1, edge_2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2]
    edge_2 = edge_2 - origin
    offset = point - origin
    a = np.einsum("ij,ij->i", edge_1, edge_1)
    b = np.einsum("ij,ij->i", edge_1, edge_2)
    c = np.einsum("ij,ij->i", edge_2, edge_2)
    d = np.einsum("ij,ij->i", edge_1, offset)
    e = np.einsum("ij,ij->i", edge_2, offset)
    det = a * c - b * b
    safe = np.where(det > 1e-300, det, 1.0)
    s, t = (c * d - b * e) / safe, (a * e - b * d) / safe
    inside = (det > 1e-300) & (s >= 0) & (t >= 0) & (s + t <= 1)
    plane = origin + s[:, None] * edge_1 + t[:, None] * edge_2
    best = np.where(inside, np.linalg.norm(point - plane, axis=1), np.inf)
    for i in range(3):
        start, stop = corners[:, i], corners[:, (i + 1) % 3]
        along = stop - start
        length = np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
        fraction = np.clip(np.einsum("ij,ij->i", point - start, along) / length, 0, 1)
        foot = start + fraction[:, None] * along
        best = np.minimum(best, np.linalg.norm(point - foot, axis=1))
    return best
