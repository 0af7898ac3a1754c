"""Triangles of everything that a picture of a station shows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from planning.geometry.shapes import Body, Shape

Colour = tuple[int, int, int]
_PLAIN: Colour = (150, 152, 158)


@dataclass(frozen=True)
class Triangles:
    """Vertices (V, 3) [m] in the parent's frame and faces (F, 3); `colour` 0–255."""

    name: str
    vertices_m: Array
    faces: npt.NDArray[np.int64]
    colour: Colour = _PLAIN

    def moved(self, pose: Array) -> Triangles:
        """The same in another frame, by `pose` (4, 4)."""
        move = np.asarray(pose)
        vertices = np.asarray(self.vertices_m) @ move[:3, :3].T + move[:3, 3]
        return Triangles(self.name, vertices, np.asarray(self.faces, dtype=np.int64), self.colour)


def shape_triangles(name: str, shape: Shape, colour: Colour = _PLAIN) -> Triangles:
    """Triangles of a shape in its body's frame."""
    # Imported when a scene is drawn: trimesh takes longer to import than most commands to run.
    import trimesh

    if shape.kind == "box":
        mesh = trimesh.creation.box(extents=shape.size_m)
    elif shape.kind == "cylinder":
        mesh = trimesh.creation.cylinder(radius=shape.size_m[0], height=shape.size_m[1])
    elif shape.kind == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=shape.size_m[0])
    elif shape.kind == "mesh":
        mesh = trimesh.Trimesh(shape.vertices_m, shape.faces, process=False)
    else:
        mesh = trimesh.convex.convex_hull(np.array(shape.vertices_m))
    return Triangles(name, mesh.vertices, mesh.faces, colour).moved(shape.pose)


def body_triangles(body: Body, colour: Colour = _PLAIN) -> list[Triangles]:
    """Triangles of a body in its parent's frame: its mesh where it has one, else its shapes."""
    shapes = (body.mesh,) if body.mesh is not None else body.shapes
    return [
        shape_triangles(f"{body.name}/{number}", shape, colour).moved(body.pose)
        for number, shape in enumerate(shapes)
    ]


def robot_triangles(robot: Robot) -> list[list[Triangles]]:
    """Visual shapes of the URDF (collision shapes if none) per joint frame; number 0 is the base.

    Base shapes are in the world frame of a robot that stands at `robot.base`.
    """
    frames: list[list[Triangles]] = [[] for _ in range(robot.model.njoints)]
    model = _geometry(robot, pin.GeometryType.VISUAL)
    if model.ngeoms == 0:
        model = _geometry(robot, pin.GeometryType.COLLISION)
    for item in model.geometryObjects:
        red, green, blue = (round(255 * float(part)) for part in item.meshColor[:3])
        mesh = _urdf_mesh(item, robot.urdf.parent)
        placement = item.placement
        if item.parentJoint == 0:
            placement = robot.base * placement
        plain = Triangles(item.name, mesh.vertices, mesh.faces, (red, green, blue))
        frames[item.parentJoint].append(plain.moved(placement.homogeneous))
    return frames


def _geometry(robot: Robot, kind: Any) -> pin.GeometryModel:
    plain = pin.buildModelFromUrdf(str(robot.urdf))
    return pin.buildGeomFromUrdf(
        plain, str(robot.urdf), kind, package_dirs=[str(robot.urdf.parent)]
    )


def _urdf_mesh(item: Any, folder: Path) -> Any:
    import trimesh

    shape = item.geometry
    kind = type(shape).__name__
    if kind == "Box":
        return trimesh.creation.box(extents=2 * np.array(shape.halfSide).ravel())
    if kind == "Cylinder":
        return trimesh.creation.cylinder(radius=shape.radius, height=2 * shape.halfLength)
    if kind == "Sphere":
        return trimesh.creation.icosphere(subdivisions=2, radius=shape.radius)
    if kind == "Capsule":
        return trimesh.creation.capsule(radius=shape.radius, height=2 * shape.halfLength)
    path = Path(item.meshPath)
    mesh = trimesh.load(path if path.is_absolute() else folder / path, force="mesh")
    mesh.apply_scale(np.array(item.meshScale).ravel())
    return mesh
