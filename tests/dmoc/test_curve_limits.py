"""Extremes of the executed curve, and the rows that stand for them."""

import numpy as np
import pytest
from random_arms import random_problems

from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory
from dmoc.programme.curve_limits import curve_of, excess_of, lag_of, mobility_of
from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve


@pytest.mark.parametrize("seed", range(5))
def test_extremes_are_those_of_a_dense_sampling(seed: int) -> None:
    robot, rng = load_robot("planar2"), np.random.default_rng(seed)
    t = 0.2 * np.arange(7)
    q, v = rng.normal(size=(2, 7, 2))
    trajectory = JointTrajectory(t, q, v, np.zeros((6, 2)))
    curve = curve_of(robot, q, v, 0.2)
    for k in range(6):
        dense = trajectory.sample(np.linspace(t[k], t[k + 1] - 1e-12, 2001))
        hardest = np.abs(dense.acceleration_rad_s2).max(axis=0) / robot.acceleration_limit_rad_s2
        fastest = np.abs(dense.velocity_rad_s).max(axis=0) / robot.velocity_limit_rad_s
        np.testing.assert_allclose(curve.hardest[k], hardest, rtol=1e-9)
        np.testing.assert_allclose(curve.speed[k], fastest, rtol=1e-5)
        below, above = excess_of(robot, q, v, 0.2)[:, k]
        low, high = dense.q_rad.min(axis=0), dense.q_rad.max(axis=0)
        np.testing.assert_allclose(below, robot.q_lower_rad - low, atol=1e-6)
        np.testing.assert_allclose(above, high - robot.q_upper_rad, atol=1e-6)


def test_rows_tell_an_alternating_acceleration_from_its_mean() -> None:
    """The lag, what the rows miss of the true curve, is small and of first order in the step; the
    second differences of the knots alone miss the alternating part altogether."""
    problem = random_problems(load_robot("ur10e_class"), 6, seed=11)[5]
    problem = problem.replace(cost=Cost(transcription="paper"))  # the other forms do not alternate
    wild = problem.robot.with_limits(acceleration_limit_rad_s2=1e3)
    lags = []
    for count in (40, 80):
        motion = solve(problem.replace(robot=wild, num_intervals=count)).require()
        t = motion.trajectory
        h = t.t_s[1]
        curve = curve_of(problem.robot, t.q_rad, t.velocity_rad_s, h)
        mobility = mobility_of(problem.robot, t.q_rad)
        lag = lag_of(problem, curve, t.q_rad, t.velocity_rad_s, t.torque_nm, h, mobility)
        lags.append(np.median(np.abs(lag.acceleration)))
        if count == 40:
            means = np.diff(t.q_rad, 2, axis=0) / h**2 / problem.robot.acceleration_limit_rad_s2
            missed = np.abs(curve.mean[1:] - means)
            assert missed.max() > 1.0
            assert np.abs(lag.acceleration[1:]).max() < 0.3 * missed.max()
    assert lags[1] < 0.7 * lags[0]


def test_the_curve_keeps_the_range_of_a_joint_between_the_knots() -> None:
    """A swing that is cheapest with the second joint at its limit: the knots alone keep it."""
    free = MotionProblem(load_robot("planar2"), [-1.5, 0.2], [1.5, 0.2], num_intervals=12)
    low = float(solve(free).require().trajectory.q_rad[:, 1].min())
    high = float(solve(free).require().trajectory.q_rad[:, 1].max())
    edge = 0.3 * low + 0.7 * 0.2 if 0.2 - low > high - 0.2 else 0.3 * high + 0.7 * 0.2
    side = "q_lower_rad" if edge < 0.2 else "q_upper_rad"
    limits = np.array(getattr(free.robot, side))
    limits[1] = edge
    robot = free.robot.with_limits(**{side: limits})
    motion = solve(free.replace(robot=robot)).require()
    q = motion.trajectory.sample(np.linspace(0.0, motion.duration_s, 4001)).q_rad
    assert np.abs(motion.trajectory.q_rad[:, 1] - edge).min() < 5e-3  # it is felt
    assert max((robot.q_lower_rad - q).max(), (q - robot.q_upper_rad).max()) < 2e-5
