"""Corner blending, time scaling, the closed-form slow-down, and the cost of a trajectory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.curves.blended_path import blend_corners
from dmoc.curves.time_scaling import best_slowdown, slowdown_coefficients, time_scale
from dmoc.motion.constraints import MotionLimits
from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointPath, JointTrajectory, inverse_dynamics
from dmoc.physics.running_cost import trajectory_cost
from dmoc.robot.robot import load_robot

CORNERS = np.array([[0.0, 0.0], [0.2, 1.2], [1.5, -1.0], [1.5, 1.0]])


@pytest.fixture(scope="module")
def arm():
    return load_robot("planar2")


def test_blends_are_continuous_with_their_slope_and_pass_the_ends():
    blended = blend_corners(CORNERS, np.array([3.0, 4.0]))
    for s in blended.breaks[1:-1]:
        left, right = blended.evaluate(np.array([s - 1e-10])), blended.evaluate(np.array([s]))
        np.testing.assert_allclose(left[0], right[0], atol=1e-8)
        np.testing.assert_allclose(left[1], right[1], atol=1e-7)
    ends = blended.evaluate(np.array([0.0, blended.length]))[0]
    np.testing.assert_allclose(ends, CORNERS[[0, -1]], atol=1e-12)


def test_blends_shrink_until_the_corner_is_free():
    """A blend may not cut into the region q_2 < 0.9 q_1 + 0.9, close under the first corner."""

    def is_free(q):
        return q[:, 1] >= 0.9

    wide = blend_corners(CORNERS[:3], np.ones(2))
    tight = blend_corners(CORNERS[:3], np.ones(2), is_free=is_free)
    share_wide, share_tight = wide.breaks[1] / wide.breaks[2], tight.breaks[1] / tight.breaks[2]
    assert share_tight > share_wide
    s = np.linspace(tight.breaks[1], tight.breaks[2], 200)
    assert tight.evaluate(s)[0][:, 1].min() >= 0.9 - 1e-3


def test_a_pinned_corner_is_passed_closely():
    pinned = np.array([False, True, False, False])
    blended = blend_corners(CORNERS, np.ones(2), pinned=pinned, pinned_deviation=1e-3)
    s = np.linspace(0, blended.length, 20001)
    gap = np.linalg.norm(blended.evaluate(s)[0][:, None] - CORNERS[None], axis=2).min(axis=0)
    assert gap[1] <= 1.01e-3
    assert gap[2] > 0.05


@pytest.mark.parametrize("law", ["quintic", "toppra"])
def test_a_jerk_limit_slows_either_law_down(arm, law):
    path, problem = JointPath(CORNERS), MotionProblem(arm, CORNERS[0], CORNERS[-1])
    free = time_scale(path, problem, laws=(law,))
    limit = 20.0
    limits = MotionLimits(jerk_limit_rad_s3=limit)
    slow = time_scale(path, problem.replace(limits=limits), laws=(law,))
    jerk = []
    for timed in (free, slow):
        t, v = timed.trajectory.t_s, timed.trajectory.velocity_rad_s
        middle = np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, t[-1:]])
        mean = np.zeros((len(t) + 1, 2))
        mean[1:-1] = np.diff(v, axis=0) / np.diff(t)[:, None]
        apart = np.diff(middle)
        apart[[0, -1]] *= 2
        jerk.append(np.abs(np.diff(mean, axis=0) / apart[:, None]).max())
    assert jerk[0] > limit >= jerk[1] * (1 - 1e-9)
    assert jerk[1] > 0.99 * limit
    assert slow.within_limits
    assert slow.cost > free.cost


def test_repeated_points_do_no_harm():
    blended = blend_corners(np.repeat(CORNERS, 2, axis=0), np.ones(2))
    assert blended.length == pytest.approx(blend_corners(CORNERS, np.ones(2)).length)
    assert blend_corners(np.zeros((3, 2)), np.ones(2)).length > 0


@pytest.mark.parametrize("path", [CORNERS[:2], CORNERS[:3], CORNERS])
def test_time_scaled_path_keeps_limits_path_and_cost(arm, path):
    problem = MotionProblem(arm, path[0], path[-1])
    timed = time_scale(JointPath(path), problem)
    assert timed.within_limits
    t = np.linspace(0, timed.trajectory.duration_s, 2000)
    q, v, a, torque = timed.trajectory.sample(t)
    assert np.all(np.abs(v) <= arm.velocity_limit_rad_s * 1.01)
    # Acceleration and torque are held at the midpoints of the knots; between them the cubic
    # overshoots where the time-optimal law switches.
    mid = 0.5 * (timed.trajectory.t_s[1:] + timed.trajectory.t_s[:-1])
    _, _, a, torque = timed.trajectory.sample(mid)
    assert np.all(np.abs(a) <= arm.acceleration_limit_rad_s2 * 1.001)
    assert np.all(np.abs(torque) <= arm.torque_limit_nm * 1.001)
    np.testing.assert_allclose(q[[0, -1]], path[[0, -1]], atol=1e-9)
    assert timed.cost == pytest.approx(
        trajectory_cost(timed.trajectory, arm, problem.cost), rel=0.02
    )


def test_slowing_down_further_or_less_costs_more(arm):
    problem = MotionProblem(arm, CORNERS[0], CORNERS[1], cost=Cost(1.0, 1e-3, 1.0))
    timed = time_scale(JointPath(CORNERS[:2]), problem)
    best = trajectory_cost(timed.trajectory, arm, problem.cost)
    for kappa in (0.93, 1.07):
        trajectory = timed.trajectory
        other = JointTrajectory(
            trajectory.t_s * kappa,
            trajectory.q_rad,
            trajectory.velocity_rad_s / kappa,
            trajectory.torque_nm,
            arm,
        )
        assert trajectory_cost(other, arm, problem.cost) > best


def test_fixed_duration_is_met(arm):
    problem = MotionProblem(arm, CORNERS[0], CORNERS[1], duration_s=4.0)
    timed = time_scale(JointPath(CORNERS[:2]), problem)
    assert timed.trajectory.duration_s == pytest.approx(4.0)
    assert timed.within_limits


def test_a_pose_that_cannot_be_held_is_reported(arm):
    weak = arm.with_limits(torque_limit_nm=50.0)
    problem = MotionProblem(weak, CORNERS[0], CORNERS[1])
    assert not time_scale(JointPath(CORNERS[:2]), problem).within_limits


positive = st.floats(1e-6, 1e3)


@given(alpha=positive, beta=st.floats(-1e3, 1e3), gamma=positive, least=st.floats(0.1, 3.0))
def test_best_slowdown_is_the_minimum(alpha, beta, gamma, least):
    def cost(kappa):
        return alpha * kappa + beta / kappa + gamma / kappa**3

    kappa = best_slowdown(alpha, beta, gamma, least)
    assert kappa >= least
    others = least * np.geomspace(1.0, 1e4, 400)
    assert cost(kappa) <= cost(others).min() + 1e-9 * abs(cost(kappa))


@settings(max_examples=20, deadline=None)
@given(kappa=st.floats(0.5, 4.0), seed=st.integers(0, 1000))
def test_coefficients_match_inverse_dynamics_of_the_slowed_motion(kappa, seed):
    arm = load_robot("planar2")
    rng = np.random.default_rng(seed)
    q, v, a = rng.normal(size=(3, 5, 2))
    step, cost, zero = rng.uniform(0.1, 0.3, 5), Cost(0.7, 1e-4, 2.0), np.zeros((5, 2))
    gravity = inverse_dynamics(arm.model, q, zero, zero)
    moving = inverse_dynamics(arm.model, q, v, a) - gravity
    alpha, beta, gamma = slowdown_coefficients(cost, step, v, gravity, moving)
    torque = inverse_dynamics(arm.model, q, v / kappa, a / kappa**2)
    rate = 0.7 + 1e-4 * np.sum(torque**2, axis=1) + 2.0 * np.sum((v / kappa) ** 2, axis=1)
    assert alpha * kappa + beta / kappa + gamma / kappa**3 == pytest.approx(
        float(np.sum(rate * step) * kappa), rel=1e-9
    )


def test_cost_of_holding_still_is_the_holding_rate(arm):
    q = np.tile([0.3, -0.4], (3, 1))
    trajectory = JointTrajectory(np.arange(3.0), q, np.zeros((3, 2)), np.zeros((2, 2)), arm)
    rate = Cost().holding_rate(arm.gravity_torque_nm(q[0]))
    assert trajectory_cost(trajectory, arm, Cost()) == pytest.approx(2.0 * float(rate))
