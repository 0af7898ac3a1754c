"""The trapezoid baseline keeps its limits, is the fastest of its kind and exactly interpolated."""

import numpy as np
import pytest

from dmoc.curves import trapezoid
from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.errors import ProblemError
from dmoc.robot.robot import load_robot

ROBOT = load_robot("ur10e_class")
RNG = np.random.default_rng(2)


def ends() -> tuple[np.ndarray, np.ndarray]:
    return RNG.uniform(-2, 2, 6), RNG.uniform(-2, 2, 6)


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_limits_hold_and_one_is_reached(size: float) -> None:
    for _ in range(10):
        a, b = ends()
        b = a + size * (b - a)
        motion = trapezoid_motion(ROBOT, a, b)
        sample = motion.sample(np.linspace(0, motion.duration_s, 2001))
        v = np.abs(sample.velocity_rad_s).max(axis=0) / ROBOT.velocity_limit_rad_s
        acc = np.abs(sample.acceleration_rad_s2).max(axis=0) / ROBOT.acceleration_limit_rad_s2
        assert v.max() <= 1 + 1e-9
        assert acc.max() == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(motion.q_rad[[0, -1]], [a, b], atol=1e-12)
        assert np.abs(motion.velocity_rad_s[[0, -1]]).max() < 1e-12


def test_matches_the_textbook_single_joint_cases() -> None:
    # 1 rad at 1 rad/s and 2 rad/s2: 0.5 s up, 0.5 s plateau, 0.5 s down. 0.1 rad: a triangle.
    one = np.array([1.0]), np.array([2.0])
    assert trapezoid.trapezoid_phases(np.array([1.0]), *one) == pytest.approx((0.5, 1.5))
    ramp, total = trapezoid.trapezoid_phases(np.array([0.1]), *one)
    assert total == pytest.approx(2 * np.sqrt(0.1 / 2.0))
    assert ramp == pytest.approx(total / 2)


def test_halving_the_scale_slows_down() -> None:
    a, b = ends()
    motion = trapezoid_motion(ROBOT, a, b)
    assert trapezoid_motion(ROBOT, a, b, scale=0.5).duration_s > motion.duration_s


@pytest.mark.parametrize(
    ("goal", "kwargs"),
    [
        (np.zeros(5), {}),
        (np.full(6, np.nan), {}),
        (np.zeros(6), {}),
        (np.ones(6), {"scale": 0.0}),
        (np.ones(6), {"num_intervals": 2}),
    ],
)
def test_bad_input_is_refused(goal, kwargs) -> None:
    with pytest.raises(ProblemError):
        trapezoid_motion(ROBOT, np.zeros(6), goal, **kwargs)
