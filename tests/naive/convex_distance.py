"""Slow oracle: distance of two convex polytopes from their triangles, by trying everything."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull


def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether the hulls of points a (P, 3) and b (Q, 3) share a point: one linear programme."""
    rows = np.vstack(
        [
            np.hstack([a.T, -b.T]),
            np.hstack([np.ones(len(a)), np.zeros(len(b))]),
            np.hstack([np.zeros(len(a)), np.ones(len(b))]),
        ]
    )
    found = linprog(np.zeros(len(a) + len(b)), A_eq=rows, b_eq=[0, 0, 0, 1, 1], bounds=(0, None))
    return bool(found.status == 0)


def polytope_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Distance of the hulls of a and b, 0 if they overlap: corner–face and edge–edge distances."""
    if overlap(a, b):
        return 0.0
    best = np.inf
    faces = [points[ConvexHull(points).simplices] for points in (a, b)]
    for points, triangles in ((a, faces[1]), (b, faces[0])):
        for point, triangle in itertools.product(points, triangles):
            best = min(best, point_triangle(point, triangle))
    edges = [f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2, 3) for f in faces]
    for first, second in itertools.product(*edges):
        best = min(best, edge_edge(first, second))
    return float(best)


def point_triangle(p: np.ndarray, t: np.ndarray) -> float:
    """Distance of a point to a triangle (3, 3): projection if it is inside, else the edges."""
    normal = np.cross(t[1] - t[0], t[2] - t[0])
    length = np.linalg.norm(normal)
    if length > 1e-14:
        weights = np.linalg.solve(np.column_stack([t[1] - t[0], t[2] - t[0], normal]), p - t[0])
        if min(weights[0], weights[1], 1 - weights[0] - weights[1]) >= 0:
            return abs(weights[2]) * length
    return min(point_edge(p, t[[i, (i + 1) % 3]]) for i in range(3))


def point_edge(p: np.ndarray, e: np.ndarray) -> float:
    """Distance of a point to a segment (2, 3)."""
    d = e[1] - e[0]
    s = np.clip((p - e[0]) @ d / max(d @ d, 1e-300), 0, 1)
    return float(np.linalg.norm(p - e[0] - s * d))


def edge_edge(e: np.ndarray, f: np.ndarray) -> float:
    """Distance of two segments: the common perpendicular if it meets both, else the ends."""
    u, v, w = e[1] - e[0], f[1] - f[0], e[0] - f[0]
    matrix = np.array([[u @ u, -u @ v], [u @ v, -v @ v]])
    if abs(np.linalg.det(matrix)) > 1e-14:
        s, t = np.linalg.solve(matrix, [-u @ w, -v @ w])
        if 0 <= s <= 1 and 0 <= t <= 1:
            return float(np.linalg.norm(w + s * u - t * v))
    ends = [(e[0], f), (e[1], f), (f[0], e), (f[1], e)]
    return min(point_edge(p, edge) for p, edge in ends)
