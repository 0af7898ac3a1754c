"""Segments and trees in compiled code, against sampling; both planners by name."""

from itertools import pairwise

import numpy as np
import pytest
from scenes import box, clutter, random_q, snake

from dmoc.errors import ProblemError
from dmoc.motion.status import Status
from dmoc.robot.robot import load_robot
from planning.collision.kernels.segment import segment_contact
from planning.collision.world import world_for
from planning.path import rrt_connect as roadmap
from planning.path.rrt_connect import PLANNERS, RANGE_M, plan_path
from planning.path.tree_search import tree_path

ROBOT = load_robot("ur10e_class")
STEP_M = 0.05
POST = box("post", (0.05, 0.05, 0.02), (0.3, 0.0, 0.6))


@pytest.fixture(scope="module")
def scene():
    return world_for(ROBOT, (), clutter(3)).scene


def segments(scene, count, seed):
    """Short and long segments from a free configuration."""
    q = random_q(ROBOT, 4 * count, seed)
    q = q[scene.first_contacts(q, 0.0, scene.everything) < 0][:count]
    step = np.random.default_rng(seed).normal(size=q.shape)
    step *= np.geomspace(0.05, 6.0, len(q))[:, None] / np.linalg.norm(step, axis=1)[:, None]
    return q, np.clip(q + step, ROBOT.q_lower_rad, ROBOT.q_upper_rad)


def sampled(scene, a, b, points):
    q = a + np.linspace(0, 1, points)[:, None] * (b - a)
    return bool((scene.first_contacts(q, 0.0, scene.everything) >= 0).any())


def test_segments_agree_with_sampling(scene):
    """Free means free at points of its own density; touching means that a dense look finds it."""
    scan = scene.scan(STEP_M, 0.0, scene.everything)
    free = hits = 0
    for a, b in zip(*segments(scene, 150, 1)):
        length = float(np.abs(b - a) @ scene.lever_m) / STEP_M
        parts = 2 ** int(np.ceil(np.log2(max(1.0, length))))
        if segment_contact(scan, a, b, False) < 0:
            free += 1
            chunks = max(1, int(np.ceil(np.ceil(length) / 16)))
            per_chunk = 2 ** int(np.ceil(np.log2(max(1.0, np.ceil(length) / chunks))))
            assert not sampled(scene, a, b, chunks * per_chunk + 1)
        else:
            hits += 1
            assert sampled(scene, a, b, 64 * parts + 1)
    assert min(free, hits) > 20


def test_the_answer_does_not_depend_on_what_was_asked_before(scene):
    pairs = list(zip(*segments(scene, 80, 2)))
    scan = scene.scan(STEP_M, 0.0, scene.everything)
    forth = [segment_contact(scan, a, b, True) for a, b in pairs]
    back = [segment_contact(scan, a, b, True) for a, b in pairs[::-1]][::-1]
    assert [m < 0 for m in forth] == [m < 0 for m in back]
    # A new scan forgets, so that even the pair that is named is the same.
    scan = scene.scan(STEP_M, 0.0, scene.everything)
    assert forth == [segment_contact(scan, a, b, True) for a, b in pairs]


def test_an_end_that_is_known_to_be_free_is_not_asked(scene):
    q = random_q(ROBOT, 200, 5)
    touching = q[scene.first_contacts(q, 0.0, scene.everything) >= 0][0]
    scan = scene.scan(STEP_M, 0.0, scene.everything)
    assert segment_contact(scan, touching, touching, False) >= 0
    free = q[scene.first_contacts(q, 0.0, scene.everything) < 0]
    for a, b in zip(free[::2], free[1::2]):
        known = segment_contact(scan, a, b, True) < 0
        assert known == (segment_contact(scan, a, b, False) < 0)


def test_trees_meet_in_a_free_path_within_the_limits(scene):
    scan = scene.scan(STEP_M, 0.0, scene.everything)
    q = random_q(ROBOT, 200, 3)
    q = q[scene.first_contacts(q, 0.02, scene.everything) < 0]
    bent = 0
    for k in range(10):
        settings = {
            "limits": (ROBOT.q_lower_rad, ROBOT.q_upper_rad),
            "scale": scene.lever_m,
            "reach_m": RANGE_M,
            "seed": k,
            "max_iterations": 3000,
        }
        found = tree_path(scan, q[2 * k], q[2 * k + 1], **settings)
        path = found.q_rad
        assert np.array_equal(path[[0, -1]], q[2 * k : 2 * k + 2])
        assert np.all((path >= ROBOT.q_lower_rad) & (path <= ROBOT.q_upper_rad))
        length = np.linalg.norm(np.diff(path, axis=0) * scene.lever_m, axis=1)
        assert length.max() <= RANGE_M * (1 + 1e-9)
        assert all(segment_contact(scan, a, b, False) < 0 for a, b in pairwise(path))
        again = tree_path(scan, q[2 * k], q[2 * k + 1], **settings)
        assert np.array_equal(again.q_rad, path)
        assert (again.iterations, again.checks) == (found.iterations, found.checks)
        bent += len(path) > 3
    assert bent > 3


def test_both_planners_solve_and_say_what_is_in_the_way(tmp_path):
    """Upright the arm is in the ceiling, and it has to pass there: nothing else is in the way.

    Round a post beside it there is a way, but not straight on."""
    robot = snake(tmp_path, 3, limit=1.5)
    world = world_for(robot, (), (box("ceiling", (3, 3, 0.02), (0, 0, 0.75)),))
    a, b = np.array([0.0, 1.4, 0.0]), np.array([0.0, -1.4, 0.0])
    beside = world_for(robot, (), (POST,))
    for planner in PLANNERS:
        vain = plan_path(world, a, b, seed=0, max_iterations=100, attempts=2, planner=planner)
        assert vain.status is Status.NO_PATH
        assert vain.path is None
        assert "ceiling" in vain.pair
        assert "most often in the way: ceiling - " in vain.note
        solved = plan_path(beside, a, b, seed=0, max_iterations=200, planner=planner)
        assert solved.status is Status.CONVERGED
        assert solved.planner == planner
        assert solved.note == ""


def test_the_compiled_planner_takes_the_place_of_a_missing_one(tmp_path, monkeypatch):
    robot = snake(tmp_path, 3, limit=1.5)
    a, b = np.array([0.0, 1.4, 0.0]), np.array([0.0, -1.4, 0.0])
    world = world_for(robot, (), (POST,))
    settings = {"seed": 0, "max_iterations": 200}
    assert plan_path(world, a, b, **settings).planner == "ompl"
    asked = plan_path(world, a, b, planner="compiled", **settings)
    monkeypatch.setattr(roadmap, "ob", None)
    given = plan_path(world, a, b, **settings)
    assert (given.planner, given.note) == ("compiled", "ompl is not installed: compiled trees")
    assert np.array_equal(given.path.q_rad, asked.path.q_rad)
    with pytest.raises(ProblemError, match="ompl, compiled"):
        plan_path(world, a, b, planner="native", **settings)
