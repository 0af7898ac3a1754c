"""One path: found, proven, repeatable, and a reason where there is none."""

import numpy as np
from scenes import box, clutter, random_q, snake

from dmoc.motion.status import Status
from dmoc.robot.robot import load_robot
from planning.collision.certificate import prove_path
from planning.collision.world import world_for
from planning.path.rrt_connect import plan_path

ROBOT = load_robot("ur10e_class")


def free_ends(world, count: int, seed: int) -> np.ndarray:
    q = random_q(world.robot, 40 * count, seed)
    return q[world.clearance().phi(q) > 0.03][: 2 * count].reshape(count, 2, -1)


def test_paths_are_proven_and_end_where_they_should() -> None:
    world = world_for(ROBOT, (), clutter(3))
    bent = 0
    for k, (a, b) in enumerate(free_ends(world, 8, 1)):
        result = plan_path(world, a, b, seed=k)
        assert result.status is Status.CONVERGED
        assert np.array_equal(result.path.q_rad[0], a)
        assert np.array_equal(result.path.q_rad[-1], b)
        assert prove_path(world.clearance(), result.path.q_rad)
        bent += len(result.path.q_rad) > 2
        fine = np.concatenate(
            [
                p + np.linspace(0, 1, 200)[:, None] * (q - p)
                for p, q in zip(result.path.q_rad, result.path.q_rad[1:])
            ]
        )
        assert not world.collide_batch(fine).any()
        assert np.all(fine >= ROBOT.q_lower_rad - 1e-12)
        assert np.all(fine <= ROBOT.q_upper_rad + 1e-12)
    assert bent > 0


def test_same_seed_same_path_in_any_order() -> None:
    world = world_for(ROBOT, (), clutter(3))
    pairs = free_ends(world, 6, 2)
    first = [plan_path(world, a, b, seed=7).path.q_rad for a, b in pairs]
    again = [plan_path(world, a, b, seed=7).path.q_rad for a, b in pairs[::-1]][::-1]
    assert all(np.array_equal(p, q) for p, q in zip(first, again))


def test_reasons() -> None:
    world = world_for(ROBOT, (), clutter(3))
    q = random_q(ROBOT, 300, 3)
    bad = q[world.collide_batch(q)][0]
    good = free_ends(world, 1, 4)[0, 0]
    result = plan_path(world, bad, good, seed=0)
    assert result.status is Status.IN_COLLISION
    assert result.pair == world.collide(bad, 0.002)
    assert "start" in result.note
    assert "goal" in plan_path(world, good, bad, seed=0).note
    outside = good.copy()
    outside[2] = 9.0
    result = plan_path(world, good, outside, seed=0)
    assert result.status is Status.NO_PATH
    assert "joint 3" in result.note
    assert result.path is None


def test_no_path_under_a_closed_ceiling(tmp_path) -> None:
    """Bent to one side and to the other: in between the arm would stand upright, in the ceiling.

    Joint 2 has to pass through 0, and there every configuration touches: no path exists.
    """
    robot = snake(tmp_path, 3, limit=1.5)
    world = world_for(robot, (), (box("ceiling", (3, 3, 0.02), (0, 0, 0.75)),))
    a, b = np.array([0.0, 1.4, 0.0]), np.array([0.0, -1.4, 0.0])
    assert world.collide(a, 0.01) is None
    assert world.collide(b, 0.01) is None
    turns = np.array(np.meshgrid(np.linspace(-1.5, 1.5, 31), [0.0], np.linspace(-1.5, 1.5, 31)))
    assert world.collide_batch(turns.reshape(3, -1).T, -0.02).all()
    for seed in (0, 1):
        result = plan_path(world, a, b, seed=seed, max_iterations=200, attempts=2)
        assert result.status is Status.NO_PATH
        assert result.path is None
        assert result.note.startswith("no path within 2 attempts of 200 iterations, most often in")
        assert "ceiling" in result.pair
        assert result.iterations >= 400
        assert result.checks > 0
    # The ceiling is what closes it.
    raised = world_for(robot, (), (box("ceiling", (3, 3, 0.02), (0, 0, 0.95)),))
    assert plan_path(raised, a, b, seed=0, max_iterations=200).status is Status.CONVERGED


def test_seven_joints_and_wide_ranges(tmp_path) -> None:
    robot = snake(tmp_path, 7, limit=np.radians(400))
    world = world_for(robot, (), clutter(5, 3))
    for k, (a, b) in enumerate(free_ends(world, 4, 6)):
        result = plan_path(world, a, b, seed=k)
        assert result.status is Status.CONVERGED
        assert prove_path(world.clearance(), result.path.q_rad)
