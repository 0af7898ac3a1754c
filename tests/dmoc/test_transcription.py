"""The assembled programme: derivatives, layout, and a naive evaluation."""

import casadi as ca
import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.physics.state import max_defect, residuals
from dmoc.programme.builder import Families, motion_programme
from dmoc.programme.transcription import Layout


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return random_robot(0, tmp_path_factory.mktemp("arms"), 3)


@pytest.fixture(autouse=True)
def _virtual_machine(monkeypatch):
    """Compiled functions have no derivatives for CasADi to check."""
    monkeypatch.setenv("DMOC_BACKEND", "vm")


def test_layout_is_a_permutation() -> None:
    layout = Layout(5, 3)
    used = np.concatenate([layout.knots().ravel(), layout.torques().ravel(), [layout.step]])
    assert sorted(used) == list(range(layout.size))
    q, u = np.arange(18.0).reshape(6, 3), np.arange(15.0).reshape(5, 3)
    x = layout.pack(q, u, 0.5)
    np.testing.assert_array_equal(x[layout.intervals()[:, 2]], [*q[2], *q[3], *u[2], 0.5])


@pytest.mark.parametrize(
    "families",
    [Families(), Families(velocity=True), Families(True, True), Families(True, True, 8)],
)
def test_assembled_derivatives_equal_casadi(robot, families) -> None:
    problem = random_problems(robot, 1, num_intervals=6)[0]
    motion = motion_programme(problem, families)
    programme = motion.programme
    rng = np.random.default_rng(0)
    x, p = rng.normal(size=programme.num_variables), rng.normal(size=programme.num_params)
    x[-1] = 0.1
    # Limits are divisors.
    for name in ("u_max", "v_max", "a_max", "scale"):
        if name in motion.params:
            p[motion.params[name]] = rng.uniform(0.5, 2.0, motion.params[name].shape)
    lam = rng.normal(size=programme.num_rows)
    xs, ps = ca.MX.sym("x", len(x)), ca.MX.sym("p", len(p))
    f, g = programme.nlp(xs, ps)
    lagrangian = 0.7 * f + ca.dot(lam, g)
    check = ca.Function(
        "check",
        [xs, ps],
        [ca.gradient(f, xs), ca.jacobian(g, xs), ca.triu(ca.hessian(lagrangian, xs)[0])],
    )
    expected = [np.array(part) for part in check(x, p)]
    found = (
        programme.grad_f(x, p)[1],
        programme.jac_g(x, p)[1],
        programme.hess_lag(x, p, 0.7, lam),
    )
    for mine, theirs in zip(found, expected):
        np.testing.assert_allclose(np.array(mine), theirs, atol=1e-9 * max(1, np.abs(theirs).max()))
    np.testing.assert_array_equal(
        np.array(programme.grad_f(x, p)[0]), np.array(programme.nlp(x, p)[0])
    )


def test_momentum_rows_equal_the_residuals_of_pinocchio(robot) -> None:
    problem = random_problems(robot, 1, num_intervals=4)[0]
    motion = motion_programme(problem, Families())
    rng = np.random.default_rng(1)
    q, torque, h = rng.normal(size=(5, 3)), rng.normal(size=(4, 3)) * 20, 0.06
    x = motion.layout.pack(q, torque / robot.torque_limit_nm, h)
    p = motion.pack(scale=1.0, u_max=robot.torque_limit_nm, weights=0.0, smoothing=0.0)
    rows = np.array(motion.programme.nlp(x, p)[1]).ravel()[motion.rows["momentum"]]
    left, right = residuals(problem, q, torque, h)
    expected = np.vstack([left[0], left[1:] + right[:-1], right[-1]])
    np.testing.assert_allclose(rows, expected, atol=1e-10)
    worst = np.max(np.abs(expected) / (h * robot.torque_limit_nm))
    assert max_defect(problem, q, left, right, h) == pytest.approx(worst)
