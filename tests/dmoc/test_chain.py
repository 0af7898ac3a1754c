"""The compiled inverse dynamics and its adjoint, against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from dmoc.motion.trajectory import inverse_dynamics
from dmoc.robot.robot import Tool, load_robot
from studies.ur3.adjoint_dynamics import chain_of


def dressed(name: str):
    tool = Tool(
        0.8, np.array([0.01, 0.02, 0.05]), np.diag([1e-3, 2e-3, 3e-3]), np.array([0.0, 0.03, 0.1])
    )
    turn = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 1.0), np.array([0.5, 0.2, 0.1]))
    return load_robot(name).with_tool(tool).with_payload(1.5).with_base(turn)


@pytest.mark.parametrize("name", ["ur3e_class", "ur10e_class", "planar2"])
def test_torque_and_adjoint_agree_with_pinocchio(name: str) -> None:
    robot = dressed(name)
    chain, n = chain_of(robot), robot.num_joints
    q, v, a, weight = np.random.default_rng(5).normal(size=(4, 2, 15, n))
    torque = chain.torque_nm(q, v, a)
    flat = [x.reshape(-1, n) for x in (q, v, a)]
    expected = inverse_dynamics(robot.model, *flat)
    np.testing.assert_allclose(torque.reshape(-1, n), expected, atol=1e-10)

    gradients = chain.pull_back(q, v, a, weight)
    data = robot.model.createData()
    for index in np.ndindex(2, 15):
        jacobians = pin.computeRNEADerivatives(robot.model, data, q[index], v[index], a[index])
        inertia = np.triu(jacobians[2]) + np.triu(jacobians[2], 1).T
        # Newer versions add the armature to the mass matrix themselves.
        if not np.allclose(np.diag(inertia), np.diag(pin.crba(robot.model, data, q[index]))):
            inertia = inertia + np.diag(robot.model.armature)
        for gradient, jacobian in zip(gradients, (jacobians[0], jacobians[1], inertia)):
            np.testing.assert_allclose(gradient[index], weight[index] @ jacobian, atol=1e-9)


def test_adjoint_agrees_with_finite_differences() -> None:
    chain = chain_of(dressed("ur3e_class"))
    point = np.random.default_rng(8).normal(size=(3, 1, 6))
    weight = np.random.default_rng(9).normal(size=(1, 6))
    gradients = chain.pull_back(*point, weight)
    step = 1e-6
    for part in range(3):
        for j in range(6):
            moved = [point.copy(), point.copy()]
            moved[0][part, 0, j] += step
            moved[1][part, 0, j] -= step
            ahead, behind = (np.sum(weight * chain.torque_nm(*x)) for x in moved)
            assert gradients[part][0, j] == pytest.approx((ahead - behind) / (2 * step), abs=1e-6)
