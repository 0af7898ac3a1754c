"""The planar world against finite differences and dense sampling."""

import numpy as np
import pytest

from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import load_robot
from studies.stud_welding.planar_world import PlanarWorld

WORLD = PlanarWorld([1.0, 0.8], [[1.2, 0.9], [-0.3, 1.0]], [0.2, 0.15])
Q = np.random.default_rng(5).uniform(-2.5, 2.5, (60, 2))


def test_tip_is_where_the_robot_model_puts_it():
    robot = load_robot("planar2")
    tips = WORLD.joints_m(Q)[:, -1]
    for q, tip in zip(Q[:10], tips):
        np.testing.assert_allclose(robot.tip_pose(q).translation[[0, 2]], tip, atol=1e-12)


def test_gradients_match_finite_differences():
    rows, step = WORLD.rows(Q, 9.0), 1e-6
    for j in range(2):
        dq = np.eye(2)[j] * step
        up, down = WORLD.rows(Q + dq, 9.0), WORLD.rows(Q - dq, 9.0)
        slope = (up.distance_m - down.distance_m) / (2 * step)
        np.testing.assert_allclose(slope, rows.gradient[:, j], atol=1e-6)


def test_weights_and_reach_bound_every_displacement():
    rng = np.random.default_rng(6)
    for q in Q[:20]:
        dq = rng.uniform(-1e-3, 1e-3, 2)
        moved = np.abs(WORLD.phi(q[None] + dq) - WORLD.phi(q[None]))[0]
        assert moved <= WORLD.reach(q[None])[0] @ np.abs(dq) + 1e-5
        assert moved <= WORLD.weights(q[None])[0] @ np.abs(dq) + 1e-5


def trajectory(q0, q1, speed=0.0):
    q = np.array([q0, q1], dtype=float)
    return JointTrajectory([0.0, 1.0], q, np.full((2, 2), speed), np.zeros((1, 2)))


def test_a_disc_between_two_free_knots_is_caught():
    through = trajectory([0.1, 0.0], [1.2, 0.0])
    assert WORLD.phi(through.q_rad).min() > 0.05
    certificate = WORLD.certify(through)
    assert not certificate.ok
    failure = certificate.failures[0]
    assert failure.pair[1] == "disc_1"
    assert failure.distance_m <= WORLD.margin_m


@pytest.mark.parametrize("seed", range(8))
def test_certificate_agrees_with_dense_sampling(seed):
    rng = np.random.default_rng(seed)
    curve = trajectory(*rng.uniform(-1.5, 2.0, (2, 2)), speed=rng.uniform(-1, 1))
    dense = WORLD.phi(curve.sample(np.linspace(0, 1, 4000)).q_rad).min()
    certificate = WORLD.certify(curve)
    if certificate.ok:
        assert dense > WORLD.margin_m
    else:
        assert dense < WORLD.margin_m + 2e-3
