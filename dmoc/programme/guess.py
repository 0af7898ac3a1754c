"""Where a solve starts: knots, torques and step."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from dmoc.arrays import Array
from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem, straight_path
from dmoc.motion.trajectory import JointPath, JointTrajectory
from dmoc.physics.dynamics import ArmModel, inverse_dynamics
from dmoc.programme.builder import arm_of
from dmoc.programme.types import Guess
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import Robot

# A guess keeps this share of the torque limits, so that the interior-point method starts inside.
TORQUE_SHARE = 0.9
LONGEST_GUESS_S = 30.0


def straight_guess(problem: MotionProblem) -> Guess:
    """A quintic time law on the straight joint-space path, at its cheapest duration."""
    return guess_from_path(problem, straight_path(problem))


def detour_guess(problem: MotionProblem, rng: np.random.Generator) -> Guess:
    """The straight line bent to a point drawn near its middle: another start for a local search."""
    line = straight_path(problem).q_rad
    middle = len(line) // 2
    robot = problem.robot
    spread = 0.3 * np.maximum(np.linalg.norm(line[-1] - line[0]), 0.5)
    bend = (line[middle - 1] + line[middle]) / 2 + rng.normal(0.0, spread, robot.num_joints)
    bend = np.clip(bend, robot.q_lower_rad, robot.q_upper_rad)
    return guess_from_path(problem, JointPath(np.insert(line, middle, bend, axis=0)))


def guess_from_path(problem: MotionProblem, path: JointPath) -> Guess:
    """A quintic time law s(t) on `path`, at the duration that costs least along it.

    On a fixed path u(s) = g + w(s)/T², so J(T) = αT + β/T + γ/T³, whose minimum is
    T² = (β + √(β² + 12αγ))/(2α); speed and torque limits bound T from below.
    """
    n = problem.num_intervals
    knots = _quintic(path.q_rad, n)
    for fixed, first in ((problem.depart_rad, True), (problem.arrive_rad, False)):
        if fixed is not None:
            knots[slice(1, len(fixed) + 1) if first else slice(-1 - len(fixed), -1)] = fixed
    return _timed(problem, knots)


def guess_from_trajectory(problem: MotionProblem, trajectory: JointTrajectory) -> Guess:
    """The trajectory sampled uniformly in time; torques by inverse dynamics of its knots."""
    t = np.linspace(trajectory.t_s[0], trajectory.t_s[-1], problem.num_intervals + 1)
    q = np.array(trajectory.sample(t).q_rad)
    q[0], q[-1] = problem.start_rad, problem.goal_rad
    for fixed, first in ((problem.depart_rad, True), (problem.arrive_rad, False)):
        if fixed is not None:
            q[slice(1, len(fixed) + 1) if first else slice(-1 - len(fixed), -1)] = fixed
    duration = problem.duration_s or trajectory.duration_s
    step = duration / problem.num_intervals
    return Guess(q, _torques(problem.robot, q, step), step)


def _quintic(points: Array, num_intervals: int) -> Array:
    """(N+1, n) knots on the polyline `points` with a rest-to-rest quintic in its arc length."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    keep = np.concatenate([[True], np.diff(length) > 0])
    s = np.linspace(0.0, 1.0, num_intervals + 1)
    s = s**3 * (10 - 15 * s + 6 * s**2) * length[-1]
    columns = [np.interp(s, length[keep], column) for column in points[keep].T]
    return np.stack(columns, axis=1)


def _timed(problem: MotionProblem, knots: Array) -> Guess:
    n, robot = problem.num_intervals, problem.robot
    middle, v, a = _unit_time_motion(knots)
    dynamics = _mapped_inverse_dynamics(arm_of(robot), n)
    still = np.array(dynamics(middle.T, np.zeros_like(v.T), np.zeros_like(a.T))).T
    moving = np.array(dynamics(middle.T, v.T, a.T)).T - still
    price = _effort_price(problem)
    rate, speed = problem.cost.time, problem.cost.velocity
    alpha = rate + np.mean(still**2 @ price)
    beta = speed * np.mean(np.sum(v * v, axis=1)) + 2 * np.mean((still * moving) @ price)
    gamma = np.mean(moving**2 @ price)
    duration = LONGEST_GUESS_S
    if alpha > 0:
        root = np.sqrt(max(beta * beta + 12 * alpha * gamma, 0.0))
        duration = float(np.sqrt(max((beta + root) / (2 * alpha), 0.0)))
    duration = min(max(duration, _shortest(robot, v, still, moving)), LONGEST_GUESS_S)
    if problem.duration_s is not None:
        duration = problem.duration_s
    duration = max(duration, 1e-3 * n)
    torque = still + moving / duration**2
    limit = TORQUE_SHARE * robot.torque_limit_nm
    return Guess(knots, np.clip(torque, -limit, limit), duration / n)


def _unit_time_motion(knots: Array) -> tuple[Array, Array, Array]:
    """Midpoints, velocities and accelerations (N, n) of the knots run through in one second."""
    n = len(knots) - 1
    middle, v = (knots[1:] + knots[:-1]) / 2, np.diff(knots, axis=0) * n
    ends = np.concatenate([v[:1], v, v[-1:]])
    return middle, v, (ends[2:] - ends[:-2]) * n / 2


def _shortest(robot: Robot, v: Array, still: Array, moving: Array) -> float:
    """A duration [s] at which the guess respects speed and, where possible, torque limits."""
    by_speed = float(np.max(np.abs(v) / robot.velocity_limit_rad_s, initial=0.0))
    limit = TORQUE_SHARE * robot.torque_limit_nm
    room = np.where(moving > 0, limit - still, limit + still)
    needed = np.abs(moving) / np.maximum(room, 0.05 * limit)
    return max(by_speed, float(np.sqrt(np.max(needed, initial=0.0))))


def _effort_price(problem: MotionProblem) -> Array:
    """Price per N²m²s and joint: c_e, or the copper losses of an electrical cost."""
    cost, n = problem.cost, problem.robot.num_joints
    if isinstance(cost, Cost):
        price = np.full(n, cost.effort)
        return price if cost.torque_matrix is None else price + np.diag(cost.torque_matrix)
    drive = drive_from_mapping(problem.robot.drive, n)
    factor = (drive.gear_ratio * drive.torque_constant_nm_a) ** 2
    return cost.energy * (drive.copper_ohm + drive.inverter_ohm) / factor


def _torques(robot: Robot, knots: Array, step: float) -> Array:
    middle, v, a = _unit_time_motion(knots)
    duration = step * (len(knots) - 1)
    dynamics = _mapped_inverse_dynamics(arm_of(robot), len(middle))
    torque = np.array(dynamics(middle.T, v.T / duration, a.T / duration**2)).T
    limit = TORQUE_SHARE * robot.torque_limit_nm
    return np.clip(torque, -limit, limit)


@lru_cache(maxsize=64)
def _mapped_inverse_dynamics(arm: ArmModel, copies: int) -> ca.Function:
    return _inverse_dynamics(arm).map(copies)


@lru_cache(maxsize=64)
def _inverse_dynamics(arm: ArmModel) -> ca.Function:
    q, v, a = (ca.SX.sym(name, arm.num_joints) for name in ("q", "v", "a"))
    return ca.Function("inverse_dynamics", [q, v, a], [inverse_dynamics(arm, q, v, a)])
