"""Triangles of everything that a picture of a station shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.errors import MeshError
from dmoc.robot.robot import PlacedShape, Robot
from planning.geometry.mesh import load_link_mesh
from planning.geometry.shapes import SOLIDS, Body, Shape

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
    """Visual shapes of every link (else its collision shapes) per joint frame; 0 is the base.

    A picture that cannot be read costs the picture: its link is drawn by its collision shapes.
    Base shapes are in the world frame of a robot that stands at `robot.base`.
    """
    frames: list[list[Triangles]] = [[] for _ in range(robot.model.njoints)]
    drawn: set[str] = set()
    for visual in (True, False):
        found: dict[str, list[tuple[int, Triangles]]] = {}
        broken = set()
        for number, item in enumerate(robot.link_shapes(visual)):
            try:
                triangles = _placed(f"{item.link}_{number}", item, robot)
                found.setdefault(item.link, []).append((item.joint, triangles))
            except MeshError:
                broken.add(item.link)
        for link in [name for name in found if name not in drawn | broken]:
            drawn.add(link)
            for joint, triangles in found[link]:
                frames[joint].append(triangles)
    return frames


def _placed(name: str, item: PlacedShape, robot: Robot) -> Triangles:
    red, green, blue = (round(255 * part) for part in item.shape.colour)
    pose = item.placement.homogeneous
    if item.shape.kind == "mesh":
        mesh = load_link_mesh(item.shape, str(robot.urdf), f"link {item.link}")
        shape = Shape("mesh", vertices_m=mesh.vertices_m, faces=mesh.faces, pose=pose)
    else:
        shape = Shape(SOLIDS[item.shape.kind], item.shape.size_m, pose=pose)
    return shape_triangles(name, shape, (red, green, blue))
