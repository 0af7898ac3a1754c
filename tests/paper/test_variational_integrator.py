"""The midpoint variational rule as an integrator: order, error against others, Noether.

Source: Björkenstam et al., section 2.3; Marsden and West, Discrete mechanics and variational
integrators, section 1.3 (discrete Noether theorem).
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from dmoc.programme.builder import arm_of
from dmoc.programme.stages import dynamics_stage
from dmoc.robot.robot import load_robot

sys.path.insert(0, str(Path(__file__).parents[1] / "naive"))
from naive_integrators import euler, runge_kutta, trapezoid


def variational(robot, q, v, u, h, steps):
    """Discrete trajectory (steps+1, n) and momenta p_k (steps+1, n) from (q_0, p_0 = M v_0)."""
    n, stage = robot.num_joints, dynamics_stage(arm_of(robot), False)
    theta = np.ones(2 * n)
    data = robot.model.createData()
    mass = pin.crba(robot.model, data, q)
    p = (np.triu(mass) + np.triu(mass, 1).T) @ v
    knots, momenta, guess = [q], [p], q + h * v
    for _ in range(steps):
        for _ in range(30):  # Newton on p_k + r⁻(q_k, q_{k+1}) = 0
            z = np.concatenate([knots[-1], guess, u, [h]])
            rows, nonzeros = stage.parts[1](z, theta)
            jac = np.array(ca.DM(stage.jac_sparsity, nonzeros))[:n, n : 2 * n]
            change = np.linalg.solve(jac, -(momenta[-1] + np.array(rows).ravel()[:n]))
            guess = guess + change
            if np.abs(change).max() < 1e-13:
                break
        z = np.concatenate([knots[-1], guess, u, [h]])
        momenta.append(np.array(stage.parts[0](z, theta)).ravel()[n:])
        knots.append(guess)
        guess = 2 * knots[-1] - knots[-2]
    return np.array(knots), np.array(momenta)


@pytest.fixture(scope="module")
def swing():
    """A free swing of two seconds from a bent pose, motors off; exact by fine Runge–Kutta."""
    robot = load_robot("ur10e_class")
    q = np.array([0.3, -1.0, 0.8, -0.4, 0.6, 0.2])
    v, u = np.zeros(6), np.zeros(6)
    exact, _ = runge_kutta(robot.model, q, v, u, 2.0 / 4000, 4000)
    return robot, q, v, u, exact


def test_second_order_and_better_than_the_trapezoid(swing) -> None:
    robot, q, v, u, exact = swing
    errors = {}
    for count in (20, 40, 80):
        h = 2.0 / count
        errors[count] = {
            "variational": np.abs(variational(robot, q, v, u, h, count)[0][-1] - exact).max(),
            "trapezoid": np.abs(trapezoid(robot.model, q, v, u, h, count)[0] - exact).max(),
            "euler": np.abs(euler(robot.model, q, v, u, h, count)[0] - exact).max(),
            "rk4": np.abs(runge_kutta(robot.model, q, v, u, h, count)[0] - exact).max(),
        }
    fine, coarse = errors[80], errors[40]
    assert 3.0 < coarse["variational"] / fine["variational"] < 5.5
    assert fine["variational"] < 0.5 * fine["trapezoid"]
    assert fine["variational"] < 0.05 * fine["euler"]
    # Not a claim of ours: at this horizon the fourth-order rule is more accurate.
    assert fine["rk4"] < fine["variational"]


def test_discrete_noether_theorem(swing) -> None:
    """Turning the base is a symmetry: its momentum stays when its motor is off."""
    robot, q, _, _, _ = swing
    rng = np.random.default_rng(0)
    torque = np.concatenate([[0.0], rng.normal(size=5) * 5])
    v = rng.normal(size=6) * 0.5
    _, momenta = variational(robot, q, v, torque, 0.02, 100)
    assert np.abs(momenta[:, 0] - momenta[0, 0]).max() < 1e-10
    assert np.abs(momenta[:, 1] - momenta[0, 1]).max() > 1e-2
