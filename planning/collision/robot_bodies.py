"""Collision bodies of a robot's links, from the `collision` elements of its URDF."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from dmoc.robot.robot import PlacedShape, Robot
from planning.collision.pieces import Mounted
from planning.geometry.convex import convex_shape
from planning.geometry.decompose import mesh_pieces
from planning.geometry.mesh import Mesh, is_watertight, load_link_mesh
from planning.geometry.shapes import SOLIDS, Body, Shape

HULL_EXCESS = 1.2
MOST_PIECES = 8
TOLERANCE_M = 0.01


def link_bodies(robot: Robot) -> tuple[Mounted, ...]:
    """One body per link that has collision geometry, meshes replaced by convex pieces over them.

    A mesh becomes its hull, or up to eight pieces where the hull holds more than 1.2 times its
    volume; both cover it, so distances are never too large. Link 0 (the base) stands at the
    robot's base pose.
    """
    shapes: dict[str, list[Shape]] = {}
    joints: dict[str, int] = {}
    for item in robot.link_shapes():
        shapes.setdefault(item.link, []).extend(link_pieces(item, robot))
        joints[item.link] = item.joint
    return tuple(
        Mounted(Body(link, tuple(parts)), joints[link], np.eye(4)) for link, parts in shapes.items()
    )


def link_pieces(item: PlacedShape, robot: Robot) -> tuple[Shape, ...]:
    """The primitive, or convex pieces over the mesh, of a link's shape in the joint's frame."""
    pose, kind = item.placement.homogeneous, item.shape.kind
    if kind == "mesh":
        mesh = load_link_mesh(item.shape, str(robot.urdf), f"link {item.link}.collision")
        pieces = _link_pieces(mesh.vertices_m.tobytes(), mesh.faces.tobytes())
        return tuple(replace(piece, pose=pose) for piece in pieces)
    return (Shape(SOLIDS[kind], item.shape.size_m, pose=pose),)


@lru_cache(maxsize=128)
def _link_pieces(vertices_bytes: bytes, faces_bytes: bytes) -> tuple[Shape, ...]:
    """Convex pieces over a link's mesh: its hull, or several where the hull is far too large."""
    vertices = np.frombuffer(vertices_bytes).reshape(-1, 3)
    faces = np.frombuffer(faces_bytes, dtype=np.int64).reshape(-1, 3)
    # STL repeats the corners of every triangle: join them to see whether the surface is closed.
    vertices, joined = np.unique(vertices.round(9), axis=0, return_inverse=True)
    faces = joined.reshape(-1)[faces]
    first, second, third = faces.T
    faces = faces[(first != second) & (second != third) & (third != first)]
    corners = vertices[faces]
    volume = abs(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    closed = is_watertight(faces)
    if closed and ConvexHull(vertices).volume > HULL_EXCESS * volume:
        return mesh_pieces(Mesh(vertices, faces, closed), MOST_PIECES, TOLERANCE_M)
    return (convex_shape(vertices),)


def tool_mounts(robot: Robot, tool_bodies: tuple[Body, ...]) -> tuple[Mounted, ...]:
    """Tool bodies on the joint that carries the flange; `body.pose` is T_flange_body."""
    frame = robot.model.frames[robot.flange_id]
    flange = frame.placement.homogeneous
    return tuple(Mounted(b, int(frame.parentJoint), flange @ b.pose) for b in tool_bodies)
