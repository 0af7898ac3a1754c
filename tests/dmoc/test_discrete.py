"""Discrete Euler–Lagrange rows against a naive discrete Lagrangian, and their derivatives."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from random_arms import random_model

from dmoc.physics.discrete import del_rows, midpoint
from dmoc.physics.dynamics import arm_model, inverse_dynamics, lagrangian_gradients
from dmoc.programme.cost_stages import (
    electrical_rate,
    matrix_rate,
    midpoint_cost_stage,
    quadratic_rate,
    spread_cost_stage,
)
from dmoc.programme.stages import dynamics_stage, expression_stage
from dmoc.robot.drive import electrical_power_w, ur_class_drive


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


def rates(n: int, rng: np.random.Generator) -> dict:
    """Every kind of rate with weights of its own and the same formula in numpy."""
    factors = rng.normal(size=(2 * n, 2 * n)), rng.normal(size=(n, n))
    state, effort = (factor @ factor.T for factor in factors)
    drive = ur_class_drive(n)

    def quadratic(q, v, u):
        return 1.0 + 1e-3 * u @ u + 2.0 * v @ v

    def matrices(q, v, u):
        x = np.concatenate([q, v])
        return quadratic(q, v, u) + x @ state @ x + u @ effort @ u

    def electrical(q, v, u):
        return 1.0 + 1e-3 * np.sum(electrical_power_w(v, 0 * v, u, drive, 0.3)) + 2.0 * v @ v

    weights = np.array([1.0, 1e-3, 2.0])
    with_matrices = np.concatenate([weights, state.ravel(), effort.ravel()])
    return {
        "quadratic": (quadratic_rate(), weights, quadratic),
        "matrices": (matrix_rate(n), with_matrices, matrices),
        "electrical": (electrical_rate(n, drive, 0.3), weights, electrical),
    }


KINDS = ("quadratic", "matrices", "electrical")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("kappa", [0.0, 1 / 12, 1 / 4])
def test_cost_stages_take_the_mean_rate_beside_the_mean_speed(kind: str, kappa: float) -> None:
    rng = np.random.default_rng(2)
    model = random_model(rng, 4, tree=False)
    arm, n, h = arm_model(model), 4, 0.1
    rate, weights, naive = rates(n, rng)[kind]
    qa, qb, u = rng.normal(size=(3, n))
    u_max, data = rng.uniform(10, 100, n), model.createData()
    q, v = midpoint(qa, qb, h)
    spread = np.sqrt(kappa) * h * pin.aba(model, data, q, v, u * u_max)
    wanted = h / 2 * sum(naive(q, v + s * spread, u * u_max) for s in (1, -1))
    z = np.concatenate([qa, qb, u, [h]])
    stage, theta = spread_cost_stage(arm, rate, False), np.concatenate([weights, [kappa], u_max])
    assert float(stage.parts[0](z, theta)) == pytest.approx(wanted, rel=1e-9)
    if kappa == 0:
        plain = midpoint_cost_stage(n, rate).parts[0](z, np.concatenate([weights, u_max]))
        assert float(plain) == pytest.approx(wanted, rel=1e-12)


def test_a_wrench_is_no_acceleration() -> None:
    """u = b − Jᵀw holds a moving arm's speeds: no spread, and so the plain cost."""
    rng = np.random.default_rng(5)
    arm, n, h = arm_model(random_model(rng, 4, tree=False)), 4, 0.1
    qa, qb = rng.normal(size=(2, n))
    q, v = midpoint(qa, qb, h)
    wrench = rng.normal(size=6) * 20
    u = np.array(inverse_dynamics(arm, ca.DM(q), ca.DM(v), ca.DM.zeros(n), ca.DM(wrench))).ravel()
    z, weights = np.concatenate([qa, qb, u, [h]]), np.array([1.0, 1e-6, 1.0])
    stage = spread_cost_stage(arm, quadratic_rate(), True)
    found = stage.parts[0](z, np.concatenate([weights, [0.25], np.ones(n), wrench]))
    wanted = h * (1 + 1e-6 * u @ u + v @ v)
    assert float(found) == pytest.approx(wanted, rel=1e-9)
    plain = inverse_dynamics(arm, ca.DM(q), ca.DM(v), ca.DM.zeros(n))
    pushed, alone = (lagrangian_gradients(arm, ca.DM(q), ca.DM(v), w)[1] for w in (wrench, None))
    np.testing.assert_allclose(np.array(plain).ravel() - u, np.array(pushed - alone).ravel())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("with_wrench", [False, True])
def test_derivatives_of_the_cost_equal_automatic_ones(kind: str, with_wrench: bool) -> None:
    rng = np.random.default_rng(3)
    n = 3
    arm = arm_model(random_model(rng, n, tree=False))
    rate, weights, _ = rates(n, rng)[kind]
    stage = spread_cost_stage(arm, rate, with_wrench)
    z, theta = ca.SX.sym("z", stage.num_local), ca.SX.sym("t", stage.num_params)
    value = stage.parts[0](z, theta)
    wanted = ca.Function("wanted", [z, theta], [ca.jacobian(value, z), ca.hessian(value, z)[0]])
    for _ in range(5):
        at = np.concatenate([rng.normal(size=3 * n), [rng.uniform(0.02, 0.5)]])
        u_max, tail = rng.uniform(10, 100, n), 20 * rng.normal(size=6 if with_wrench else 0)
        values = np.concatenate([weights, [0.25], u_max, tail])
        first, second = (np.array(x) for x in wanted(at, values))
        mine = np.array(ca.DM(stage.jac_sparsity, stage.parts[1](at, values)[1]))
        np.testing.assert_allclose(mine, first, atol=1e-9 * np.abs(first).max())
        mine = np.array(ca.DM(stage.hess_sparsity, stage.parts[2](at, values, 1.7))) / 1.7
        np.testing.assert_allclose(mine, np.triu(second), atol=1e-9 * np.abs(second).max())
