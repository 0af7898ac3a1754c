"""`solve`: one motion between two joint vectors, nothing in the way."""

from __future__ import annotations

import numpy as np

from dmoc.guess import straight_guess
from dmoc.motion import Motion, MotionProblem
from dmoc.nlp import solve_nlp
from dmoc.nlp_types import DEFAULT_PARAMS, Guess, IpoptParams, NlpSolution
from dmoc.trajectory import JointTrajectory

__all__ = ["motion_from_solution", "solve"]


def solve(
    problem: MotionProblem,
    params: IpoptParams = DEFAULT_PARAMS,
    guess: Guess | None = None,
    seed: int = 0,
) -> Motion:
    """The locally optimal motion of `problem` without obstacles."""
    start = straight_guess(problem) if guess is None else guess
    return motion_from_solution(problem, solve_nlp(problem, start, params=params))


def motion_from_solution(problem: MotionProblem, solution: NlpSolution) -> Motion:
    """A `Motion` from what the programme's solver returned."""
    trajectory = JointTrajectory(
        t_s=solution.step_s * np.arange(problem.num_intervals + 1), q_rad=solution.q_rad,
        velocity_rad_s=solution.velocity_rad_s, torque_nm=solution.torque_nm,
        robot=problem.robot,
    )  # fmt: skip
    return Motion(
        status=solution.status, source="refined", trajectory=trajectory, cost=solution.cost,
        smoothing_cost=solution.smoothing_cost, iterations=solution.iterations,
        max_defect=solution.max_defect,
    )  # fmt: skip
