"""The paper's collision routine: all samples of a timed trajectory, broad times narrow phase.

Broad phases: `ssap` (sweep and prune), `aabb_tree` (dynamic tree), `obb` (all pairs of oriented
boxes by separating axes), `capsules` (all samples at once, compiled: only pairs whose covering
capsules meet go on), `none`. Narrow phases: `gjk`, `gjk_nesterov` (on the solids), `bvh`
(triangle meshes; stands in for V-Clip, which no wheel offers). `schedule` uses coordination maps
instead; this is here to be measured against them and for cells whose paths change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np

from dmoc.jit import njit
from planning.geometry.shapes import Body
from sequencing.timing.cell.types import CellRobot
from sequencing.timing.clearance.arms import ArmShapes, arm_shapes, body_shapes, joint_frames
from sequencing.timing.clearance.segments import segment_distance

# mypy: disallow-untyped-defs=False


@njit
def boxes_overlap(first, half_a, second, half_b, offset):
    """True unless a face normal or a cross product of edges separates the boxes.

    `first`, `second` (3, 3) are the boxes' axes as columns, `half` (3,) half their edges, `offset`
    (3,) from the one centre to the other, all in the world.
    """
    turn = first.T @ second
    shift = first.T @ offset
    size = np.abs(turn) + 1e-12
    for i in range(3):
        reach = half_a[i] + half_b[0] * size[i, 0] + half_b[1] * size[i, 1] + half_b[2] * size[i, 2]
        if abs(shift[i]) > reach:
            return False
    for j in range(3):
        along = shift[0] * turn[0, j] + shift[1] * turn[1, j] + shift[2] * turn[2, j]
        reach = half_b[j] + half_a[0] * size[0, j] + half_a[1] * size[1, j] + half_a[2] * size[2, j]
        if abs(along) > reach:
            return False
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            along = shift[i2] * turn[i1, j] - shift[i1] * turn[i2, j]
            reach = half_a[i1] * size[i2, j] + half_a[i2] * size[i1, j]
            reach += half_b[j1] * size[i, j2] + half_b[j2] * size[i, j1]
            if abs(along) > reach:
                return False
    return True


# mypy: disallow-untyped-defs=False


BROAD = ("ssap", "aabb_tree", "obb", "capsules", "none")
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
        self.scene = scene
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
        if self.broad == "capsules":
            return self._first_by_capsules(frames)
        for k in range(len(q_rad[0])):
            for group, shapes, frame in zip(self.things, self.shapes, frames):
                for c, thing in enumerate(group):
                    self._place(thing, shapes, frame, c, k)
                    if self.managers:
                        thing.obj.computeAABB()
            if self._collides():
                return k
        return -1

    def _first_by_capsules(self, frames: list[tuple[np.ndarray, np.ndarray]]) -> int:
        ends, radii, groups = [], [], list(self.things)
        for shapes, (rotation, origin) in zip(self.shapes, frames):
            turn, joint = rotation[:, shapes.joint], shapes.joint
            # (K, C, 2, 3): both capsule ends of every solid at every sample.
            placed = shapes.ends_m @ np.swapaxes(turn, 2, 3) + origin[:, joint, None]
            ends.append(np.ascontiguousarray(placed))
            radii.append(shapes.radius_m)
        if self.scene is not None:
            ends.append(self.scene.ends_m[None])
            radii.append(self.scene.radius_m)
            groups.append(self.static)
        near = []
        for i in range(len(self.shapes)):
            for j in range(i + 1, len(groups)):
                rows = _near_capsules(ends[i], radii[i], ends[j], radii[j])
                near += [(k, i, c, j, d) for k, c, d in rows.tolist()]
        result = coal.CollisionResult()
        for k, i, c, j, d in sorted(near):
            for g, s in ((i, c), (j, d)):
                if g < len(self.shapes):
                    self._place(groups[g][s], self.shapes[g], frames[g], s, k)
            result.clear()
            if coal.collide(groups[i][c].obj, groups[j][d].obj, self.request, result):
                return int(k)
        return -1

    @staticmethod
    def _place(
        thing: _Thing, shapes: ArmShapes, frames: tuple[np.ndarray, np.ndarray], c: int, k: int
    ) -> None:
        j, pose = shapes.joint[c], shapes.pose[c]
        turn = frames[0][k, j]
        thing.obj.setTransform(
            coal.Transform3s(turn @ pose[:3, :3], turn @ pose[:3, 3] + frames[1][k, j])
        )

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


@njit
def _near_capsules(ends_a, radius_a, ends_b, radius_b):
    """Rows (sample, solid of a, solid of b) whose capsules meet; b may have one sample only."""
    samples = ends_a.shape[0]
    moving = ends_b.shape[0] > 1
    out = np.empty((samples * len(radius_a) * len(radius_b), 3), dtype=np.int64)
    count = 0
    for k in range(samples):
        m = k if moving else 0
        for c in range(len(radius_a)):
            for d in range(len(radius_b)):
                reach = radius_a[c] + radius_b[d]
                # The middles first: cheap, and far apart for most pairs.
                gap = 0.0
                half = 0.0
                for x in range(3):
                    one = ends_a[k, c, 1, x] - ends_a[k, c, 0, x]
                    two = ends_b[m, d, 1, x] - ends_b[m, d, 0, x]
                    middle = ends_a[k, c, 0, x] - ends_b[m, d, 0, x] + 0.5 * (one - two)
                    gap += middle * middle
                    half += one * one + two * two
                # (a + b)^2 <= 2 (a^2 + b^2) bounds the sum of the half lengths.
                far = reach + np.sqrt(0.5 * half)
                if gap > far * far:
                    continue
                if segment_distance(ends_a[k, c], ends_b[m, d]) <= reach:
                    out[count, 0], out[count, 1], out[count, 2] = k, c, d
                    count += 1
    return out[:count]


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


def _mesh(solid: coal.CollisionGeometry) -> coal.CollisionGeometry:
    """Triangle mesh (BVH of oriented boxes) around a primitive; a mesh stays as it is."""
    if isinstance(solid, coal.BVHModelBase):
        return solid
    if isinstance(solid, coal.Box):
        corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * np.array(solid.halfSide)
    elif isinstance(solid, coal.Cylinder):
        sides = 24
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
