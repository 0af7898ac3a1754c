"""Replays find what is wrong with a motion, and little where nothing is."""

import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.errors import ProblemError
from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.resimulation import replay_motion
from dmoc.solving.solver import solve


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    robot = random_robot(5, tmp_path_factory.mktemp("arms"), 3)
    problem = random_problems(robot, 1, seed=2)[0]
    return problem, solve(problem).require(problem)


def test_error_falls_with_the_square_of_the_step(solved) -> None:
    """A fixed window of time, so N/4 windows of N/10 of the motion each."""
    problem, _ = solved
    errors = []
    for count in (20, 40, 80):
        motion = replay_motion(solve(problem.replace(num_intervals=count)))
        errors.append(motion.replay_error_rad * count / 20)  # windows get shorter with h
    assert errors[0] / errors[1] > 2.0
    assert errors[1] / errors[2] > 2.0


def test_replay_fills_the_motion_and_prices_the_curve(solved) -> None:
    _, motion = solved
    again = replay_motion(motion, Cost())
    assert motion.replay is None
    assert again.replay_error_rad == again.replay.window_error_rad.max() < 0.01
    assert again.replay.tracking_error_rad < 2e-3
    assert again.replay.cost == pytest.approx(motion.cost, rel=0.05)


def test_a_lie_is_found(solved) -> None:
    _, motion = solved
    t = motion.trajectory
    torque = t.torque_nm.copy()
    torque[10:14] *= 1.3
    bad = JointTrajectory(t.t_s, t.q_rad, t.velocity_rad_s, torque, t.robot)
    honest = replay_motion(motion).replay_error_rad
    assert replay_motion(motion.replace(trajectory=bad)).replay_error_rad > 3 * honest


def test_nothing_to_replay_is_bad_input(solved) -> None:
    empty = Motion(Status.NO_PATH, "fallback", None, np.inf)
    with pytest.raises(ProblemError, match="no-trajectory"):
        replay_motion(empty)


def test_two_intervals_are_enough(solved) -> None:
    problem, _ = solved
    assert replay_motion(solve(problem.replace(num_intervals=2))).replay.window_intervals == 2
