"""First iterates, checked points and demanded distances, without a solver."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointPath
from dmoc.refinement.halfspaces import half_spaces
from dmoc.refinement.iterate import (
    Points,
    fixed_knots,
    iterate_from_path,
    iterate_from_trajectory,
)
from dmoc.refinement.params import RefineParams
from dmoc.refinement.points import knots_of, look, points_of, required_clearance
from dmoc.robot.robot import load_robot
from studies.stud_welding.planar_world import PlanarWorld

WORLD = PlanarWorld([1.0, 0.8], [[1.35, 0.75]], [0.25])
CORNERS = np.array([[-0.2, 0.3], [0.5, 2.2], [1.6, -0.3]])


@pytest.fixture(scope="module")
def problem():
    return MotionProblem(load_robot("planar2"), CORNERS[0], CORNERS[-1], num_intervals=20)


def with_lines(problem):
    depart = CORNERS[0] + np.array([[0.01, 0.01], [0.04, 0.04]])
    arrive = CORNERS[-1] + np.array([[-0.04, 0.0], [-0.01, 0.0]])
    return problem.replace(depart_rad=depart, arrive_rad=arrive)


def test_first_iterate_follows_the_path(problem):
    iterate = iterate_from_path(problem, JointPath(CORNERS))
    np.testing.assert_allclose(iterate.q_rad[[0, -1]], CORNERS[[0, -1]])
    places = np.linspace(0, 1, 400)[:, None]
    legs = np.vstack([a + places * (b - a) for a, b in itertools.pairwise(CORNERS)])
    gap = np.linalg.norm(iterate.q_rad[:, None] - legs[None], axis=2).min(axis=1)
    # A blend may leave a corner by a quarter of what the two legs differ.
    assert np.median(gap) < 0.05
    assert gap.max() < 0.6


def test_given_knots_are_kept_and_the_rest_is_monotone_in_time(problem):
    lines = with_lines(problem)
    path = JointPath(
        np.vstack([CORNERS[:1], lines.depart_rad, CORNERS[1:2], lines.arrive_rad, CORNERS[2:]])
    )
    iterate = iterate_from_path(lines, path)
    np.testing.assert_array_equal(iterate.q_rad[1:3], lines.depart_rad)
    np.testing.assert_array_equal(iterate.q_rad[-3:-1], lines.arrive_rad)
    assert np.all(np.diff(iterate.q_rad[:, 0]) > -1e-9)


def test_refining_the_grid_keeps_the_curve(problem):
    coarse = iterate_from_path(problem, JointPath(CORNERS))
    fine = iterate_from_trajectory(problem.replace(num_intervals=40), coarse.trajectory(problem))
    np.testing.assert_allclose(fine.q_rad[::2], coarse.q_rad, atol=1e-9)
    assert 40 * fine.step_s == pytest.approx(20 * coarse.step_s)


def test_curve_is_the_interpolant_of_the_trajectory(problem):
    iterate = iterate_from_path(problem, JointPath(CORNERS))
    points = points_of(problem, (0.0, 0.25, 0.5, 0.75))
    times = iterate.step_s * (points.interval + points.fraction)
    expected = iterate.trajectory(problem).sample(times).q_rad
    np.testing.assert_allclose(iterate.curve(points), expected, atol=1e-12)


def test_no_point_lies_on_given_knots_or_between_them(problem):
    lines = with_lines(problem)
    points, fixed = points_of(lines, (0.0, 0.5)), fixed_knots(lines)
    assert fixed.sum() == 6
    assert points.interval.min() == 2
    assert points.interval.max() == 17
    assert not np.any(fixed[points.interval] & (points.fraction == 0))


def test_less_is_demanded_beside_a_near_end(problem):
    wide = required_clearance(WORLD, problem, points_of(problem, (0.0, 0.5)), 0.02)
    assert np.all(wide == 0.02)
    near_goal = np.array([0.5, -0.2])
    phi = WORLD.phi(near_goal[None])[0]
    shifted = PlanarWorld([1.0, 0.8], WORLD.centres_m, WORLD.radii_m + phi - 0.004)
    near = problem.replace(goal_rad=near_goal)
    points = points_of(near, (0.0, 0.5))
    demanded = required_clearance(shifted, near, points, 0.02)
    last = points.interval == 19
    assert demanded[last & (points.fraction == 0.5)][0] == pytest.approx(0.9 * 0.004 + 0.01)
    assert np.all(demanded[~last] == 0.02)


def test_offending_points_name_their_knots():
    points = Points(np.array([2, 2, 5]), np.array([0.0, 0.5, 0.25]))
    assert list(np.flatnonzero(knots_of(points, np.array([True, False, False]), 8))) == [2]
    assert list(np.flatnonzero(knots_of(points, np.array([False, True, False]), 8))) == [2, 3]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), trust=st.floats(0.01, 0.5))
def test_rows_hold_the_linearised_distance_and_can_be_met(seed, trust):
    """Every kept row, met with equality, leaves the pair at the demanded distance; no row asks
    for more than the trust region gives, and what was left out cannot become active."""
    robot = load_robot("planar2")
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-1.0, 1.5, (3, 2))
    problem = MotionProblem(robot, ends[0], ends[-1], num_intervals=8)
    iterate = iterate_from_path(problem, JointPath(ends))
    params = RefineParams()
    points = points_of(problem, params.fractions)
    view = look(WORLD, iterate, points, 0.3)
    radius = np.full((9, 2), trust)
    radius[[0, -1]] = 0.0
    required = np.full(len(points.interval), params.clearance_m)
    rows = half_spaces(view, points, required, radius, push_out_m=0.05, rows_per_point=2)
    share = rows.fraction[:, None]
    chord = (1 - share) * iterate.q_rad[rows.interval] + share * iterate.q_rad[rows.interval + 1]
    room = (1 - share) * radius[rows.interval] + share * radius[rows.interval + 1]
    now = np.sum(rows.gradient * chord, axis=1)
    most = now + np.sum(np.abs(rows.gradient) * room, axis=1)
    assert np.all(rows.lower <= most)
    kept = {(i, round(f, 6)) for i, f in zip(rows.interval, rows.fraction)}
    for p, (i, f) in enumerate(zip(points.interval, points.fraction)):
        if (i, round(f, 6)) in kept or view.phi_m[p] >= 0.3:
            continue
        mine = view.rows.knot == p
        reach = (1 - f) * radius[i] + f * radius[i + 1]
        worst = view.rows.distance_m[mine] - np.abs(view.rows.gradient[mine]) @ reach
        assert worst.min() >= params.clearance_m - 1e-12 or reach.max() == 0
