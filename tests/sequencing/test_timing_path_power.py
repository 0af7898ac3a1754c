"""Torque and power along a path against inverse dynamics; energies of whole timelines."""

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.robot.drive import electrical_power_w
from dmoc.robot.robot import load_robot
from sequencing.timing.power.along_path import (
    drive_of,
    exact_power_w,
    path_power,
    path_torque_nm,
    power_table,
)
from sequencing.timing.power.dc_link import LinkParams
from sequencing.timing.power.timeline import (
    cost,
    cost_and_gradient,
    cost_batch,
    drawn_j,
    make_timeline,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "naive"))
from naive_timeline import grid_energy_j

ROBOT = load_robot("irb6640_class").with_payload(60.0)
LOW = np.array([-1.0, -0.3, -0.6, -1.0, -1.0, -1.0])
HIGH = np.array([1.0, 0.8, 0.4, 1.0, 1.0, 1.0])


def motions(seed: int, count: int = 3):
    rng = np.random.default_rng(seed)
    return [
        trapezoid_motion(ROBOT, rng.uniform(LOW, HIGH), rng.uniform(LOW, HIGH))
        for _ in range(count)
    ]


def test_torque_at_override_one_is_inverse_dynamics() -> None:
    for motion in motions(0):
        path = path_power(ROBOT, motion)
        expected = motion.sample(path.middle_s).torque_nm
        np.testing.assert_allclose(path_torque_nm(path), expected, atol=1e-8)


def test_torque_at_override_one_is_that_of_the_symbolic_dynamics() -> None:
    dynamics = pytest.importorskip("dmoc.physics.dynamics")
    motion = motions(0)[0]
    path = path_power(ROBOT, motion)
    arm = dynamics.arm_model(ROBOT.model)
    q, v, a = (ca.SX.sym(name, 6) for name in "qva")
    rnea = ca.Function("rnea", [q, v, a], [dynamics.inverse_dynamics(arm, q, v, a)])
    sample = motion.sample(path.middle_s[::20])
    for k, (x, y, z) in enumerate(zip(*sample[:3])):
        tau = np.array(rnea(x, y, z)).ravel()
        np.testing.assert_allclose(path_torque_nm(path)[::20][k], tau, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.floats(-3, 3), st.floats(0.0, 1.5), st.integers(0, 5))
def test_torque_for_any_speed_profile_is_inverse_dynamics(rate_change, rate, seed) -> None:
    motion = motions(seed, 1)[0]
    path = path_power(ROBOT, motion, cell_s=0.1)
    data = ROBOT.model.createData()
    torque = path_torque_nm(path, rate, rate_change)
    for k in range(path.num_samples):
        v = path.velocity_rad_s[k] * rate
        a = path.acceleration_rad_s2[k] * rate**2 + path.velocity_rad_s[k] * rate_change
        expected = pin.rnea(ROBOT.model, data, path.q_rad[k], v, a)
        np.testing.assert_allclose(torque[k], expected, atol=1e-7)


def test_a_wrench_adds_its_static_torque_only() -> None:
    motion = motions(1, 1)[0]
    wrench = np.array([10.0, -20.0, 300.0, 1.0, 2.0, 3.0])
    free, loaded = path_power(ROBOT, motion), path_power(ROBOT, motion, wrench=wrench)
    np.testing.assert_array_equal(free.speed_nm, loaded.speed_nm)
    k = free.num_samples // 2
    data, h = ROBOT.model.createData(), 1e-6
    frame = ROBOT.flange_id
    for j in range(6):
        lift = []
        for sign in (1, -1):
            q = free.q_rad[k].copy()
            q[j] += sign * h
            pin.framesForwardKinematics(ROBOT.model, data, q)
            lift.append(data.oMf[frame].copy())
        middle = lift[1].actInv(lift[0])
        turn = lift[1].rotation @ pin.log3(middle.rotation) / (2 * h)
        shift = (lift[0].translation - lift[1].translation) / (2 * h)
        work = wrench[:3] @ shift + wrench[3:] @ turn
        change = free.static_nm[k, j] - loaded.static_nm[k, j]
        assert change == pytest.approx(work, abs=1e-3)


