"""Pair distances by python-fcl: the second opinion."""

from __future__ import annotations

from collections.abc import Sequence

import fcl
import numpy as np

from dmoc.arrays import Array
from planning.collision.coal_engine import PairDistance
from planning.collision.pieces import Piece


def fcl_geometry(piece: Piece) -> fcl.CollisionGeometry:
    """The fcl shape of a piece, in the piece's frame."""
    if piece.kind == "box":
        return fcl.Box(*piece.size_m)
    if piece.kind == "sphere":
        return fcl.Sphere(*piece.size_m)
    if piece.kind == "cylinder":
        return fcl.Cylinder(*piece.size_m)
    faces = np.column_stack([np.full(len(piece.faces), 3), piece.faces]).ravel()
    return fcl.Convex(np.array(piece.vertices_m), len(piece.faces), faces)


class FclEngine:
    """fcl on one pair at a time (holds one object per piece; not thread-safe)."""

    name = "fcl"

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._shapes = [fcl_geometry(p) for p in pieces]
        self._objects = [fcl.CollisionObject(shape, fcl.Transform()) for shape in self._shapes]
        self._contacts = fcl.CollisionRequest(num_max_contacts=4, enable_contact=True)
        self._plain = fcl.CollisionRequest()
        self._request = fcl.DistanceRequest(enable_nearest_points=True)

    def distance(self, a: int, b: int, pose_a: Array, pose_b: Array) -> PairDistance:
        """Distance with nearest points; in penetration fcl's largest contact depth.

        fcl overestimates some distances by up to 0.35 mm (capsule and box) and its depth is one
        of several legal ones: compare, do not certify.
        """
        first, second = self._place(a, b, pose_a, pose_b)
        touching = fcl.CollisionResult()
        if fcl.collide(first, second, self._contacts, touching):
            contact = max(touching.contacts, key=lambda c: c.penetration_depth)
            normal = np.array(contact.normal)
            if contact.o1 is self._shapes[b]:  # fcl may report the pair in the other order
                normal = -normal
            depth, middle = float(contact.penetration_depth), np.array(contact.pos)
            return PairDistance(
                -depth, middle + normal * depth / 2, middle - normal * depth / 2, normal
            )
        result = fcl.DistanceResult()
        distance = float(fcl.distance(first, second, self._request, result))
        point_a, point_b = (np.array(p, dtype=float) for p in result.nearest_points)
        normal = point_b - point_a
        length = float(np.linalg.norm(normal))
        return PairDistance(
            distance, point_a, point_b, normal / length if length > 0 else np.array([0.0, 0, 1])
        )

    def touches(self, a: int, b: int, pose_a: Array, pose_b: Array) -> bool:
        """Whether fcl's boolean collision test finds an overlap."""
        first, second = self._place(a, b, pose_a, pose_b)
        return bool(fcl.collide(first, second, self._plain, fcl.CollisionResult()))

    def _place(
        self, a: int, b: int, pose_a: Array, pose_b: Array
    ) -> tuple[fcl.CollisionObject, fcl.CollisionObject]:
        first, second = self._objects[a], self._objects[b]
        for item, pose in ((first, pose_a), (second, pose_b)):
            item.setTransform(fcl.Transform(pose[:9].reshape(3, 3), pose[9:12]))
        return first, second
