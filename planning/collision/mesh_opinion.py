"""Second opinion on the original triangles: what the convex pieces stand in for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import coal
import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from planning.collision.coal_engine import coal_geometry
from planning.geometry.shapes import Shape

if TYPE_CHECKING:
    from planning.collision.world import CollisionWorld


class MeshOpinion:
    """Distances with the triangle meshes of those bodies that keep one, by coal's BVH.

    Bodies without a mesh are measured by their pieces. Two limits of triangle soups, for which the
    convex pieces are the judge: a body wholly inside a closed mesh reads as free, and meshes have
    no depth of penetration (0 where triangles cross). Not thread-safe.
    """

    def __init__(self, world: CollisionWorld) -> None:
        self.world = world
        scene = world.scene
        self._solids: dict[str, list[tuple[coal.CollisionGeometry, int, Array]]] = {}
        for name, mount in scene.bodies.items():
            if mount.body.mesh is not None:
                shape = mount.body.mesh
                self._solids[name] = [(_bvh(shape), mount.joint, mount.pose @ shape.pose)]
                continue
            self._solids[name] = [
                (coal_geometry(piece), piece.joint, np.asarray(piece.pose))
                for piece in scene.pieces
                if piece.body == name
            ]
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()

    def distances(self, q_rad: Array, cap_m: float) -> dict[tuple[str, str], float]:
        """Distance of every checked body pair nearer than `cap_m` at one q (n,) [m]."""
        q = self.world.scene.rows_of(q_rad)[0]
        joints = _joint_poses(self.world, q)
        found = {}
        for pair in self.world.pairs:
            best = np.inf
            for first, ja, pose_a in self._solids[pair[0]]:
                for second, jb, pose_b in self._solids[pair[1]]:
                    self._result.clear()
                    # Capped: a result that already holds the cap prunes what is farther.
                    self._result.min_distance = cap_m
                    best = min(
                        best,
                        coal.distance(
                            first,
                            _transform(joints[ja] @ pose_a),
                            second,
                            _transform(joints[jb] @ pose_b),
                            self._request,
                            self._result,
                        ),
                    )
            if best < cap_m:
                found[pair] = max(0.0, float(best))
        return found

    def leak_m(self, q_rad: Array, cap_m: float) -> float:
        """How much farther a pair's pieces are than its meshes at q, at most (0: none) [m].

        More than rounding means that pieces do not cover their mesh there.
        """
        pieces = dict(self.world.distances(q_rad, cap_m))
        meshes = self.distances(q_rad, cap_m)
        return max(
            (pieces.get(pair, cap_m) - distance for pair, distance in meshes.items()), default=0.0
        )


def _bvh(shape: Shape) -> coal.BVHModelOBBRSS:
    assert shape.vertices_m is not None
    assert shape.faces is not None
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(shape.faces), len(shape.vertices_m))
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in shape.vertices_m:
        points.append(np.array(vertex))
    for a, b, c in shape.faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    model.addSubModel(points, triangles)
    model.endModel()
    return model


def _transform(matrix: Array) -> coal.Transform3s:
    return coal.Transform3s(matrix[:3, :3], matrix[:3, 3])


def _joint_poses(world: CollisionWorld, q: Array) -> list[Array]:
    """T_world_joint (4, 4) of every joint."""
    model = world.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return [placement.homogeneous for placement in data.oMi]
