"""`solve`: optima, limits, statuses, degenerate and impossible problems."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.errors import ProblemError
from dmoc.motion.constraints import MotionLimits
from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionNotSolved, MotionProblem
from dmoc.motion.status import Status
from dmoc.robot.robot import load_robot
from dmoc.solving.nlp import STATUS
from dmoc.solving.solver import solve
from dmoc.solving.solvers import SolveParams


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return random_robot(5, tmp_path_factory.mktemp("arms"), 3)


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    return random_robot(6, tmp_path_factory.mktemp("arms"), 2)


def assert_within_limits(problem, motion) -> None:
    """On the executed curve, densely sampled, not just at its knots."""
    robot, t = problem.robot, motion.trajectory
    curve = t.sample(np.linspace(0.0, t.duration_s, 50 * t.num_intervals + 1))
    assert np.all(np.abs(curve.velocity_rad_s) <= robot.velocity_limit_rad_s * 1.01)
    assert np.all(np.abs(curve.acceleration_rad_s2) <= robot.acceleration_limit_rad_s2 * 1.01)
    assert np.all(np.abs(t.torque_nm) <= robot.torque_limit_nm * (1 + 1e-6))
    assert np.all(t.q_rad >= robot.q_lower_rad - 1e-7)
    assert np.all(t.q_rad <= robot.q_upper_rad + 1e-7)
    np.testing.assert_allclose(t.q_rad[0], problem.start_rad, atol=1e-12)
    np.testing.assert_allclose(t.q_rad[-1], problem.goal_rad, atol=1e-12)


@pytest.mark.parametrize("name", ["ur10e_class", "irb6640_class"])
def test_random_motions_of_the_packaged_robots(name: str) -> None:
    for problem in random_problems(load_robot(name), 6, seed=3):
        motion = solve(problem)
        assert motion.status is Status.CONVERGED
        assert motion.max_defect <= 1e-6
        assert_within_limits(problem, motion)
        np.testing.assert_allclose(motion.trajectory.velocity_rad_s[[0, -1]], 0.0, atol=1e-6)


@pytest.mark.parametrize("num_intervals", [2, 3, 5, 19, 20, 21, 80])
def test_any_number_of_intervals(planar, num_intervals: int) -> None:
    problem = MotionProblem(planar, [0.0, 0.3], [1.2, -0.8], num_intervals=num_intervals)
    motion = solve(problem)
    assert motion.status is Status.CONVERGED
    assert motion.trajectory.num_intervals == num_intervals
    assert_within_limits(problem, motion)


def test_twice_is_the_same(arm) -> None:
    problem = random_problems(arm, 1)[0]
    a, b = solve(problem), solve(problem)
    assert a.cost == b.cost
    assert a.trajectory.q_rad.tobytes() == b.trajectory.q_rad.tobytes()


def test_limits_bind_where_they_are_tight(arm) -> None:
    tight = arm.with_limits(velocity_limit_rad_s=0.4, acceleration_limit_rad_s2=2.0)
    loose = arm.with_limits(velocity_limit_rad_s=40.0, acceleration_limit_rad_s2=4000.0)
    for a, b in zip(random_problems(tight, 4), random_problems(loose, 4)):
        slow, fast = solve(a), solve(b)
        assert slow.status is Status.CONVERGED
        assert_within_limits(a, slow)
        assert slow.cost > fast.cost
        assert np.max(np.abs(slow.trajectory.velocity_rad_s)) == pytest.approx(0.4, rel=0.02)


@pytest.mark.parametrize("name", ["ur10e_class", "irb6640_class"])
def test_time_optimal_motions_keep_their_limits_between_the_knots(name: str) -> None:
    """Bang-bang in the accelerations, and fixed first knots that provoke an alternating torque."""
    hurried = Cost(time=1.0, effort=0.0, velocity=0.0)
    for problem in random_problems(load_robot(name), 2, seed=4, cost=hurried):
        assert_within_limits(problem, solve(problem).require())
        first = problem.start_rad + np.outer([0.0004, 0.0016], np.ones(6))
        motion = solve(problem.replace(depart_rad=first)).require()
        assert_within_limits(problem, motion)
        a = np.diff(motion.trajectory.velocity_rad_s, axis=0) / motion.trajectory.t_s[1]
        assert np.max(np.abs(a) / problem.robot.acceleration_limit_rad_s2) > 0.97


def test_a_free_last_velocity_keeps_its_limits(arm) -> None:
    tight = arm.with_limits(velocity_limit_rad_s=0.4, acceleration_limit_rad_s2=2.0)
    problem = random_problems(tight, 1)[0].replace(limits=MotionLimits(free_goal_velocity=True))
    assert_within_limits(problem, solve(problem).require())


def test_start_equal_to_goal(arm) -> None:
    q = random_problems(arm, 1)[0].start_rad
    motion = solve(MotionProblem(arm, q, q))
    assert motion.status.ok
    assert motion.duration_s == pytest.approx(40 * 1e-4, rel=1e-3)
    np.testing.assert_allclose(motion.trajectory.q_rad, np.tile(q, (41, 1)), atol=1e-4)


def test_fixed_duration(arm) -> None:
    problem = random_problems(arm, 1, seed=2)[0]
    free = solve(problem)
    same = solve(problem.replace(duration_s=free.duration_s))
    longer = solve(problem.replace(duration_s=1.5 * free.duration_s))
    assert same.cost == pytest.approx(free.cost, rel=1e-5)
    assert longer.cost > free.cost
    assert longer.duration_s == pytest.approx(1.5 * free.duration_s)


def test_too_short_a_duration_is_infeasible(arm) -> None:
    problem = random_problems(arm, 1, seed=2)[0].replace(duration_s=0.05)
    motion = solve(problem, SolveParams(max_iterations=150))
    assert motion.status is Status.INFEASIBLE
    assert not motion.status.ok
    with pytest.raises(MotionNotSolved, match="infeasible") as caught:
        motion.require(problem)
    again = pickle.loads(pickle.dumps(caught.value))
    assert again.motion.status is Status.INFEASIBLE


def test_gravity_beyond_the_motors_is_infeasible(arm) -> None:
    """An arm that cannot even hold its ends, at rest there, for a given time."""
    weak = arm.with_limits(torque_limit_nm=0.02 * arm.torque_limit_nm)
    problem = random_problems(arm, 1, seed=4)[0]
    problem = MotionProblem(weak, problem.start_rad, problem.goal_rad)
    assert not solve(problem, SolveParams(max_iterations=150)).status.ok


def test_end_velocities(planar) -> None:
    v0, v1 = np.array([0.5, -0.2]), np.array([-0.3, 0.8])
    problem = MotionProblem(
        planar, [0.0, 0.3], [1.2, -0.8], start_velocity_rad_s=v0, goal_velocity_rad_s=v1
    )
    motion = solve(problem)
    assert motion.status is Status.CONVERGED
    np.testing.assert_allclose(motion.trajectory.velocity_rad_s[0], v0, atol=1e-6)
    np.testing.assert_allclose(motion.trajectory.velocity_rad_s[-1], v1, atol=1e-6)


def test_departure_and_arrival_knots_are_kept(arm) -> None:
    problem = random_problems(arm, 1, seed=6)[0]
    first = problem.start_rad + 0.01 * np.arange(1, 3)[:, None]
    last = problem.goal_rad - 0.02 * np.ones((1, 3))
    motion = solve(problem.replace(depart_rad=first, arrive_rad=last))
    assert motion.status is Status.CONVERGED
    np.testing.assert_allclose(motion.trajectory.q_rad[1:3], first, atol=1e-12)
    np.testing.assert_allclose(motion.trajectory.q_rad[-2:-1], last, atol=1e-12)


def test_reversed_motion_costs_the_same(arm) -> None:
    for problem in random_problems(arm, 3, seed=8):
        back = problem.replace(start_rad=problem.goal_rad, goal_rad=problem.start_rad)
        assert solve(back).cost == pytest.approx(solve(problem).cost, rel=1e-4)


def test_smoothing_removes_the_checkerboard_and_is_not_reported(arm) -> None:
    problem = random_problems(arm, 1, seed=9)[0]

    def index(motion) -> float:
        u = motion.trajectory.torque_nm / arm.torque_limit_nm
        return float(np.median(np.abs(u[2:] - 2 * u[1:-1] + u[:-2])))

    paper = Cost(effort=0.0, transcription="paper")
    rough = solve(problem.replace(cost=replace(paper, torque_smoothing=0.0)))
    smooth = solve(problem.replace(cost=paper))
    assert rough.smoothing_cost == 0.0
    assert smooth.smoothing_cost > 0.0
    assert index(smooth) < 0.2 * index(rough)
    assert smooth.cost == pytest.approx(rough.cost, rel=0.02)


def test_iteration_limit_is_a_status(arm) -> None:
    motion = solve(random_problems(arm, 1)[0], SolveParams(max_iterations=1))
    assert motion.status is Status.ITERATION_LIMIT
    assert "max_iterations" in motion.status.advice


def test_every_return_code_has_a_status_with_advice() -> None:
    for status in STATUS.values():
        assert status.advice.endswith(".")


def test_bad_problems_name_their_fault(arm) -> None:
    q = np.zeros(3)
    for fields, match in (
        ({"start_rad": [0, 0]}, "start_rad"),
        ({"goal_rad": [9, 0, 0]}, "goal_rad"),
        ({"goal_rad": [np.nan, 0, 0]}, "goal_rad"),
        ({"duration_s": -1.0}, "duration"),
        ({"num_intervals": 1}, "num_intervals"),
        ({"start_velocity_rad_s": 100.0}, "start_velocity_rad_s"),
    ):
        with pytest.raises(ProblemError, match=match):
            MotionProblem(**({"robot": arm, "start_rad": q, "goal_rad": q} | fields))


def test_problems_and_motions_travel(arm) -> None:
    problem = random_problems(arm, 1)[0]
    motion = solve(problem)
    again = pickle.loads(pickle.dumps(problem))
    assert solve(again).trajectory.q_rad.tobytes() == motion.trajectory.q_rad.tobytes()
    sent = pickle.loads(pickle.dumps(motion))
    assert sent.trajectory.q_rad.tobytes() == motion.trajectory.q_rad.tobytes()
    assert copy.deepcopy(problem).start_rad.tobytes() == problem.start_rad.tobytes()
