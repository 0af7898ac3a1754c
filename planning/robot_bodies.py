"""Collision bodies of a robot's links, from the `collision` elements of its URDF."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from dmoc.errors import Fault, RobotError
from dmoc.robot import Robot
from planning.pieces import Mounted
from planning.shapes import Body, Shape

__all__ = ["link_bodies", "tool_mounts"]


def link_bodies(robot: Robot) -> tuple[Mounted, ...]:
    """One body per link that has collision geometry, meshes replaced by their convex hulls.

    The hull covers its mesh, so distances to it are never too large. Link 0 (the base) stands at
    the robot's base pose.
    """
    model = robot.model
    try:
        geometry = robot.geometry()
    except ValueError as error:
        raise RobotError(
            Fault("robot-mesh", file=str(robot.urdf), value=str(error)[:200],
                  legal="collision meshes that can be read", fix="put the mesh beside the URDF")
        ) from error  # fmt: skip
    shapes: dict[str, list[Shape]] = {}
    joints: dict[str, int] = {}
    for item in geometry.geometryObjects:
        link = model.frames[item.parentFrame].name
        shapes.setdefault(link, []).append(_shape(item, robot.urdf))
        joints[link] = int(item.parentJoint)
    return tuple(
        Mounted(Body(link, tuple(parts)), joints[link], np.eye(4)) for link, parts in shapes.items()
    )


def _shape(item: pin.GeometryObject, urdf: Path) -> Shape:
    solid, pose = item.geometry, item.placement.homogeneous
    if isinstance(solid, coal.Box):
        return Shape("box", tuple(2 * np.asarray(solid.halfSide)), pose=pose)
    if isinstance(solid, coal.Sphere):
        return Shape("sphere", (solid.radius,), pose=pose)
    if isinstance(solid, coal.Cylinder):
        return Shape("cylinder", (solid.radius, 2 * solid.halfLength), pose=pose)
    if isinstance(solid, coal.BVHModelBase):
        return Shape("convex", vertices_m=np.array(solid.vertices()), pose=pose)
    raise RobotError(
        Fault("robot-geometry", file=str(urdf), field=item.name, value=type(solid).__name__,
              legal="box, sphere, cylinder or mesh", fix="change the collision element")
    )  # fmt: skip


def tool_mounts(robot: Robot, tool_bodies: tuple[Body, ...]) -> tuple[Mounted, ...]:
    """Tool bodies on the joint that carries the flange; `body.pose` is T_flange_body."""
    frame = robot.model.frames[robot.model.getFrameId(robot.flange)]
    flange = frame.placement.homogeneous
    return tuple(Mounted(b, int(frame.parentJoint), flange @ b.pose) for b in tool_bodies)
