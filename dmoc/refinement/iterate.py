"""One iterate of the refinement: knots, their interpolant at checked points, first guesses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.curves.time_scaling import time_scale
from dmoc.motion.motion import MotionProblem, straight_path
from dmoc.motion.trajectory import JointPath, JointTrajectory
from dmoc.physics.state import knot_velocities, residuals
from dmoc.programme.types import Guess, NlpSolution

# A time-optimal seed with a nearly full stop can be hundreds of times too slow.
LONGEST_SEED_RATIO = 3.0


@dataclass(frozen=True)
class Points:
    """Checked points: interval i (P,) and fraction λ (P,) within it."""

    interval: npt.NDArray[np.int64]
    fraction: Array

    def with_extra(self, interval: npt.ArrayLike, fraction: npt.ArrayLike) -> Points:
        """These points and some more."""
        return Points(
            np.concatenate([self.interval, np.asarray(interval, dtype=np.int64)]),
            np.concatenate([self.fraction, np.asarray(fraction, dtype=float)]),
        )


@dataclass(frozen=True)
class Iterate:
    """Knots (N+1, n), torques (N, n), step [s], knot velocities (N+1, n) and J."""

    q_rad: Array
    torque_nm: Array
    velocity_rad_s: Array
    step_s: float
    cost: float = float("inf")
    multipliers: Any = None

    @classmethod
    def of(cls, solution: NlpSolution) -> Iterate:
        """What a solve ended at."""
        return cls(
            solution.q_rad,
            solution.torque_nm,
            solution.velocity_rad_s,
            solution.step_s,
            solution.cost,
            solution.multipliers,
        )

    def guess(self) -> Guess:
        """Where the next solve starts."""
        return Guess(self.q_rad, self.torque_nm, self.step_s, self.multipliers)

    def chord(self, points: Points) -> Array:
        """(1−λ) q_i + λ q_{i+1} (P, n)."""
        share = points.fraction[:, None]
        return (1 - share) * self.q_rad[points.interval] + share * self.q_rad[points.interval + 1]

    def curve(self, points: Points) -> Array:
        """The cubic interpolant at the points (P, n): what is certified and executed."""
        i, s = points.interval, points.fraction[:, None]
        bend0 = s * (1 - s) ** 2 * self.step_s * self.velocity_rad_s[i]
        bend1 = s * s * (s - 1) * self.step_s * self.velocity_rad_s[i + 1]
        share = s * s * (3 - 2 * s)
        return (1 - share) * self.q_rad[i] + share * self.q_rad[i + 1] + bend0 + bend1

    def trajectory(self, problem: MotionProblem) -> JointTrajectory:
        """This iterate as the interpolant that everything downstream uses."""
        t = self.step_s * np.arange(len(self.q_rad), dtype=np.float64)
        return JointTrajectory(t, self.q_rad, self.velocity_rad_s, self.torque_nm, problem.robot)


def iterate_from_guess(problem: MotionProblem, guess: Guess) -> Iterate:
    """A first iterate with the knots, torques, step and multipliers of `guess`."""
    left, right = residuals(problem, guess.q_rad, guess.torque_nm, guess.step_s)
    velocity = knot_velocities(problem.robot, guess.q_rad, left, right)
    return Iterate(
        guess.q_rad, guess.torque_nm, velocity, guess.step_s, multipliers=guess.multipliers
    )


def fixed_knots(problem: MotionProblem) -> npt.NDArray[np.bool_]:
    """Which of the N+1 knots are given: both ends and those on the departure lines."""
    fixed = np.zeros(problem.num_intervals + 1, dtype=bool)
    first, last = _num_given(problem)
    fixed[: first + 1] = True
    fixed[problem.num_intervals - last :] = True
    return fixed


def _num_given(problem: MotionProblem) -> tuple[int, int]:
    return (
        0 if problem.depart_rad is None else len(problem.depart_rad),
        0 if problem.arrive_rad is None else len(problem.arrive_rad),
    )


def iterate_from_path(problem: MotionProblem, path: JointPath | None) -> Iterate:
    """A first iterate: the time-scaled path (the straight one if None), uniformly in time.

    Only the quintic law is tried: from it the first solve takes as many iterations as from the
    time-optimal one, which costs more to compute.
    """
    timed = time_scale(straight_path(problem) if path is None else path, problem, laws=("quintic",))
    return iterate_from_trajectory(problem, timed.trajectory)


def iterate_from_trajectory(problem: MotionProblem, trajectory: JointTrajectory) -> Iterate:
    """Sample a trajectory at the problem's knots, with the given knots on the departure lines.

    The part between the lines is sampled uniformly in time. Torques start at gravity: the first
    solve is surest from there.
    """
    num, n = problem.num_intervals, problem.robot.num_joints
    first, last = _num_given(problem)
    begin = _time_near(trajectory, problem.depart_rad, -1, first_half=True)
    end = _time_near(trajectory, problem.arrive_rad, 0, first_half=False)
    if not begin < end:
        begin, end = trajectory.t_s[0], trajectory.t_s[-1]
    times = np.linspace(begin, end, num - first - last + 1)
    step = times[1] - times[0]
    if problem.duration_s is not None:
        step_s = problem.duration_s / num
    else:
        step_s = min(step, LONGEST_SEED_RATIO * _brisk_step(problem, trajectory))
    q, velocity = np.zeros((num + 1, n)), np.zeros((num + 1, n))
    sample = trajectory.sample(times)
    q[first : num - last + 1] = sample.q_rad
    velocity[first : num - last + 1] = sample.velocity_rad_s * (step / step_s)
    q[0], q[num] = problem.start_rad, problem.goal_rad
    velocity[0], velocity[num] = problem.start_velocity_rad_s, problem.goal_velocity_rad_s
    if problem.depart_rad is not None:
        q[1 : first + 1] = problem.depart_rad
        velocity[1 : first + 1] = (q[2 : first + 2] - q[:first]) / (2 * step_s)
    if problem.arrive_rad is not None:
        q[num - last : num] = problem.arrive_rad
        velocity[num - last : num] = (q[num - last + 1 :] - q[num - last - 1 : num - 1]) / (
            2 * step_s
        )
    lower, upper = problem.robot.q_lower_rad, problem.robot.q_upper_rad
    q = np.clip(q, lower, upper)
    torque = np.clip(
        problem.robot.gravity_torque_nm(0.5 * (q[:-1] + q[1:])),
        -problem.robot.torque_limit_nm,
        problem.robot.torque_limit_nm,
    )
    return Iterate(q, torque, velocity, float(step_s))


def _time_near(
    trajectory: JointTrajectory, given: Array | None, index: int, *, first_half: bool
) -> float:
    """When the trajectory passes the inner end of a departure line, or its own end."""
    if given is None or len(given) == 0:
        return float(trajectory.t_s[0] if first_half else trajectory.t_s[-1])
    half = len(trajectory.t_s) // 2
    part = slice(0, half + 1) if first_half else slice(half, None)
    gap = np.max(np.abs(trajectory.q_rad[part] - given[index]), axis=1)
    return float(trajectory.t_s[part][int(gap.argmin())])


def _brisk_step(problem: MotionProblem, trajectory: JointTrajectory) -> float:
    """A step at which every joint covers its travel at a tenth of its speed limit."""
    travel = np.sum(np.abs(np.diff(trajectory.q_rad, axis=0)), axis=0)
    slowest = np.max(travel / (0.1 * problem.robot.velocity_limit_rad_s))
    return float(max(slowest, 0.5) / problem.num_intervals)
