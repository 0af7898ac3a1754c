"""The solids of an arm (links, tool, load) as capsules that cover them, and as exact coal shapes.

Capsules (a segment and a radius) make a distance cost some 20 ns; they are never smaller than the
solid, so a distance between capsules is a lower bound of the true one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from dmoc.errors import ProblemError
from dmoc.robot.robot import Robot
from planning.collision.pieces import Mounted, Piece, piece_of
from planning.collision.robot_bodies import link_bodies, tool_mounts
from planning.geometry.shapes import Body, Shape


@dataclass(frozen=True, eq=False)
class ArmShapes:
    """C solids of one arm: `joint` (C,) carries each; all geometry in that joint's frame.

    `ends_m` (C, 2, 3) and `radius_m` (C,) are the covering capsules, `solids` the coal geometries
    at `pose` (C, 4, 4), `names` the bodies they belong to, `pieces` the same solids for our own
    kernels. Joint 0 does not move.
    """

    joint: np.ndarray
    ends_m: np.ndarray
    radius_m: np.ndarray
    pose: np.ndarray
    solids: tuple[coal.CollisionGeometry, ...]
    names: tuple[str, ...]
    pieces: tuple[Piece, ...]


def arm_shapes(
    robot: Robot,
    tool_bodies: Sequence[Body] = (),
    skip: Sequence[str] = (),
    first_joint: int = 0,
) -> ArmShapes:
    """Collision solids of `robot` at its base, `tool_bodies` on its flange, without `skip` and
    without those that joints before `first_joint` carry."""
    mounts = (*link_bodies(robot), *tool_mounts(robot, tuple(tool_bodies)))
    kept = (mount for mount in mounts if mount.joint >= first_joint)
    return _collect([mount for mount in kept if mount.body.name not in skip])


def body_shapes(bodies: Sequence[Body]) -> ArmShapes:
    """Obstacles as solids that never move (joint 0)."""
    return _collect([Mounted(body, 0, body.pose) for body in bodies])


def _collect(mounts: Sequence[Mounted]) -> ArmShapes:
    joint, ends, radius, poses, solids, names, pieces = [], [], [], [], [], [], []
    for mount in mounts:
        for shape in mount.body.shapes:
            pose = np.asarray(mount.pose) @ np.asarray(shape.pose)
            a, b, r = _capsule(shape)
            joint.append(mount.joint)
            ends.append([pose[:3, :3] @ a + pose[:3, 3], pose[:3, :3] @ b + pose[:3, 3]])
            radius.append(r)
            poses.append(pose)
            solids.append(coal_solid(shape))
            names.append(mount.body.name)
            pieces.append(piece_of(shape, mount.body.name, mount.joint, mount.pose))
    return ArmShapes(
        np.array(joint, dtype=np.int64),
        np.array(ends),
        np.array(radius),
        np.array(poses),
        tuple(solids),
        tuple(names),
        tuple(pieces),
    )


def _capsule(shape: Shape) -> tuple[np.ndarray, np.ndarray, float]:
    """Segment ends and radius of a capsule that covers `shape`, in the shape's frame."""
    if shape.kind == "sphere":
        return np.zeros(3), np.zeros(3), float(shape.size_m[0])
    if shape.kind == "cylinder":
        return _round_rod(np.eye(3)[2], float(shape.size_m[0]), 0.5 * float(shape.size_m[1]))
    if shape.kind == "box":
        half = 0.5 * np.asarray(shape.size_m)
        axis = int(np.argmax(half))
        return _round_rod(np.eye(3)[axis], float(np.linalg.norm(np.delete(half, axis))), half[axis])
    vertices = np.asarray(shape.vertices_m)
    centre = vertices.mean(axis=0)
    axes = np.linalg.svd(vertices - centre, full_matrices=False)[2]
    along = (vertices - centre) @ axes[0]
    middle = centre + 0.5 * (along.min() + along.max()) * axes[0]
    offset = vertices - middle
    across = offset - np.outer(offset @ axes[0], axes[0])
    radius = float(np.linalg.norm(across, axis=1).max())
    a, b, r = _round_rod(axes[0], radius, 0.5 * float(np.ptp(along)))
    return a + middle, b + middle, r


def _round_rod(
    axis: np.ndarray, radius: float, half: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """The capsule over a rod: a short fat one gets a slightly larger radius and shorter ends.

    With the ends drawn in by c, the rim at (radius, half) is covered if r^2 >= radius^2 + c^2;
    c = radius / 3 adds 5 % to the radius and takes a third off each round end.
    """
    draw = min(half, radius / 3.0)
    return -(half - draw) * axis, (half - draw) * axis, float(np.hypot(radius, draw))


def coal_solid(shape: Shape) -> coal.CollisionGeometry:
    """The exact coal geometry of a shape (a convex hull of its points for `convex`)."""
    size = shape.size_m
    if shape.kind == "box":
        return coal.Box(*[float(x) for x in size])
    if shape.kind == "cylinder":
        return coal.Cylinder(float(size[0]), float(size[1]))
    if shape.kind == "sphere":
        return coal.Sphere(float(size[0]))
    points = np.ascontiguousarray(shape.vertices_m)
    if shape.kind == "convex":
        model = coal.BVHModelOBBRSS()
        model.beginModel(0, len(points))
        model.addVertices(points)
        model.endModel()
        model.buildConvexHull(True, "Qt")
        return model.convex
    if shape.kind == "mesh" and shape.faces is not None:
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(shape.faces), len(points))
        for triangle in shape.faces:
            model.addTriangle(*points[triangle])
        model.endModel()
        return model
    raise ProblemError.of(
        "shape-kind", "", "shape.kind", str(shape.kind), "box, cylinder, sphere, convex, mesh"
    )


def joint_frames(robot: Robot, q_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (K, J, 3, 3) and origins (K, J, 3) of all joints (0 is the world) at q (K, n).

    Forward kinematics of all K configurations at once, joint by joint.
    """
    model = robot.model
    q = np.asarray(q_rad, dtype=float)
    rotation = np.empty((len(q), model.njoints, 3, 3))
    origin = np.zeros((len(q), model.njoints, 3))
    rotation[:, 0] = np.eye(3)
    for j in range(1, model.njoints):
        parent, placement = int(model.parents[j]), model.jointPlacements[j]
        turn = rotation[:, parent] @ placement.rotation
        shift = origin[:, parent] + rotation[:, parent] @ placement.translation
        revolute, axis = joint_axis(robot, j)
        value = q[:, model.joints[j].idx_q]
        if revolute:
            cross = np.array(pin.skew(axis))
            sine, cosine = np.sin(value)[:, None, None], np.cos(value)[:, None, None]
            turn = turn @ (np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))
        else:
            shift = shift + (turn @ axis) * value[:, None]
        rotation[:, j], origin[:, j] = turn, shift
    return rotation, origin


def joint_axis(robot: Robot, j: int) -> tuple[bool, np.ndarray]:
    """(revolute, axis in the joint's frame) of joint j of the model."""
    name = robot.model.joints[j].shortname().removeprefix("JointModel")
    if name in ("RX", "RY", "RZ", "PX", "PY", "PZ"):
        return name[0] == "R", np.eye(3)["XYZ".index(name[1])]
    if name in ("RevoluteUnaligned", "PrismaticUnaligned"):
        return name[0] == "R", np.asarray(robot.model.joints[j].extract().axis, dtype=float)
    raise ProblemError.of(
        "joint-kind", "", str(robot.model.names[j]), name, "revolute or prismatic, one axis"
    )
