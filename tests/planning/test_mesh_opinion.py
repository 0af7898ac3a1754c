"""The triangles' own opinion against the convex pieces that cover them."""

import numpy as np
import trimesh
from scenes import random_q

from dmoc.robot.robot import load_robot
from planning.collision.mesh_opinion import MeshOpinion
from planning.collision.world import world_for
from planning.geometry.shapes import Body, Shape, pose_matrix

ROBOT = load_robot("ur10e_class")


def ball(name: str, scale: float) -> Body:
    """An icosphere whose single piece is its hull blown up by `scale`."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    piece = Shape("convex", vertices_m=vertices * scale)
    return Body(
        name,
        (piece,),
        Shape("mesh", vertices_m=vertices, faces=faces),
        pose_matrix((0.6, 0.2, 0.5)),
    )


def test_covering_pieces_are_never_farther_than_the_mesh() -> None:
    world = world_for(ROBOT, (), (ball("ball", 1.0),))
    opinion = MeshOpinion(world)
    q = random_q(ROBOT, 40, 0)
    q = q[~world.collide_batch(q)]
    seen = 0
    for row in q:
        meshes, pieces = opinion.distances(row, 0.5), dict(world.distances(row, 0.5))
        for pair in meshes.keys() & pieces.keys():
            seen += "ball" in pair
            assert abs(meshes[pair] - pieces[pair]) < 1e-5
        assert opinion.leak_m(row, 0.5) < 1e-5
    assert seen > 10


def test_a_leaking_cover_is_found() -> None:
    world = world_for(ROBOT, (), (ball("ball", 0.9),))
    opinion = MeshOpinion(world)
    leaks = [opinion.leak_m(row, 0.5) for row in random_q(ROBOT, 40, 0)]
    assert max(leaks) > 0.015
