"""The paper's collision routine: all samples of a timed trajectory, broad times narrow phase.

Broad phases: `ssap` (sweep and prune), `aabb_tree` (dynamic tree), `obb` (all pairs of oriented
boxes by separating axes), `none`. Narrow phases: `gjk`, `gjk_nesterov` (on the solids), `bvh`
(triangle meshes; stands in for V-Clip, which no wheel offers). `schedule` uses coordination maps
instead; this is here to be measured against them and for cells whose paths change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np

from planning.shapes import Body
from sequencing.timing.arm_shapes import ArmShapes, arm_shapes, body_shapes, joint_frames
from sequencing.timing.cell_types import CellRobot
from sequencing.timing.obb import boxes_overlap

__all__ = ["BROAD", "NARROW", "SampledCheck"]

BROAD = ("ssap", "aabb_tree", "obb", "none")
NARROW = ("gjk", "gjk_nesterov", "bvh")


@dataclass(eq=False)
class _Thing:
    """One solid: its group (robot number, -1 for obstacles) and its places at all samples."""

    group: int
    obj: coal.CollisionObject
    half: np.ndarray
    centre: np.ndarray


class SampledCheck:
    """Checks timed trajectories of several robots (and obstacles) at given joint vectors.

    `broad` and `narrow` are of `BROAD` and `NARROW`; bodies named in `skip` are left out.
    """

    def __init__(
        self,
        robots: Sequence[CellRobot],
        obstacles: Sequence[Body] = (),
        broad: str = "ssap",
        narrow: str = "gjk",
        skip: Sequence[str] = (),
    ) -> None:
        self.robots, self.broad = robots, broad
        self.request = coal.CollisionRequest()
        if narrow == "gjk_nesterov":
            self.request.gjk_variant = coal.GJKVariant.NesterovAcceleration
        self.shapes: list[ArmShapes] = [arm_shapes(r.robot, r.tool_bodies, skip) for r in robots]
        self.things: list[list[_Thing]] = []
        for r, shapes in enumerate(self.shapes):
            self.things.append([_thing(r, solid, narrow) for solid in shapes.solids])
        scene = body_shapes(obstacles) if obstacles else None
        self.static: list[_Thing] = []
        if scene is not None:
            for solid, pose in zip(scene.solids, scene.pose):
                thing = _thing(-1, solid, narrow)
                thing.obj.setTransform(coal.Transform3s(pose[:3, :3], pose[:3, 3]))
                thing.obj.computeAABB()
                self.static.append(thing)
        self.managers = []
        if broad in ("ssap", "aabb_tree"):
            kind = (
                coal.SSaPCollisionManager
                if broad == "ssap"
                else coal.DynamicAABBTreeCollisionManager
            )
            for group in [*self.things, *([self.static] if self.static else [])]:
                manager = kind()
                for thing in group:
                    manager.registerObject(thing.obj)
                manager.setup()
                self.managers.append(manager)

    def first_collision(self, q_rad: Sequence[np.ndarray]) -> int:
        """Index of the first sample at which anything collides, -1 if none does.

        `q_rad` holds one array (K, n) a robot, sampled at the same K instants.
        """
        frames = [joint_frames(r.robot, q) for r, q in zip(self.robots, q_rad)]
        for k in range(len(q_rad[0])):
            for group, shapes, (rotation, origin) in zip(self.things, self.shapes, frames):
                for c, thing in enumerate(group):
                    j, pose = shapes.joint[c], shapes.pose[c]
                    turn = rotation[k, j]
                    thing.obj.setTransform(
                        coal.Transform3s(turn @ pose[:3, :3], turn @ pose[:3, 3] + origin[k, j])
                    )
                    if self.managers:
                        thing.obj.computeAABB()
            if self._collides():
                return k
        return -1

    def _collides(self) -> bool:
        if self.managers:
            for manager in self.managers:
                manager.update()
            for i, first in enumerate(self.managers):
                for second in self.managers[i + 1 :]:
                    callback = coal.CollisionCallBackDefault()
                    callback.data.request = self.request
                    first.collide(second, callback)
                    if callback.data.result.isCollision():
                        return True
            return False
        groups = [*self.things, *([self.static] if self.static else [])]
        result = coal.CollisionResult()
        for i, first in enumerate(groups):
            for second in groups[i + 1 :]:
                for a in first:
                    for b in second:
                        if self.broad == "obb" and not _near(a, b):
                            continue
                        result.clear()
                        if coal.collide(a.obj, b.obj, self.request, result):
                            return True
        return False


def _near(a: _Thing, b: _Thing) -> bool:
    pa, pb = a.obj.getTransform(), b.obj.getTransform()
    ra, rb = pa.getRotation(), pb.getRotation()
    offset = (pb.getTranslation() + rb @ b.centre) - (pa.getTranslation() + ra @ a.centre)
    return bool(boxes_overlap(ra, a.half, rb, b.half, offset))


def _thing(group: int, solid: coal.CollisionGeometry, narrow: str) -> _Thing:
    solid.computeLocalAABB()
    box = solid.aabb_local
    half = 0.5 * (np.array(box.max_) - np.array(box.min_))
    centre = 0.5 * (np.array(box.max_) + np.array(box.min_))
    shape = _mesh(solid) if narrow == "bvh" else solid
    return _Thing(group, coal.CollisionObject(shape), half, centre)


def _mesh(solid: coal.CollisionGeometry, sides: int = 24) -> coal.CollisionGeometry:
    """Triangle mesh (BVH of oriented boxes) around a primitive; a mesh stays as it is."""
    if isinstance(solid, coal.BVHModelBase):
        return solid
    if isinstance(solid, coal.Box):
        corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * np.array(solid.halfSide)
    elif isinstance(solid, coal.Cylinder):
        angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
        grow = solid.radius / np.cos(np.pi / sides)  # the prism contains the cylinder
        ring = grow * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        corners = np.vstack(
            [
                np.column_stack([ring, np.full(sides, z)])
                for z in (-solid.halfLength, solid.halfLength)
            ]
        )
    else:
        return solid
    hull = coal.BVHModelOBBRSS()
    hull.beginModel(0, len(corners))
    hull.addVertices(np.ascontiguousarray(corners))
    hull.endModel()
    hull.buildConvexHull(True, "Qt")
    convex = hull.convex
    points = np.array(convex.points())
    model = coal.BVHModelOBBRSS()
    model.beginModel(convex.num_polygons, len(points))
    for k in range(convex.num_polygons):
        triangle = convex.polygons(k)
        model.addTriangle(points[triangle[0]], points[triangle[1]], points[triangle[2]])
    model.endModel()
    return model
