"""Collision bodies of a robot's links, from the `collision` elements of its URDF."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from dmoc.errors import Fault, RobotError
from dmoc.robot.robot import Robot
from planning.collision.pieces import Mounted
from planning.geometry.convex import convex_shape
from planning.geometry.decompose import mesh_pieces
from planning.geometry.mesh import Mesh, is_watertight
from planning.geometry.shapes import Body, Shape

HULL_EXCESS = 1.2
MOST_PIECES = 8
TOLERANCE_M = 0.01


def link_bodies(robot: Robot) -> tuple[Mounted, ...]:
    """One body per link that has collision geometry, meshes replaced by convex pieces over them.

    A mesh becomes its hull, or up to eight pieces where the hull holds more than 1.2 times its
    volume; both cover it, so distances are never too large. Link 0 (the base) stands at the
    robot's base pose.
    """
    model = robot.model
    try:
        geometry = robot.geometry()
    except ValueError as error:
        raise RobotError(
            Fault(
                "robot-mesh",
                file=str(robot.urdf),
                value=str(error)[:200],
                legal="collision meshes that can be read",
                fix="put the mesh beside the URDF",
            )
        ) from error
    shapes: dict[str, list[Shape]] = {}
    joints: dict[str, int] = {}
    for item in geometry.geometryObjects:
        link = model.frames[item.parentFrame].name
        shapes.setdefault(link, []).extend(link_shapes(item, robot.urdf))
        joints[link] = int(item.parentJoint)
    return tuple(
        Mounted(Body(link, tuple(parts)), joints[link], np.eye(4)) for link, parts in shapes.items()
    )


def mesh_of(item: pin.GeometryObject) -> Shape | None:
    """The triangles of a link's shape in the joint's frame, None for a primitive."""
    solid = item.geometry
    if not isinstance(solid, coal.BVHModelBase):
        return None
    vertices = np.array(solid.vertices(), dtype=float)
    triangles = (solid.tri_indices(k) for k in range(solid.num_tris))
    faces = np.array([[t[0], t[1], t[2]] for t in triangles], dtype=np.int64)
    return Shape("mesh", vertices_m=vertices, faces=faces, pose=item.placement.homogeneous)


def link_shapes(item: pin.GeometryObject, urdf: Path) -> tuple[Shape, ...]:
    """The primitive, or convex pieces over the mesh, of a link's shape in the joint's frame."""
    solid, pose = item.geometry, item.placement.homogeneous
    if isinstance(solid, coal.Box):
        return (Shape("box", tuple(2 * np.asarray(solid.halfSide)), pose=pose),)
    if isinstance(solid, coal.Sphere):
        return (Shape("sphere", (solid.radius,), pose=pose),)
    if isinstance(solid, coal.Cylinder):
        return (Shape("cylinder", (solid.radius, 2 * solid.halfLength), pose=pose),)
    mesh = mesh_of(item)
    if mesh is not None:
        assert mesh.vertices_m is not None
        assert mesh.faces is not None
        pieces = _link_pieces(mesh.vertices_m.tobytes(), mesh.faces.tobytes())
        return tuple(replace(piece, pose=pose) for piece in pieces)
    raise RobotError(
        Fault(
            "robot-geometry",
            file=str(urdf),
            field=item.name,
            value=type(solid).__name__,
            legal="box, sphere, cylinder or mesh",
            fix="change the collision element",
        )
    )


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
    frame = robot.model.frames[robot.model.getFrameId(robot.flange)]
    flange = frame.placement.homogeneous
    return tuple(Mounted(b, int(frame.parentJoint), flange @ b.pose) for b in tool_bodies)
