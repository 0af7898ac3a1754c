"""The shared roadmap: repeatable, free, and no worse than planning from nothing."""

import numpy as np
from scenes import clutter, random_q

from dmoc.robot import load_robot
from dmoc.status import Status
from planning.certificate import prove_path
from planning.prm import build_roadmap, plan_on_roadmap
from planning.world import world_for

ROBOT = load_robot("ur10e_class")


def test_nodes_and_segments_are_free_and_repeatable() -> None:
    world = world_for(ROBOT, (), clutter(3))
    roadmap = build_roadmap(world, seed=1, num_nodes=80)
    again = build_roadmap(world, seed=1, num_nodes=80)
    assert np.array_equal(roadmap.q_rad, again.q_rad)
    assert roadmap.graph.edges == again.graph.edges
    assert len(roadmap.q_rad) == 80
    assert not world.collide_batch(roadmap.q_rad, 0.005).any()
    assert roadmap.graph.number_of_edges() > 40
    fine = np.linspace(0, 1, 60)[:, None]
    for i, k in list(roadmap.graph.edges)[:60]:
        a, b = roadmap.q_rad[[i, k]]
        assert not world.collide_batch(a + fine * (b - a)).any()


def test_queries_are_proven_and_mostly_stay_on_the_roadmap() -> None:
    world = world_for(ROBOT, (), clutter(3))
    q = random_q(ROBOT, 400, 2)
    q = q[world.clearance().phi(q) > 0.03][:16].reshape(8, 2, 6)
    roadmap = build_roadmap(world, seed=1, near_rad=q.reshape(-1, 6))
    clearance = world.clearance()
    on_roadmap = 0
    for k, (a, b) in enumerate(q):
        result = plan_on_roadmap(roadmap, clearance, a, b, seed=k)
        assert result.status is Status.CONVERGED
        assert prove_path(clearance, result.path.q_rad)
        assert np.array_equal(result.path.q_rad[[0, -1]], np.stack([a, b]))
        again = plan_on_roadmap(roadmap, clearance, a, b, seed=k)
        assert np.array_equal(again.path.q_rad, result.path.q_rad)
        on_roadmap += result.note == "roadmap"
    assert on_roadmap >= 5


def test_an_end_in_collision_is_reported() -> None:
    world = world_for(ROBOT, (), clutter(3))
    q = random_q(ROBOT, 300, 3)
    hit = world.collide_batch(q)
    roadmap = build_roadmap(world, seed=1, num_nodes=20)
    clear = q[world.clearance().phi(q) > 0.03][0]
    result = plan_on_roadmap(roadmap, world.clearance(), q[hit][0], clear, seed=0)
    assert result.status is Status.IN_COLLISION
