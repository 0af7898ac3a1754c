r"""What a given trajectory costs, by quadrature of inverse dynamics along its interpolant."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.constraints import EndCost
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.physics.state import wrench_torque
from dmoc.robot.drive import drive_from_mapping, electrical_power_w
from dmoc.robot.robot import Robot

# Three-point Gauss-Legendre on [0, 1].
_NODES = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0


def cost_rate(
    cost: Cost | ElectricalCost,
    robot: Robot,
    q_rad: Array,
    velocity_rad_s: Array,
    acceleration_rad_s2: Array,
    torque_nm: Array,
) -> Array:
    """The integrand of J (K,) for rows of q, q̇, q̈, u (K, n).

    An electrical cost is taken with its own `friction_smoothing_rad_s`, as it is minimised; the
    joules of the exact loss model are `dmoc.robot.drive.electrical_power_w` without smoothing.
    """
    rate = cost.time + cost.velocity * np.sum(velocity_rad_s**2, axis=1)
    if isinstance(cost, Cost):
        rate = rate + cost.effort * np.sum(torque_nm**2, axis=1)
        return rate + cost.matrix_rate(q_rad, velocity_rad_s, torque_nm)
    drive = drive_from_mapping(robot.drive, robot.num_joints)
    power = electrical_power_w(
        velocity_rad_s, acceleration_rad_s2, torque_nm, drive, cost.friction_smoothing_rad_s
    )
    return rate + cost.energy * np.sum(power, axis=1)


def trajectory_cost(
    trajectory: JointTrajectory,
    robot: Robot,
    cost: Cost | ElectricalCost,
    wrench: Array | None = None,
    end_cost: EndCost | None = None,
) -> float:
    """J of the cubic interpolant of `trajectory` with the torques that it needs.

    Three Gauss points an interval; torques by inverse dynamics, rotor armature included, less what
    a force and moment `wrench` (6,) on the tool tip already gives; `end_cost` Φ(q_N, q̇_N, T) is
    added. Smoothing is not part of it.
    """
    step = np.diff(trajectory.t_s)
    times = (trajectory.t_s[:-1, None] + step[:, None] * _NODES).ravel()
    q, v, a, _ = trajectory.sample(times)
    torque = inverse_dynamics(robot.model, q, v, a)
    if wrench is not None:
        torque = torque - np.array([wrench_torque(robot, row, wrench) for row in q])
    rate = cost_rate(cost, robot, q, v, a, torque).reshape(-1, _NODES.size)
    total = float(np.sum(step[:, None] * _WEIGHTS * rate))
    if end_cost is not None:
        last = trajectory.q_rad[-1], trajectory.velocity_rad_s[-1], trajectory.duration_s
        total += float(end_cost.function(*last))
    return total


def executed_cost(problem: MotionProblem, trajectory: JointTrajectory) -> float:
    """`trajectory_cost` of a motion of `problem`, its wrench and end cost included."""
    return trajectory_cost(
        trajectory, problem.robot, problem.cost, problem.wrench, problem.limits.end_cost
    )