@pytest.mark.parametrize("name", ["ur10e_class", "irb6640_class"])
def test_the_kernel_is_the_drive_model(name) -> None:
    robot = load_robot(name)
    base = drive_of(robot)
    drive = replace(base, root_friction_nm_s=np.arange(6.0), extra_inertia_kg_m2=np.full(6, 0.5))
    motion = trapezoid_motion(robot, np.full(6, 0.1), np.array([0.9, -0.4, 0.3, 0.6, 0.2, 0.1]))
    for params in (base, drive):
        path = path_power(robot, motion, drive=params)
        for override in (0.2, 1.0):
            qd = override * path.velocity_rad_s
            qdd = override**2 * path.acceleration_rad_s2
            torque = path_torque_nm(path, override)
            expected = electrical_power_w(qd, qdd, torque, params).sum(axis=1)
            np.testing.assert_allclose(exact_power_w(path, override), expected, rtol=1e-9)


@pytest.mark.parametrize("override", [0.07, 0.3, 0.55, 0.9, 1.0])
def test_quartic_energy_is_within_two_thousandths_of_the_exact_one(override) -> None:
    for motion in motions(3):
        path = path_power(ROBOT, motion)
        power = exact_power_w(path, override)
        exact = power @ path.width_s / override
        scale = np.abs(power) @ path.width_s / override
        assert abs(power_table(path).energy_j(override) - exact) < 2e-3 * scale


def timeline(seed: int, link: LinkParams, total_s: float = 2.4, count: int = 3):
    tables = [power_table(path_power(ROBOT, m)) for m in motions(seed, count)]
    return make_timeline([[t] for t in tables], total_s, [link], [0] * count)


def test_schedule_energy_matches_the_naive_loop() -> None:
    link = LinkParams(capacitance_f=2e-3)
    line = timeline(4, link)
    start, override = np.array([0.0, 0.31, 0.12]), np.array([0.8, 0.93, 0.7])
    naive = grid_energy_j(
        [ROBOT] * 3, drive_of(ROBOT), motions(4), start, override, 2.4, link, steps=1200
    )
    assert cost(line, start, override) == pytest.approx(naive, rel=2e-3)


def test_total_drawn_energy_does_not_depend_on_the_step() -> None:
    tables = [power_table(path_power(ROBOT, m)) for m in motions(5)]
    start, override = np.array([0.0, 0.31, 0.12]), np.array([0.8, 0.93, 0.7])
    sums = [
        drawn_j(
            make_timeline([[t] for t in tables], 2.4, [LinkParams()], [0] * 3, dt),
            start,
            override,
        ).sum()
        for dt in (0.04, 0.004, 0.0007)
    ]
    np.testing.assert_allclose(sums, sums[0], rtol=1e-9)


def test_several_trajectories_on_one_robot_equal_their_sum() -> None:
    tables = [power_table(path_power(ROBOT, m)) for m in motions(6)]
    line = make_timeline([tables], 9.0, [LinkParams()], [0])
    start, override = np.array([0.2, 2.5, 5.0]), np.array([0.9, 1.0, 0.5])
    expected = sum(t.energy_j(d) for t, d in zip(tables, override))
    ends = [0.0, *(start + line.duration_s / override)]
    gaps = np.append(start, 9.0) - ends
    holds = [t.hold_start_w for t in tables] + [tables[-1].hold_end_w]
    expected += float(np.dot(gaps, holds))
    assert drawn_j(line, start, override).sum() == pytest.approx(expected, rel=1e-9)


def test_batch_equals_single() -> None:
    line = timeline(7, LinkParams())
    rng = np.random.default_rng(0)
    start, override = rng.uniform(0, 0.5, (20, 3)), rng.uniform(0.6, 1.0, (20, 3))
    single = [cost(line, s, d) for s, d in zip(start, override)]
    np.testing.assert_allclose(cost_batch(line, start, override), single)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([1e-4, 1e-3, 1e-2]))
def test_gradient_is_the_finite_difference(seed, capacitance) -> None:
    rng = np.random.default_rng(seed)
    line = LINES.setdefault(capacitance, timeline(8, LinkParams(capacitance_f=capacitance)))
    start, override = rng.uniform(0.01, 0.5, 3), rng.uniform(0.6, 0.99, 3)
    value, by_start, by_override = cost_and_gradient(line, start, override)
    assert value == pytest.approx(cost(line, start, override))
    h = 1e-7
    numeric, analytic = [], np.concatenate([by_start, by_override])
    for k in range(6):
        step = np.zeros(6)
        step[k] = h
        up = cost(line, start + step[:3], override + step[3:])
        down = cost(line, start - step[:3], override - step[3:])
        numeric.append((up - down) / (2 * h))
    # A kink of the recursion may lie within h; a wrong gradient would be wrong nearly everywhere.
    wrong = np.abs(numeric - analytic) > 1e-3 * np.abs(analytic) + 0.5
    assert wrong.sum() <= 1


LINES: dict = {}
