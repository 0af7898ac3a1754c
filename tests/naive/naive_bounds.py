"""Slow oracles of `sequencing.bounds`: the Lie derivative and the relaxed cost, point by point."""

from __future__ import annotations

import numpy as np

from dmoc.motion.cost import Cost
from dmoc.physics.state import mass_matrices
from dmoc.robot.robot import Robot
from sequencing.bounds.series import ArmSeries


def reference_torque(series: ArmSeries, alpha, q, n):
    """s(q) (n,): the averaged gravity torque of the bearing joints, scaled."""
    s = np.zeros(n)
    mean = series.mean_gravity(np.asarray(q)[None, list(series.bearing)])[0]
    s[list(series.bearing)] = np.asarray(alpha) * mean
    return s


def lie_derivative(robot: Robot, series: ArmSeries, alpha, q, step: float = 1e-5):
    """L_s M (n, n) by central differences: M transported along s, and s itself differentiated."""
    n = robot.num_joints
    s = reference_torque(series, alpha, q, n)
    size = max(np.linalg.norm(s), 1.0)
    ahead, behind = (mass_matrices(robot, (q + e * step * s / size)[None])[0] for e in (1, -1))
    along = (ahead - behind) / (2 * step) * size
    slope = np.column_stack(
        [
            (reference_torque(series, alpha, q + e, n) - reference_torque(series, alpha, q - e, n))
            / (2 * step)
            for e in step * np.eye(n)
        ]
    )
    mass = mass_matrices(robot, q[None])[0]
    return along + slope.T @ mass + mass @ slope


def relaxed_rate(robot: Robot, series: ArmSeries, cost: Cost, alpha, q, v) -> float:
    """c_t + c_e (2 s·g − ‖s‖²) + vᵀ(c_v I − c_e L_s M) v at one state."""
    s = reference_torque(series, alpha, q, robot.num_joints)
    form = cost.velocity * np.eye(len(q)) - cost.effort * lie_derivative(robot, series, alpha, q)
    g = robot.gravity_torque_nm(q)
    return float(cost.time + cost.effort * (2 * s @ g - s @ s) + v @ form @ v)
