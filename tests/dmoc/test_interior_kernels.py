"""The Riccati recursion against one dense matrix, and frames against the assembled programme."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.interior.filter import Filter, Merit
from dmoc.interior.frames import frames_of, places_of_end
from dmoc.interior.oracle import Oracle
from dmoc.interior.point_kernels import FreeBox, gather_rows, gradients
from dmoc.interior.system import NewtonSystem
from dmoc.motion.constraints import MotionLimits, TorqueSpeed
from dmoc.programme.builder import Families, motion_programme
from dmoc.programme.curve_limits import no_lag, no_margins
from dmoc.programme.numbers import parameters, variable_bounds
from tests.naive.naive_newton import dense_solution, has_right_inertia, places


def random_system(rng, count: int, n: int, last_free: int, fixed_share: float, curvature: float):
    """Blocks with the zeros and the diagonal parts of a motion's; `curvature` shifts them."""
    state, full = 3 * n + 1, 5 * n + 1
    hess = rng.normal(size=(count, full, full))
    hess = np.einsum("kij,klj->kil", hess, hess) / full - curvature * np.eye(full)
    rows = rng.normal(scale=0.3, size=(count + 1, n, full))
    rows[:, :, state : state + n] -= 3 * np.eye(n)
    for block in (slice(2 * n, 3 * n), slice(4 * n + 1, full)):
        rows[:, :, block] = 0.0
        rows[:, range(n), range(*block.indices(full))] = 1 + rng.random((count + 1, n))
    for block in (slice(0, n), slice(2 * n, 3 * n)):
        rows[0, :, block] = hess[0, block] = hess[0, :, block] = 0.0
    rows[count, :, state:] = 0.0
    size = (2 * count + 1) * n + 1
    fixed = np.zeros(size, dtype=bool)
    knots = 2 * n * np.arange(count + 1)[:, None] + np.arange(n)
    fixed[knots[0]] = fixed[knots[last_free + 1 :]] = True
    for knot in knots[1:last_free]:
        fixed[knot] = rng.random(n) < fixed_share
    return hess, rows, rng.random(size), fixed


def system_of(hess, rows, last_free: int) -> NewtonSystem:
    shape = SimpleNamespace(
        num_intervals=len(hess),
        num_joints=rows.shape[1],
        size=(2 * len(hess) + 1) * rows.shape[1] + 1,
    )
    system = NewtonSystem(shape, last_free)
    system.hess[:], system.rows[:] = hess, rows
    return system


@pytest.mark.parametrize(
    ("count", "n", "last_free", "share"),
    [(2, 2, 1, 0), (3, 2, 2, 0), (5, 3, 2, 0), (9, 3, 8, 0.4), (12, 6, 8, 0.1), (20, 6, 19, 0)],
)
def test_steps_equal_those_of_one_dense_matrix(count, n, last_free, share) -> None:
    rng = np.random.default_rng(count)
    hess, rows, diagonal, fixed = random_system(rng, count, n, last_free, share, 0.0)
    if share:
        fixed[-1] = True  # a given duration
    system = system_of(hess, rows, last_free)
    assert system.factorise(diagonal, fixed)
    assert system.shift == 0.0
    for _ in range(2):
        gradient, defect = rng.normal(size=len(diagonal)), rng.normal(size=(count + 1) * n)
        x, lam = system.solve(gradient, defect)
        want_x, want_lam = dense_solution(hess, rows, diagonal, fixed, gradient, defect)
        np.testing.assert_allclose(x, want_x, atol=1e-10)
        np.testing.assert_allclose(lam, want_lam, atol=1e-10)


