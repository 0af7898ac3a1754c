"""The symbolic recursions against pinocchio on random trees."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from random_arms import random_model

from dmoc.errors import RobotError
from dmoc.physics.dynamics import arm_model, inverse_dynamics, lagrangian_gradients


def functions(arm, with_wrench=False):
    q, v, a = (ca.SX.sym(name, arm.num_joints) for name in "qva")
    w = ca.SX.sym("w", 6)
    sweep = lagrangian_gradients(arm, q, v, w if with_wrench else None)
    return (
        ca.Function("sweep", [q, v, w], list(sweep)),
        ca.Function("rnea", [q, v, a], [inverse_dynamics(arm, q, v, a)]),
    )


def full(upper):
    return np.triu(upper) + np.triu(upper, 1).T


@pytest.mark.parametrize("seed", range(20))
def test_momentum_force_and_torque_equal_pinocchio(seed: int) -> None:
    """Fifty states of each of twenty random trees: 1,000 in all."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, int(rng.integers(1, 8)))
    data, n = model.createData(), model.nv
    sweep, rnea = functions(arm_model(model))
    for _ in range(50):
        q, v, a = rng.normal(size=(3, n))
        mass = full(pin.crba(model, data, q))
        torque = pin.rnea(model, data, q, v, a).copy()
        force = pin.computeCoriolisMatrix(model, data, q, v).T @ v
        force = force - pin.computeGeneralizedGravity(model, data, q)
        scale = max(1.0, np.abs(torque).max())
        p, f = (np.array(x).ravel() for x in sweep(q, v, np.zeros(6)))
        assert np.abs(p - mass @ v).max() <= 1e-9 * scale
        assert np.abs(f - force).max() <= 1e-9 * max(scale, np.abs(force).max())
        assert np.abs(np.array(rnea(q, v, a)).ravel() - torque).max() <= 1e-9 * scale


def test_external_wrench_acts_through_the_jacobian() -> None:
    rng = np.random.default_rng(3)
    model = random_model(rng, 5, tree=False)
    point, data = rng.normal(size=3), model.createData()
    arm = arm_model(model, wrench_joint=4, wrench_point_m=point)
    sweep, _ = functions(arm, with_wrench=True)
    for _ in range(20):
        q, v, wrench = rng.normal(size=5), rng.normal(size=5), rng.normal(size=6)
        pin.computeJointJacobians(model, data, q)
        at_origin = pin.getJointJacobian(model, data, 5, pin.LOCAL_WORLD_ALIGNED)
        lever = data.oMi[5].rotation @ point
        moment = wrench[3:] + np.cross(lever, wrench[:3])
        expected = at_origin.T @ np.concatenate([wrench[:3], moment])
        change = np.array(sweep(q, v, wrench)[1] - sweep(q, v, np.zeros(6))[1]).ravel()
        np.testing.assert_allclose(change, expected, atol=1e-10)


def test_a_joint_of_two_axes_is_refused() -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    with pytest.raises(RobotError, match="joint-kind"):
        arm_model(model)


def test_a_known_pendulum() -> None:
    """m l² q̈ + m g l sin q = τ, angle from hanging."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    mass, length = 2.0, 0.7
    lever = np.array([0.0, 0.0, -length])
    model.appendBodyToJoint(joint, pin.Inertia(mass, lever, np.zeros((3, 3))), pin.SE3.Identity())
    sweep, rnea = functions(arm_model(model))
    p, f = sweep(0.3, 1.1, np.zeros(6))
    assert float(p) == pytest.approx(mass * length**2 * 1.1)
    assert float(f) == pytest.approx(-mass * 9.81 * length * np.sin(0.3))
    expected = mass * length**2 * 2.0 + mass * 9.81 * length * np.sin(0.3)
    assert float(rnea(0.3, 1.1, 2.0)) == pytest.approx(expected)
