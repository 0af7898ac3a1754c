"""What an engine is: the distance of two convex pieces at given poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import coal
import numpy as np

from dmoc.arrays import Array
from planning.collision.pieces import Piece


def coal_geometry(piece: Piece) -> coal.CollisionGeometry:
    """The coal shape of a piece, in the piece's frame."""
    if piece.kind == "box":
        return coal.Box(*piece.size_m)
    if piece.kind == "sphere":
        return coal.Sphere(*piece.size_m)
    if piece.kind == "cylinder":
        return coal.Cylinder(*piece.size_m)
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in piece.vertices_m:
        points.append(np.array(vertex))
    for a, b, c in piece.faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    return coal.Convex(points, triangles)


class CoalEngine:
    """coal's GJK and EPA on one pair at a time (holds one object per piece; not thread-safe)."""

    name = "coal"

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._objects = [coal.CollisionObject(coal_geometry(p), coal.Transform3s()) for p in pieces]

    def distance(self, a: int, b: int, pose_a: Array, pose_b: Array) -> PairDistance:
        """Signed distance with nearest points; depth by EPA where the pieces overlap."""
        first, second = self._objects[a], self._objects[b]
        for item, pose in ((first, pose_a), (second, pose_b)):
            item.setTransform(coal.Transform3s(pose[:9].reshape(3, 3), pose[9:12]))
        # A fresh result and request: coal keeps its last support vertices in the request, and a
        # hint from the last call changes the last digits.
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.enable_signed_distance = True
        distance = coal.distance(first, second, request, result)
        return PairDistance(
            float(distance),
            np.array(result.getNearestPoint1()).ravel(),
            np.array(result.getNearestPoint2()).ravel(),
            np.array(result.normal).ravel(),
        )

    def touches(self, a: int, b: int, pose_a: Array, pose_b: Array) -> bool:
        """Whether the signed distance is not positive."""
        return self.distance(a, b, pose_a, pose_b).distance_m <= 0.0


class PairDistance(NamedTuple):
    """Signed distance [m] (negative: depth), nearest points (3,) of a and b, normal a → b (3,).

    distance = normal · (point_b − point_a), also in penetration. Points are None where the
    engine cannot give them.
    """

    distance_m: float
    point_a: Array
    point_b: Array
    normal: Array


class Engine(Protocol):
    """Measures one pair of pieces; poses are rows (R row-major, t, …) as the kernels write them."""

    name: str

    def distance(self, a: int, b: int, pose_a: Array, pose_b: Array) -> PairDistance:
        """Signed distance with nearest points."""
        ...

    def touches(self, a: int, b: int, pose_a: Array, pose_b: Array) -> bool:
        """Whether the two pieces overlap."""
        ...
