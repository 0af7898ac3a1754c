"""Motions of `solve` in a simulator that shares no code with ours."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from mujoco_arm import mujoco_model
from random_arms import random_problems

from dmoc.physics.resimulation import SUBSTEPS, WINDOW, replay_motion, simulate_tracking
from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve

ROBOTS = ("ur10e_class", "irb6640_class")


@pytest.mark.parametrize("name", ROBOTS)
def test_both_simulators_have_the_same_dynamics(name: str) -> None:
    model = load_robot(name).model
    other, data = mujoco_model(model, 1e-3), model.createData()
    state, rng = mujoco.MjData(other), np.random.default_rng(0)
    for _ in range(20):
        q, v, u = rng.normal(size=(3, model.nv))
        state.qpos[:], state.qvel[:], state.qfrc_applied[:] = q, v, 100 * u
        mujoco.mj_forward(other, state)
        expected = pin.aba(model, data, q, v, 100 * u)
        np.testing.assert_allclose(state.qacc, expected, atol=1e-7 * max(1, np.abs(expected).max()))


@pytest.mark.parametrize("name", ROBOTS)
def test_windows_in_mujoco_agree_with_the_replay(name: str) -> None:
    robot = load_robot(name)
    for problem in random_problems(robot, 2, seed=11):
        motion = replay_motion(solve(problem))
        t = motion.trajectory
        h = t.duration_s / t.num_intervals
        other = mujoco_model(robot.model, h / SUBSTEPS)
        state, worst = mujoco.MjData(other), 0.0
        for k in range(0, t.num_intervals, WINDOW):
            state.qpos[:], state.qvel[:] = t.q_rad[k], t.velocity_rad_s[k]
            for j in range(WINDOW):
                state.qfrc_applied[:] = t.torque_nm[k + j]
                mujoco.mj_step(other, state, SUBSTEPS)
            worst = max(worst, np.abs(state.qpos - t.q_rad[k + WINDOW]).max())
        assert worst == pytest.approx(motion.replay_error_rad, rel=1e-3, abs=1e-7)
        assert worst < 0.02


@pytest.mark.parametrize("name", ROBOTS)
def test_tracking_in_mujoco(name: str) -> None:
    """Feed-forward torques plus a stiff controller; friction and the rest are not there."""
    robot = load_robot(name)
    problem = random_problems(robot, 1, seed=12)[0]
    t = solve(problem).trajectory
    h = t.duration_s / t.num_intervals
    other = mujoco_model(robot.model, h / SUBSTEPS)
    state, w, data = mujoco.MjData(other), 15.0, robot.model.createData()
    state.qpos[:] = t.q_rad[0]
    worst = 0.0
    for i in range(t.num_intervals * SUBSTEPS):
        now = t.sample(i * h / SUBSTEPS)
        mass = pin.crba(robot.model, data, state.qpos.copy())
        mass = np.triu(mass) + np.triu(mass, 1).T
        error = w * w * (now.q_rad[0] - state.qpos) + 2 * w * (now.velocity_rad_s[0] - state.qvel)
        state.qfrc_applied[:] = t.torque_nm[i // SUBSTEPS] + mass @ error
        mujoco.mj_step(other, state)
        if (i + 1) % SUBSTEPS == 0:
            worst = max(worst, np.abs(state.qpos - t.q_rad[(i + 1) // SUBSTEPS]).max())
    ours = np.abs(simulate_tracking(robot, t) - t.q_rad).max()
    assert worst < 2e-3
    assert worst == pytest.approx(ours, rel=0.02, abs=1e-6)
