"""Places between the checked points: every dip that a dense sampling finds is watched."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointPath
from dmoc.refinement import RefineParams, refine
from dmoc.refinement.iterate import Points, iterate_from_path
from dmoc.refinement.points import joined, look, points_of
from dmoc.refinement.watch import _movable, nearest_places
from dmoc.robot.robot import load_robot
from studies.stud_welding.planar_world import PlanarWorld

FRACTIONS = (0.0, 0.25, 0.5, 0.75)


def case(seed):
    """A bent path of eight coarse intervals beside three small discs."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.5, 1.5, (3, 2))
    problem = MotionProblem(load_robot("planar2"), corners[0], corners[-1], num_intervals=8)
    world = PlanarWorld([1.0, 0.8], rng.uniform(-1.5, 1.5, (3, 2)), [0.05, 0.1, 0.2])
    return problem, world, iterate_from_path(problem, JointPath(corners))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_nearest_place_between_the_points_is_watched(seed):
    problem, world, iterate = case(seed)
    points, cap = points_of(problem, FRACTIONS), 0.1
    view = look(world, iterate, points, 0.3)
    found = nearest_places(world, iterate, points, view, cap, 0.25)
    dense = points_of(problem, tuple(np.arange(512) / 512))
    rows = world.rows(iterate.curve(dense), cap)
    at = found.interval + found.fraction
    seen = {} if not len(at) else look(world, iterate, found, cap).rows
    for pair in set(rows.pair):
        of_pair = [k for k, name in enumerate(rows.pair) if name == pair]
        least = rows.distance_m[of_pair].min()
        if least < -0.03:  # that deep the places of other pairs come first
            continue
        known = [d for d, name in zip(view.rows.distance_m, view.rows.pair) if name == pair]
        if len(at):
            known += [d for d, name in zip(seen.distance_m, seen.pair) if name == pair]
        assert (
            min(known, default=np.inf) < least + 5e-3
        )  # a finer cell of these coarse intervals is 7 mm


def test_places_that_hardly_move_are_not_watched():
    """Beside a given knot: the last tenth of the last interval follows its free knot by a tenth."""
    fixed = np.array([True, True, False, False, True])
    places = Points(np.array([0, 1, 1, 2, 3, 3]), np.array([0.5, 0.1, 0.4, 0.9, 0.6, 0.9]))
    kept = _movable(places, fixed, 0.25)
    assert list(zip(kept.interval, kept.fraction)) == [(1, 0.4), (2, 0.9), (3, 0.6)]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_views_are_taken_apart_and_joined(seed):
    problem, world, iterate = case(seed)
    points = points_of(problem, FRACTIONS)
    whole = look(world, iterate, points.with_extra([1, 4], [0.1, 0.9]), 0.5)
    count = len(points.interval)
    rest = look(world, iterate, points_of(problem, ()).with_extra([1, 4], [0.1, 0.9]), 0.5)
    again = joined(whole.first(count), rest)
    np.testing.assert_array_equal(again.phi_m, whole.phi_m)
    np.testing.assert_array_equal(again.rows.knot, whole.rows.knot)
    np.testing.assert_array_equal(again.rows.gradient, whole.rows.gradient)
    assert again.rows.pair == whole.rows.pair


@pytest.mark.parametrize("radius_m", [0.02, 0.1, 0.25])
def test_half_spaces_keep_the_demand_between_the_points(radius_m):
    """A small disc passes between two checked points of a coarse grid."""
    world = PlanarWorld([1.0, 0.8], [[1.35, 0.75]], [radius_m])
    path = JointPath(np.array([[-0.5, 0.3], [-0.5, 2.4], [1.6, 2.4], [1.6, -0.3]]))
    problem = MotionProblem(load_robot("planar2"), path.q_rad[0], path.q_rad[-1], num_intervals=10)
    motion = refine(problem, path, world, params=RefineParams(clearance_m=0.02, spare_m=0.001))
    times = np.linspace(0, motion.duration_s, 20_000)
    assert motion.certified
    assert world.phi(motion.trajectory.sample(times).q_rad).min() >= 0.02


def test_a_motion_dearer_than_a_known_one_is_not_finished():
    world = PlanarWorld([1.0, 0.8], [[1.35, 0.75]], [0.25])
    path = JointPath(np.array([[-0.5, 0.3], [-0.5, 2.4], [1.6, 2.4], [1.6, -0.3]]))
    problem = MotionProblem(load_robot("planar2"), path.q_rad[0], path.q_rad[-1], num_intervals=20)
    best = refine(problem, path, world)
    assert best.certified
    given_up = refine(problem, path, world, worth=0.999 * best.cost, fallback=False)
    assert given_up.certified is False
    assert given_up.min_clearance_m is None
    assert "dearer" in given_up.note
    assert given_up.iterations < best.iterations
