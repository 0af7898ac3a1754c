"""Geometry as data: primitives, convex pieces and triangle meshes, posed in a body's frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array, StaysReadonly, readonly

Kind = Literal["box", "cylinder", "sphere", "convex", "mesh"]
SOLIDS: dict[str, Kind] = {"box": "box", "cylinder": "cylinder", "sphere": "sphere"}


def pose_matrix(position_m: Any = (0, 0, 0), quaternion_xyzw: Any = (0, 0, 0, 1)) -> Array:
    """Homogeneous (4, 4) T_parent_child of a position [m] and a quaternion."""
    x, y, z, w = np.asarray(quaternion_xyzw, dtype=float) / np.linalg.norm(quaternion_xyzw)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = position_m
    return matrix


@dataclass(frozen=True, eq=False)
class Shape(StaysReadonly):
    """One solid (or, for `mesh`, one triangle soup) in its body's frame.

    `size_m`: box (x, y, z edge lengths); cylinder (radius, length, axis z, centred); sphere
    (radius,); empty otherwise. `vertices_m` (V, 3) for convex and mesh; `faces` (F, 3)
    for mesh, and for convex the hull's triangles where they are known (normals outwards).
    """

    kind: Kind
    size_m: tuple[float, ...] = ()
    vertices_m: Array | None = None
    faces: npt.NDArray[np.int64] | None = None
    pose: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", readonly(self.pose, "shape.pose", ndim=2))
        if self.vertices_m is not None:
            object.__setattr__(self, "vertices_m", readonly(self.vertices_m, "vertices_m", 2))
        if self.faces is not None:
            faces = np.array(self.faces, dtype=np.int64)
            faces.setflags(write=False)
            object.__setattr__(self, "faces", faces)


@dataclass(frozen=True, eq=False)
class Body(StaysReadonly):
    """A named rigid body: convex `shapes` cover it (distances are measured to them).

    `mesh` keeps the original triangles, where there are any (pictures, second opinion, sampled
    cover check). `pose` is T_world_body for an obstacle and T_flange_body for a tool body.
    `touches` marks the tool body that may touch the part at a weld (the gun's tip).
    """

    name: str
    shapes: tuple[Shape, ...]
    mesh: Shape | None = None
    pose: Array = field(default_factory=lambda: np.eye(4))
    touches: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", readonly(self.pose, "body.pose", ndim=2))
