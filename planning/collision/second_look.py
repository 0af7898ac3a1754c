"""A second engine looks at finished motions: python-fcl, with poses of its own, sample by sample.

It shares the declarations with the first engine (which pairs count, where a weld may touch) and
the convex pieces, but no kernel: poses come from Pinocchio, bounding boxes from numpy, contacts
from fcl. Where a body or a link was read from a mesh, the original triangles are asked as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import fcl
import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory
from planning.collision.departure_line import DepartureLine
from planning.collision.fcl_engine import fcl_geometry
from planning.collision.pairs import checked_pairs
from planning.collision.pieces import Mounted, piece_of, pieces_of
from planning.collision.robot_bodies import link_bodies, link_pieces, tool_mounts
from planning.geometry.mesh import load_link_mesh
from planning.geometry.shapes import Shape
from planning.station.station import Station

#: A motion is asked at so many configurations at least, and so often in every interval.
LEAST_SAMPLES = 200
PER_INTERVAL = 6


class Touch(NamedTuple):
    """Two bodies that touch, and when [s from the motion's start]."""

    pair: tuple[str, str]
    time_s: float

    def __str__(self) -> str:
        return (
            f"python-fcl finds {self.pair[0]} and {self.pair[1]} in contact at {self.time_s:.3f} s"
        )


class _Placed(NamedTuple):
    """A shape at K samples: its poses (K, 4, 4), and boxes (K, 3) in world axes around it."""

    item: fcl.CollisionObject
    pose: Array
    low: Array
    high: Array


class _Solid(NamedTuple):
    """A shape of fcl on a joint, with a box (centre, half) around it in the shape's axes."""

    joint: int
    pose: Array
    item: fcl.CollisionObject
    centre: Array
    half: Array

    def at(self, joints: Array) -> _Placed:
        """At joint poses (K, joints, 4, 4)."""
        pose = joints[:, self.joint] @ self.pose
        turn = np.ascontiguousarray(pose[:, :3, :3])
        middle, reach = turn @ self.centre + pose[:, :3, 3], np.abs(turn) @ self.half + 1e-9
        return _Placed(self.item, pose, middle - reach, middle + reach)


class SecondLook:
    """The bodies of a station for fcl. Holds one object a shape: not thread-safe."""

    def __init__(self, station: Station) -> None:
        robot = self.robot = station.robot
        links, tools = link_bodies(robot), tool_mounts(robot, station.tool_bodies)
        standing = tuple(Mounted(body, 0, np.array(body.pose)) for body in station.obstacles)
        allowed = [*robot.allowed_collisions, *station.allowed_collisions]
        self.pairs = checked_pairs(robot.model, links, tools, standing, allowed)
        self.touching = {mount.body.name for mount in tools if mount.body.touches}
        frame = robot.model.frames[robot.model.getFrameId(robot.flange)]
        self._carrier = int(frame.parentJoint)
        self._tip = (frame.placement * robot.tool.tip).translation
        mounts = [*links, *tools, *standing]
        self._pieces = {m.body.name: _solids_of(m) for m in mounts}
        self._meshes = {
            m.body.name: [_mesh_solid(m.body.mesh, m.joint, m.pose)]
            for m in (*tools, *standing)
            if m.body.mesh is not None
        }
        self._meshes |= _link_meshes(station)

    def touch(self, trajectory: JointTrajectory, lines: Sequence[DepartureLine]) -> Touch | None:
        """The first contact that is met along a motion, or None.

        Contact of the touching tool body with the part of a line does not count where the tip lies
        in the line's tube.
        """
        times, q = _samples(trajectory)
        joints = self._joint_poses(q)
        pieces, meshes = (
            {name: [solid.at(joints) for solid in solids] for name, solids in kind.items()}
            for kind in (self._pieces, self._meshes)
        )
        first, found = len(q), None
        for pair in self.pairs:
            counts = ~self._exempt(pair, joints, lines)
            sets = [[pieces[name] for name in pair]]
            if meshes.keys() & set(pair):  # triangles, or pieces where there are none
                sets.append([meshes.get(name, pieces[name]) for name in pair])
            for a, b in ((a, b) for one, other in sets for a in one for b in other):
                at = _first_contact(a, b, counts[:first])
                if at is not None:
                    first, found = at, pair
        return None if found is None else Touch(found, float(times[first] - times[0]))

    def _joint_poses(self, q: Array) -> Array:
        """(K, joints, 4, 4)."""
        model = self.robot.model
        data = model.createData()
        poses = np.empty((len(q), model.njoints, 4, 4))
        for k, row in enumerate(q):
            pin.forwardKinematics(model, data, row)
            for j, placement in enumerate(data.oMi):
                poses[k, j] = placement.homogeneous
        return poses

    def _exempt(
        self, pair: tuple[str, str], joints: Array, lines: Sequence[DepartureLine]
    ) -> np.ndarray:
        """Where (K,) the pair may touch, because the tip is on a departure line of its part."""
        free = np.zeros(len(joints), dtype=bool)
        if not self.touching & set(pair):
            return free
        carrier = joints[:, self._carrier]
        tips = carrier[:, :3, :3] @ self._tip + carrier[:, :3, 3]
        for line in lines:
            if line.part in pair:
                offset = tips - line.tip_start_m
                along = np.clip(offset @ line.direction, 0.0, line.length_m)
                stray = np.linalg.norm(offset - along[:, None] * line.direction, axis=1)
                free |= stray <= line.stray_m
        return free


def samples_of(trajectory: JointTrajectory) -> int:
    """How many configurations of a motion are asked."""
    return max(LEAST_SAMPLES, PER_INTERVAL * trajectory.num_intervals) + 1


def _samples(trajectory: JointTrajectory) -> tuple[Array, Array]:
    times = np.linspace(trajectory.t_s[0], trajectory.t_s[-1], samples_of(trajectory))
    return times, trajectory.on(None).sample(times).q_rad


def _first_contact(a: _Placed, b: _Placed, counts: np.ndarray) -> int | None:
    """The first of the samples that count (all before another contact) at which they touch."""
    many = len(counts)
    near = (a.low[:many] <= b.high[:many]) & (b.low[:many] <= a.high[:many])
    request = fcl.CollisionRequest()
    for k in np.flatnonzero(near.all(axis=1) & counts):
        for solid in (a, b):
            pose = solid.pose[k]
            solid.item.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
        if fcl.collide(a.item, b.item, request, fcl.CollisionResult()):
            return int(k)
    return None


def _solids_of(mounted: Mounted) -> list[_Solid]:
    return [
        _Solid(
            piece.joint,
            np.asarray(piece.pose),
            fcl.CollisionObject(fcl_geometry(piece), fcl.Transform()),
            np.asarray(piece.box_centre_m),
            np.asarray(piece.box_half_m),
        )
        for piece in pieces_of(mounted)
    ]


def _mesh_solid(mesh: Shape, joint: int, pose: Array) -> _Solid:
    assert mesh.vertices_m is not None
    assert mesh.faces is not None
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices_m), len(mesh.faces))
    model.addSubModel(np.array(mesh.vertices_m), np.array(mesh.faces))
    model.endModel()
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    item = fcl.CollisionObject(model, fcl.Transform())
    return _Solid(joint, pose @ mesh.pose, item, (low + high) / 2, (high - low) / 2)


def _link_meshes(station: Station) -> dict[str, list[_Solid]]:
    """Of every link that has a mesh: its triangles, and pieces for its other shapes."""
    robot, found = station.robot, dict[str, list[_Solid]]()
    meshed = set()
    for item in robot.link_shapes():
        solids = found.setdefault(item.link, [])
        if item.shape.kind == "mesh":
            meshed.add(item.link)
            mesh = load_link_mesh(item.shape, str(robot.urdf), f"link {item.link}")
            shape = Shape("mesh", vertices_m=mesh.vertices_m, faces=mesh.faces)
            solids.append(_mesh_solid(shape, item.joint, item.placement.homogeneous))
            continue
        for shape in link_pieces(item, robot):
            piece = piece_of(shape, item.link, item.joint, np.eye(4))
            solid = fcl.CollisionObject(fcl_geometry(piece), fcl.Transform())
            solids.append(
                _Solid(
                    item.joint, np.asarray(piece.pose), solid, piece.box_centre_m, piece.box_half_m
                )
            )
    return {link: solids for link, solids in found.items() if link in meshed}
