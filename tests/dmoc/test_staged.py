"""The optional solver fatrop finds Ipopt's optima, limits and half-spaces included."""

import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.constraints import MotionLimits, TorqueSpeed
from dmoc.cost import Cost
from dmoc.errors import ProblemError
from dmoc.guess import straight_guess
from dmoc.nlp import solve_nlp
from dmoc.nlp_types import Box, IpoptParams, PathRows
from dmoc.robot import load_robot
from dmoc.solver import solve
from dmoc.status import Status

FATROP = IpoptParams(solver="fatrop")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return random_robot(5, tmp_path_factory.mktemp("arms"), 3)


def assert_same(ours, other, rel: float = 1e-6) -> None:
    assert ours.status is other.status is Status.CONVERGED
    assert other.max_defect <= 1e-6
    assert other.cost + other.smoothing_cost == pytest.approx(
        ours.cost + ours.smoothing_cost, rel=rel
    )


@pytest.mark.parametrize("name", ["ur10e_class", "irb6640_class"])
def test_same_optimum_for_the_packaged_robots(name: str) -> None:
    free = load_robot(name).with_limits(acceleration_limit_rad_s2=1e3)
    for problem in random_problems(free, 2, seed=11, num_intervals=20):
        ours, other = solve(problem), solve(problem, FATROP)
        assert_same(ours, other)
        np.testing.assert_allclose(other.trajectory.q_rad, ours.trajectory.q_rad, atol=1e-4)


def test_same_optimum_with_limits_ends_and_wrench(arm) -> None:
    problem = random_problems(arm, 1, seed=2, num_intervals=16)[0]
    first = problem.start_rad + 0.01 * np.arange(1, 3)[:, None]
    curve = TorqueSpeed(0.7 * arm.torque_limit_nm, 2.0 * arm.velocity_limit_rad_s)
    variants = [
        {"duration_s": 2.5},
        {"start_velocity_rad_s": 0.2, "goal_velocity_rad_s": -0.3},
        {"depart_rad": first},
        {"wrench": [0.0, 10.0, -50.0, 0.0, 5.0, 0.0]},
        {"limits": MotionLimits(torque_speed=curve)},
        {"cost": Cost(state_matrix=np.diag([0.1] * 3 + [1.0] * 3))},
    ]
    for fields in variants:
        one = problem.replace(**fields)
        assert_same(solve(one), solve(one, FATROP))


def test_same_optimum_where_speed_and_acceleration_bind(arm) -> None:
    """The rows take inertia from the solution before, so the two may stop a hair apart."""
    tight = arm.with_limits(velocity_limit_rad_s=1.0, acceleration_limit_rad_s2=4.0)
    problem = random_problems(tight, 1, seed=3, num_intervals=20)[0]
    assert_same(solve(problem), solve(problem, FATROP), rel=2e-3)


def test_same_optimum_with_boxes_and_half_spaces(arm) -> None:
    problem = random_problems(arm, 1, seed=2, num_intervals=20)[0]
    guess = straight_guess(problem)
    middle = solve_nlp(problem, guess).q_rad[10]
    rows = PathRows(
        np.array([9, 10]), np.array([0.5, 0.0]), np.tile([0.0, 1.0, 0.0], (2, 1)),
        np.array([middle[1] + 0.05, middle[1] + 0.1]),
    )  # fmt: skip
    box = Box(np.full((21, 3), -2.5), np.full((21, 3), 2.5))
    ours = solve_nlp(problem, guess, box=box, rows=rows)
    other = solve_nlp(problem, guess, box=box, rows=rows, params=FATROP)
    assert_same(ours, other)
    assert other.q_rad[10, 1] >= middle[1] + 0.1 - 1e-6


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        (MotionLimits(jerk_rad_s3=10.0), r"limits\.jerk_rad_s3"),
        (MotionLimits(rms_torque_nm=10.0), r"limits\.rms_torque_nm"),
        (MotionLimits(free_goal_velocity=True), r"limits\.free_goal_velocity"),
    ],
)
def test_what_it_cannot_carry_is_refused_by_name(arm, limits, field) -> None:
    problem = random_problems(arm, 1, num_intervals=8)[0].replace(limits=limits)
    with pytest.raises(ProblemError, match=field):
        solve(problem, FATROP)


def test_iteration_limit_is_a_status(arm) -> None:
    problem = random_problems(arm, 1, num_intervals=8)[0]
    motion = solve(problem, IpoptParams(solver="fatrop", max_iterations=1))
    assert motion.status is Status.ITERATION_LIMIT