@pytest.mark.parametrize("seed", range(6))
def test_the_shift_is_added_exactly_where_the_inertia_is_wrong(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curvature = rng.uniform(0.0, 4.0)
    hess, rows, diagonal, fixed = random_system(rng, 6, 2, 5, 0.0, curvature)
    system = system_of(hess, rows, 5)
    right = has_right_inertia(hess, rows, diagonal, fixed)
    assert system.factorise(diagonal, fixed)
    assert (system.shift == 0.0) == right
    assert has_right_inertia(hess, rows, diagonal + system.shift, fixed)
    gradient, defect = rng.normal(size=len(diagonal)), rng.normal(size=14)
    x, lam = system.solve(gradient, defect)
    want = dense_solution(hess, rows, diagonal + system.shift, fixed, gradient, defect)
    np.testing.assert_allclose(x, want[0], atol=1e-9)
    np.testing.assert_allclose(lam, want[1], atol=1e-9)


def test_both_inertias_occur_in_the_test_above() -> None:
    found = set()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        system = random_system(rng, 6, 2, 5, 0.0, rng.uniform(0.0, 4.0))
        found.add(has_right_inertia(*system))
    assert found == {True, False}


def test_dependent_rows_at_the_end_are_reported() -> None:
    rng = np.random.default_rng(1)
    hess, rows, diagonal, fixed = random_system(rng, 5, 2, 4, 0.0, 0.0)
    rows[3, :, 7:9] = rows[4, :, 2:4] = rows[5, :, 0:2] = 0.0  # q_4 is nowhere
    assert not system_of(hess, rows, 4).factorise(diagonal, fixed)


def test_places_of_the_end_skip_fixed_knots() -> None:
    at = places_of_end(6, 1, 4)
    assert at.shape == (4, 6)
    np.testing.assert_array_equal(at[0], [0, 1, 2, 3, 4, 5])  # q_2, q_3, u_2, h | q_4 | u_3
    np.testing.assert_array_equal(at[1], [1, 4, 5, 3, -1, 6])
    np.testing.assert_array_equal(at[3], [-1, -1, 7, 3, -1, -1])


@pytest.mark.parametrize("families", [Families(), Families(True, True, 8)])
def test_flat_derivatives_are_those_of_the_assembled_programme(tmp_path, families) -> None:
    arm = random_robot(5, tmp_path, 3)
    curve = TorqueSpeed(0.7 * arm.torque_limit_nm, 2.0 * arm.velocity_limit_rad_s)
    problem = random_problems(arm, 1, num_intervals=6)[0].replace(
        limits=MotionLimits(torque_speed=curve)
    )
    motion = motion_programme(problem, families)
    rng = np.random.default_rng(3)
    margins = no_margins(no_lag(6, 3))
    margins = replace(margins, mobility=rng.normal(size=(5, 3, 3)))
    p = parameters(problem, motion, rng.normal(size=(6, 6 * families.half_spaces)), margins)
    lower, upper = variable_bounds(problem, motion, None, margins.inside)
    x = rng.uniform(np.maximum(lower, -2), np.minimum(upper, 2))
    x[motion.layout.step] = 0.1
    frames = frames_of(motion)
    assert frames is not None
    oracle = Oracle(frames)
    oracle.set_params(p)
    y = rng.normal(size=motion.programme.num_rows)
    oracle.jacobian(x)
    oracle.hessian(x, y)
    value, rows = (np.array(v).ravel() for v in motion.programme.nlp(x, p))
    found = np.zeros(len(rows))
    num_limits = len(rows) - frames.num_momentum
    w = np.zeros(frames.size + num_limits)
    infinite = np.full(len(w), np.inf)
    no_step = np.zeros(frames.size, dtype=bool)
    found_value, *_ = gather_rows(
        oracle.values,
        frames.rows,
        np.zeros(frames.num_momentum),
        w,
        FreeBox(w - 1, infinite, no_step, frames.size, frames.num_momentum),
        found,
    )
    assert found_value == pytest.approx(value[0], rel=1e-13)
    np.testing.assert_allclose(found, rows, atol=1e-12)
    system = NewtonSystem(frames, 5)
    system.set_rows(oracle.slopes)
    grad, pull = np.zeros(frames.size), np.zeros(frames.size)
    system.pull(y[: frames.num_momentum], pull)
    gradients(oracle.slopes, y, frames.objective, frames.limit, grad, pull)
    jac = np.array(motion.programme.jac_g(x, p)[1])
    np.testing.assert_allclose(grad, np.array(motion.programme.grad_f(x, p)[1]).ravel(), atol=1e-10)
    np.testing.assert_allclose(pull, jac.T @ y, atol=1e-9)
    weight = rng.random(num_limits)
    system.set_hessian(oracle.curves, oracle.slopes, weight)
    upper_triangle = np.array(motion.programme.hess_lag(x, p, 1.0, y))
    want = upper_triangle + np.triu(upper_triangle, 1).T
    rows = jac[frames.num_momentum :]
    want += rows.T @ (weight[:, None] * rows)
    matrix = np.zeros_like(want)
    momentum = np.zeros((frames.num_momentum, frames.size))
    for k in range(7):
        at = places(k, 6, 3)
        here = at >= 0
        momentum[3 * k : 3 * k + 3, at[here]] += system.rows[k][:, here]
        if k < 6:
            matrix[np.ix_(at[here], at[here])] += system.hess[k][np.ix_(here, here)]
    np.testing.assert_allclose(momentum, jac[: frames.num_momentum], atol=1e-12)
    np.testing.assert_allclose(matrix, want, atol=1e-8 * np.abs(want).max())


def test_what_couples_more_than_one_frame_does_not_fit(tmp_path) -> None:
    arm = random_robot(5, tmp_path, 3)
    problem = random_problems(arm, 1, num_intervals=6)[0]
    for limits in (
        MotionLimits(rms_torque_nm=10.0),
        MotionLimits(free_goal_velocity=True),
    ):
        assert frames_of(motion_programme(problem.replace(limits=limits), Families())) is None


def test_a_filter_takes_what_is_better_in_one_of_two() -> None:
    known = Filter(1.0)
    start = Merit(1.0, 5.0, rate=1.0)
    assert known.accepts(start, Merit(0.5, 9.0), 1.0)
    assert known.accepts(start, Merit(1.0, 4.0), 1.0)
    assert not known.accepts(start, Merit(1.0, 5.0), 1.0)
    assert not known.accepts(start, Merit(0.1, np.inf), 1.0)
    assert not known.accepts(start, Merit(1e5, 0.0), 1.0)
    known.remember(start, Merit(0.5, 9.0), 1.0)
    assert not known.accepts(Merit(0.5, 9.0, 1.0), Merit(1.0, 8.0), 1.0)
    known.clear()
    assert known.accepts(Merit(0.5, 9.0, 1.0), Merit(1.0, 8.0), 1.0)
