"""What an engine is: the distance of two convex pieces at given poses."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from dmoc.arrays import Array

__all__ = ["Engine", "PairDistance"]


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
