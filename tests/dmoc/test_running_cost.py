"""The replayed cost is the discrete cost to second order in the step, for every kind of cost."""

import casadi as ca
import numpy as np
import pytest
from random_arms import random_problems, random_urdf

from dmoc.curves.time_scaling import time_scale
from dmoc.motion.constraints import EndCost, MotionLimits
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.trajectory import JointPath, JointTrajectory, inverse_dynamics
from dmoc.physics.resimulation import replay_motion
from dmoc.physics.running_cost import trajectory_cost
from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve

N = 3


def symmetric(seed: int, size: int) -> np.ndarray:
    factor = np.random.default_rng(seed).normal(size=(size, size))
    return factor @ factor.T


def final(q, v, t):
    return 3.0 * ca.sumsqr(q - 0.2) + 0.5 * ca.sumsqr(v) + 0.3 * t**2


def end_cost() -> EndCost:
    q, v, t = ca.SX.sym("q", N), ca.SX.sym("v", N), ca.SX.sym("T")
    return EndCost(ca.Function("final", [q, v, t], [final(q, v, t)]))


STATE, TORQUE = 0.2 * symmetric(1, 2 * N), 1e-4 * symmetric(2, N)
KINDS = {
    "scalars": (Cost(effort=1e-5), {}),
    "effort alone": (Cost(time=0.5, effort=1e-4, velocity=0.0), {}),
    "state matrix": (Cost(effort=1e-4, state_matrix=STATE), {}),
    "torque matrix": (Cost(torque_matrix=TORQUE), {}),
    "both matrices": (Cost(effort=0.0, velocity=0.0, state_matrix=STATE, torque_matrix=TORQUE), {}),
    "electrical": (ElectricalCost(time=20.0, friction_smoothing_rad_s=0.3), {}),
    "wrench": (Cost(effort=1e-4), {"wrench": np.array([30.0, 0.0, -60.0, 5.0, 10.0, 0.0])}),
    "end cost": (
        Cost(),
        {
            "limits": MotionLimits(
                end_cost=end_cost(), free_goal_joints=(1, 2), free_goal_velocity=True
            )
        },
    ),
    "end velocities": (
        Cost(effort=1e-5),
        {"start_velocity_rad_s": 0.3, "goal_velocity_rad_s": -0.2},
    ),
    "fixed duration": (Cost(effort=1e-4, state_matrix=STATE), {"duration_s": 2.5}),
}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    urdf = random_urdf(np.random.default_rng(5), tmp_path_factory.mktemp("arms"), N)
    with open(urdf.with_name("robot.yaml"), "a") as settings:
        settings.write("drive: {class: ur}\n")
    return load_robot(urdf)


@pytest.mark.parametrize("kind", KINDS)
def test_replayed_cost_is_the_discrete_cost(robot, kind) -> None:
    cost, fields = KINDS[kind]
    problem = random_problems(robot, 1, seed=2)[0].replace(cost=cost, **fields)
    gaps = []
    for count in (20, 40, 80):
        motion = solve(problem.replace(num_intervals=count)).require()
        replayed = replay_motion(motion, cost, problem.wrench, problem.limits.end_cost).replay.cost
        gaps.append(abs(replayed - motion.cost) / motion.cost)
    assert gaps[0] > 2.5 * gaps[1] > 6.25 * gaps[2]
    assert gaps[2] < 1e-3


def test_matrices_are_priced_as_written(robot) -> None:
    """A parabola in every joint, its cost by a fine trapezoid, sample by sample."""
    rng = np.random.default_rng(3)
    q0, v0, a = rng.normal(size=(3, N))
    t = np.linspace(0.0, 1.0, 5)[:, None]
    curve = JointTrajectory(
        t[:, 0], q0 + v0 * t + a * t**2 / 2, v0 + a * t, np.zeros((4, N)), robot
    )
    cost = Cost(time=0.3, effort=1e-5, velocity=0.7, state_matrix=STATE, torque_matrix=TORQUE)
    times, rates = np.linspace(0.0, 1.0, 401), []
    for s in times:
        q, v = q0 + v0 * s + a * s**2 / 2, v0 + a * s
        u = inverse_dynamics(robot.model, q[None], v[None], a[None])[0]
        x = np.concatenate([q, v])
        scalars = 0.3 + 1e-5 * u @ u + 0.7 * v @ v
        rates.append(scalars + x @ STATE @ x + u @ TORQUE @ u)
    assert trajectory_cost(curve, robot, cost) == pytest.approx(
        np.trapezoid(rates, times), rel=1e-4
    )


def test_a_time_scaled_path_is_slowed_down_for_its_matrices(robot) -> None:
    problem = random_problems(robot, 1, seed=2)[0]
    dear = problem.replace(cost=Cost(state_matrix=np.diag([0.0] * N + [50.0] * N)))
    path = JointPath(np.stack([problem.start_rad, problem.goal_rad]))
    plain, slow = time_scale(path, problem), time_scale(path, dear)
    assert slow.trajectory.duration_s > 1.5 * plain.trajectory.duration_s
    assert slow.cost == pytest.approx(trajectory_cost(slow.trajectory, robot, dear.cost), rel=0.02)


def test_holding_still_counts_the_torque_matrix() -> None:
    torque = np.array([[1.0, -2.0, 3.0], [4.0, 0.0, -1.0]])
    rates = Cost(time=0.5, effort=0.1, torque_matrix=TORQUE).holding_rate(torque)
    wanted = [0.5 + 0.1 * u @ u + u @ TORQUE @ u for u in torque]
    np.testing.assert_allclose(rates, wanted)
