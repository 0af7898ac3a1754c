"""Convex pieces: what distances are measured between.

A piece is one convex solid fixed to one joint's frame. Its surface is a core (vertices, box,
cylinder or point) grown by `margin_m`; a sphere is a point with a margin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from dmoc.arrays import Array
from dmoc.errors import MeshError
from planning.geometry.shapes import Body, Shape

_LENGTHS = {"box": 3, "cylinder": 2, "sphere": 1}


@dataclass(frozen=True)
class Mounted:
    """A body fixed to joint `joint` (0 is the world) at `pose`, T_joint_body (4, 4)."""

    body: Body
    joint: int
    pose: Array


@dataclass(frozen=True)
class Piece:
    """One convex solid on joint `joint`, at `pose` T_joint_piece (4, 4).

    `kind` is box, cylinder, sphere or convex; `size_m` as in `Shape`; `vertices_m` (V, 3) and
    outward `faces` (F, 3) for a convex one. `box_centre_m`, `box_half_m` (3,) are a box in the
    piece's axes around all of it; `ball_centre_m` (3,), `ball_radius_m` a ball around it.
    """

    body: str
    joint: int
    pose: Array
    kind: str
    size_m: tuple[float, ...]
    vertices_m: Array
    faces: npt.NDArray[np.int64]
    box_centre_m: Array
    box_half_m: Array
    ball_centre_m: Array
    ball_radius_m: float


def convex_hull(points_m: Array, where: str = "vertices_m") -> tuple[Array, npt.NDArray[np.int64]]:
    """Hull vertices (V, 3) and faces (F, 3) with outward normals of points (P, 3).

    Errors: `MeshError` for NaN, fewer than four points, or points in one plane (give a sheet a
    thickness: a plane has no inside and no depth of penetration).
    """
    points = np.asarray(points_m, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.all(np.isfinite(points)):
        raise MeshError.of(
            "mesh-vertices",
            field=where,
            value=f"shape {points.shape}, or not finite",
            legal="(V, 3) finite numbers",
            fix="mend or re-export the mesh",
        )
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise MeshError.of(
            "mesh-flat",
            field=where,
            value=f"{len(points)} points without volume",
            legal="at least four points that are not in one plane",
            fix="give the sheet a thickness",
        ) from error
    keep = hull.vertices
    renumber = np.full(len(points), -1)
    renumber[keep] = np.arange(len(keep))
    faces = renumber[hull.simplices].astype(np.int64)
    corners = points[keep][faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normal, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return points[keep], faces


def piece_of(shape: Shape, body: str, joint: int, pose: Array) -> Piece:
    """The piece of one shape; `pose` is T_joint_body (4, 4)."""
    where = f"{body}.{shape.kind}"
    vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    if shape.kind in _LENGTHS:
        size = tuple(float(s) for s in shape.size_m)
        if len(size) != _LENGTHS[shape.kind] or not all(np.isfinite(size)) or min(size) <= 0:
            raise MeshError.of(
                "shape-size",
                field=where,
                value=str(shape.size_m),
                legal=f"{_LENGTHS[shape.kind]} positive lengths [m]",
                fix="box: x, y, z; cylinder: radius, length; sphere: radius",
            )
        half = {
            "box": lambda: np.array(size) / 2,
            "cylinder": lambda: np.array([size[0], size[0], size[1] / 2]),
            "sphere": lambda: np.full(3, size[0]),
        }[shape.kind]()
        centre, ball_centre = np.zeros(3), np.zeros(3)
        radius = size[0] if shape.kind == "sphere" else float(np.linalg.norm(half))
        if shape.kind == "cylinder":
            radius = float(np.hypot(size[0], size[1] / 2))
    elif shape.kind == "convex" and shape.vertices_m is not None:
        size = ()
        vertices, faces = convex_hull(shape.vertices_m, where)
        lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
        centre, half = (lowest + highest) / 2, (highest - lowest) / 2
        ball_centre = centre
        radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    else:
        raise MeshError.of(
            "shape-kind",
            field=where,
            value=shape.kind,
            legal="box, cylinder, sphere, convex (with vertices)",
            fix="decompose the mesh into convex pieces and keep it as the body's `mesh`",
        )
    placed = np.asarray(pose) @ shape.pose
    return Piece(
        body=body,
        joint=joint,
        pose=placed,
        kind=shape.kind,
        size_m=size,
        vertices_m=vertices,
        faces=faces,
        box_centre_m=centre,
        box_half_m=half,
        ball_centre_m=ball_centre,
        ball_radius_m=radius,
    )


def pieces_of(mounted: Mounted) -> tuple[Piece, ...]:
    """All pieces of a body.

    Errors: `MeshError` for a body without shapes: an obstacle that vanished is no free space.
    """
    if not mounted.body.shapes:
        raise MeshError.of(
            "body-empty",
            field=mounted.body.name,
            value="no shapes",
            legal="at least one convex shape",
            fix="check the mesh file or the shape list",
        )
    return tuple(
        piece_of(shape, mounted.body.name, mounted.joint, mounted.pose)
        for shape in mounted.body.shapes
    )
