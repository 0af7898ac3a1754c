"""Momenta, velocities and residuals of a knot sequence, outside of any solver.

Everything here comes from `pinocchio`: the solver's own functions are not asked.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.robot.robot import Robot


def mass_matrices(robot: Robot, q: Array) -> Array:
    """M(q) (K, n, n) [kg·m²], rotor armature included, for rows of q (K, n)."""
    data = robot.model.createData()
    upper = np.array([pin.crba(robot.model, data, row) for row in q])
    lower = np.tri(robot.num_joints, k=-1, dtype=bool)
    return np.where(lower, upper.transpose(0, 2, 1), upper)


def residuals(problem: MotionProblem, q: Array, torque: Array, h: float) -> tuple[Array, Array]:
    """r⁻, r⁺ (N, n) [N·m·s] of every interval (see `dmoc.physics.discrete`), unscaled.

    ∂L/∂q = C(q, v)ᵀ v − g(q), because Ṁ = C + Cᵀ for the Coriolis matrix of `pinocchio`.
    """
    robot = problem.robot
    data = robot.model.createData()
    middle, v = (q[1:] + q[:-1]) / 2, np.diff(q, axis=0) / h
    p = np.einsum("kij,kj->ki", mass_matrices(robot, middle), v)
    force = np.array(
        [
            pin.computeCoriolisMatrix(robot.model, data, a, b).T @ b
            - pin.computeGeneralizedGravity(robot.model, data, a)
            for a, b in zip(middle, v)
        ]
    )
    if problem.wrench is not None:
        force = force + np.array([wrench_torque(robot, a, problem.wrench) for a in middle])
    push = h / 2 * (force + torque)
    return push - p, push + p


def wrench_torque(robot: Robot, q: Array, wrench: Array) -> Array:
    """Jᵀw (n,) [N·m] of a force and moment (6,) on the tool tip, in world axes."""
    data = robot.model.createData()
    frame = robot.model.frames[robot.flange_id]
    pin.computeJointJacobians(robot.model, data, np.asarray(q))
    joint = frame.parentJoint
    jacobian = pin.getJointJacobian(robot.model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    lever = data.oMi[joint].rotation @ (frame.placement * robot.tool.tip).translation
    moment = wrench[3:] + np.cross(lever, wrench[:3])
    return np.asarray(jacobian).T @ np.concatenate([wrench[:3], moment])


def knot_velocities(robot: Robot, q: Array, left: Array, right: Array) -> Array:
    """q̇_k = M(q_k)⁻¹ p_k (N+1, n) [rad/s] by the discrete Legendre transforms."""
    p = np.vstack([-left, right[-1:]])
    p[1:-1] = (p[1:-1] + right[:-1]) / 2
    return np.array(np.linalg.solve(mass_matrices(robot, q), p[..., None])[..., 0], dtype=float)


def max_defect(problem: MotionProblem, q: Array, left: Array, right: Array, h: float) -> float:
    """Largest momentum residual as a fraction of h u_max, from q, u, h alone.

    With a free last velocity the last row only defines it and is left out.
    """
    robot = problem.robot
    ends = mass_matrices(robot, q[[0, -1]])
    rows = [ends[0] @ problem.start_velocity_rad_s + left[0], *(left[1:] + right[:-1])]
    if not problem.limits.free_goal_velocity:
        rows.append(right[-1] - ends[1] @ problem.goal_velocity_rad_s)
    return float(np.max(np.abs(rows) / (h * robot.torque_limit_nm)))
