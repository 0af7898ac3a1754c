"""Discrete Euler–Lagrange rows against a naive discrete Lagrangian, and their derivatives."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from random_arms import random_model

from dmoc.physics.discrete import del_rows, midpoint
from dmoc.physics.dynamics import arm_model
from dmoc.programme.stages import (
    dynamics_stage,
    electrical_stage,
    expression_stage,
    quadratic_stage,
)
from dmoc.robot.drive import ur_class_drive


def naive_discrete_lagrangian(model: pin.Model, qa, qb, h: float) -> float:
    data = model.createData()
    q, v = (qa + qb) / 2, (qb - qa) / h
    return h * (
        pin.computeKineticEnergy(model, data, q, v) - pin.computePotentialEnergy(model, data, q)
    )


def test_rows_are_the_slot_derivatives_of_the_discrete_lagrangian() -> None:
    rng = np.random.default_rng(0)
    model = random_model(rng, 4)
    qa, qb, u = rng.normal(size=(3, 4))
    h, eps = 0.07, 1e-6
    expected = []
    for slot in (0, 1):
        for j in range(4):
            shift = np.eye(4)[j] * eps
            ends = [(qa + s * shift, qb) if slot == 0 else (qa, qb + s * shift) for s in (1, -1)]
            plus, minus = (naive_discrete_lagrangian(model, *e, h) for e in ends)
            expected.append((plus - minus) / (2 * eps) + h / 2 * u[j])
    rows = ca.DM(np.ones(4))
    found = np.array(ca.evalf(del_rows(arm_model(model), ca.DM(qa), ca.DM(qb), ca.DM(u), h, rows)))
    np.testing.assert_allclose(found.ravel(), expected, atol=2e-6)


@pytest.mark.parametrize("with_wrench", [False, True])
def test_hand_written_derivatives_equal_automatic_ones(with_wrench: bool) -> None:
    rng = np.random.default_rng(1)
    arm = arm_model(random_model(rng, 5, tree=False))
    stage = dynamics_stage(arm, with_wrench)
    n = arm.num_joints
    z, theta = ca.SX.sym("z", stage.num_local), ca.SX.sym("t", stage.num_params)
    lam = ca.SX.sym("lam", 2 * n)
    rows = stage.parts[0](z, theta)
    plain = expression_stage("plain", z, theta, rows)
    for _ in range(5):
        at = rng.normal(size=stage.num_local)
        at[-1] = rng.uniform(0.02, 0.5)
        values, weights = rng.normal(size=stage.num_params), rng.normal(size=2 * n)
        for mine, theirs, which in ((stage, plain, 1), (stage, plain, 2)):
            sparsity = (mine.jac_sparsity, mine.hess_sparsity)[which - 1]
            other = (theirs.jac_sparsity, theirs.hess_sparsity)[which - 1]
            args = (at, values) if which == 1 else (at, values, weights)
            a, b = mine.parts[which](*args), theirs.parts[which](*args)
            a, b = (a[1], b[1]) if which == 1 else (a, b)
            a, b = np.array(ca.DM(sparsity, a)), np.array(ca.DM(other, b))
            np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(b).max())
    assert lam.shape == (2 * n, 1)


def test_cost_stages_integrate_the_rate_at_the_midpoint() -> None:
    rng = np.random.default_rng(2)
    n, h = 6, 0.1
    qa, qb, u = rng.normal(size=(3, n))
    u_max = rng.uniform(10, 100, n)
    z = np.concatenate([qa, qb, u, [h]])
    _, v = midpoint(qa, qb, h)
    quadratic = quadratic_stage(n).parts[0](z, np.concatenate([[1.0, 1e-6, 2.0], u_max]))
    torque = u * u_max
    assert float(quadratic) == pytest.approx(h * (1 + 1e-6 * torque @ torque + 2.0 * v @ v))
    drive = ur_class_drive()
    from dmoc.robot.drive import electrical_power_w

    electrical = electrical_stage(n, drive, 0.02).parts[0](
        z, np.concatenate([[0.5, 2.0, 0.1], u_max])
    )
    power = np.sum(electrical_power_w(v, 0 * v, torque, drive, 0.02))
    assert float(electrical) == pytest.approx(h * (0.5 + 2.0 * power + 0.1 * v @ v), rel=1e-9)
