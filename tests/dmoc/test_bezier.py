"""Bézier motions: the curve, its derivatives, its exact extremes and its limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.errors import ProblemError
from dmoc.robot.robot import load_robot
from studies.ur3.bezier_motion import BezierMotion, fitted_controls
from tests.naive.naive_bezier import casteljau, hodograph

CONTROL = np.random.default_rng(1).normal(size=(7, 3))


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_curve_and_derivatives_agree_with_de_casteljau(order: int) -> None:
    motion = BezierMotion(CONTROL, 2.5)
    points = CONTROL
    for _ in range(order):
        points = hodograph(points) / 2.5
    u = np.linspace(0, 1, 9)
    expected = np.array([casteljau(points, x) for x in u])
    np.testing.assert_allclose(motion.derivative(2.5 * u, order), expected, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), order=st.sampled_from([1, 2]))
def test_extremes_bound_every_sample_and_are_attained(seed: int, order: int) -> None:
    motion = BezierMotion(np.random.default_rng(seed).normal(size=(7, 2)), 3.0)
    largest = motion.largest(order)
    sampled = np.abs(motion.derivative(np.linspace(0, 3, 20_001), order)).max(axis=0)
    assert (sampled <= largest * (1 + 1e-9)).all()
    np.testing.assert_allclose(sampled, largest, rtol=1e-4)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_curve_stays_in_the_hull_of_its_control_points(seed: int) -> None:
    motion = BezierMotion(np.random.default_rng(seed).normal(size=(7, 2)), 1.0)
    q = motion.derivative(np.linspace(0, 1, 101), 0)
    assert (q <= motion.control_rad.max(axis=0) + 1e-12).all()
    assert (q >= motion.control_rad.min(axis=0) - 1e-12).all()


def test_end_velocities_are_those_of_the_neighbours() -> None:
    motion = BezierMotion(CONTROL, 3.0)
    for t, v in zip((0.0, 3.0), motion.end_velocity_rad_s):
        np.testing.assert_allclose(motion.derivative(np.array([t]), 1)[0], v, atol=1e-12)


def test_trajectory_is_the_curve() -> None:
    robot = load_robot("ur3e_class")
    motion = BezierMotion(0.3 * np.random.default_rng(2).normal(size=(7, 6)), 3.0)
    curve = motion.trajectory(robot, 150)
    t = np.linspace(0, 3, 777)
    np.testing.assert_allclose(curve.sample(t).q_rad, motion.derivative(t, 0), atol=1e-7)


def test_limit_use_scales_with_time() -> None:
    robot = load_robot("ur3e_class")
    control = 0.5 * np.random.default_rng(4).normal(size=(7, 6))
    slow, fast = (BezierMotion(control, t).limit_use(robot) for t in (4.0, 2.0))
    assert fast["velocity"] == pytest.approx(2 * slow["velocity"])
    assert fast["acceleration"] == pytest.approx(4 * slow["acceleration"])
    assert fast["position"] == slow["position"]


def test_fit_of_movej_is_close_and_at_rest() -> None:
    robot = load_robot("ur3e_class")
    move = trapezoid_motion(robot, np.zeros(6), np.array([1.0, -0.5, 0.3, 0.2, 0, 0]), scale=0.2)
    motion = BezierMotion(fitted_controls(move), move.duration_s)
    t = np.linspace(0, move.duration_s, 50)
    assert np.abs(motion.derivative(t, 0) - move.sample(t).q_rad).max() < 0.03
    assert np.abs(motion.end_velocity_rad_s).max() == 0.0


@pytest.mark.parametrize("bad", [{"duration_s": 0.0}, {"control_rad": np.zeros((3, 6))}])
def test_bad_input_is_named(bad: dict) -> None:
    with pytest.raises(ProblemError) as caught:
        BezierMotion(**{"control_rad": np.zeros((7, 6)), "duration_s": 1.0, **bad})
    assert next(iter(bad)) in str(caught.value)
