"""The UR3 paper's particle swarm over Bézier control points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.swarm import Swarm, SwarmParams
from studies.ur3.bezier_problem import BezierProblem, BezierResult, Evaluator, metric_values

#: Table 1 of the paper.
PAPER_SWARM = SwarmParams(
    particles=30, iterations=250, inertia=0.810, cognitive=0.495, social=0.724
)
#: The paper's velocity boundaries [rad per iteration] of Δ_1, Δ_5 and of Δ_2, Δ_3, Δ_4.
END_STEP_RAD, FREE_STEP_RAD = 0.1, 0.2

#: How far from the straight line a swarm starts.
SPREAD_RAD = 1.0

#: Particles that break a limit or touch something cost this much and more, as the paper advises.
PENALTY = 1e6

#: Which of sampled curves q (P, K, n) touch something: (P,).
Forbidden = Callable[[Array], npt.NDArray[np.bool_]]


def swarm_bezier(
    problem: BezierProblem,
    seed: int,
    params: SwarmParams = PAPER_SWARM,
    forbidden: Forbidden | None = None,
) -> BezierResult:
    """Minimise the problem's metric over its five inner control points with a particle swarm.

    The swarm starts around the straight line: free points uniform within `SPREAD_RAD` of it, their
    neighbours within the problem's `end_range_rad`; one particle is the straight line itself.
    Joints that need not move stand still in every other particle: friction makes the slightest
    move of them cost, and a swarm of random particles would never come back to rest exactly.
    Steps are at most 0.1 rad and 0.2 rad (Table 1). Curves that exceed a limit, or of which
    `forbidden` says that they touch something, are penalised. `forbidden` is asked only about
    curves that would otherwise improve on their particle's best: others change nothing.
    """
    evaluator = Evaluator(problem)
    lower, upper = problem.bounds
    n = problem.robot.num_joints
    rng = np.random.default_rng([seed, 1])
    reach = np.repeat([problem.end_range_rad, *[SPREAD_RAD] * 3, problem.end_range_rad], n)
    offsets = reach * (2.0 * rng.random((params.particles, 5 * n)) - 1.0)
    offsets[0] = 0.0
    still = np.zeros(offsets.shape, dtype=bool)
    still[::2] = np.tile(problem.idle_joints, 5)
    offsets[still] = 0.0
    start = np.clip(problem.straight + offsets, lower, upper)
    step = np.repeat([END_STEP_RAD, *[FREE_STEP_RAD] * 3, END_STEP_RAD], n)
    own = np.random.default_rng(seed)
    own.random((2, *start.shape))  # seeds keep the results of when a swarm drew these two itself
    velocity = step * (2.0 * own.random(start.shape) - 1.0)
    velocity[still] = 0.0
    swarm = Swarm(lower, upper, own, replace(params, wall="absorbing"), start, velocity, step)
    history = np.empty(params.iterations)
    for k in range(params.iterations):
        points = swarm.ask()
        cost, excess = evaluator.evaluate(points)
        values = np.where(excess > 0, PENALTY * (1.0 + excess), cost)
        if forbidden is not None:
            asked = np.flatnonzero(swarm.promising(values) & (excess <= 0))
            if asked.size:
                hit = asked[forbidden(evaluator.curves(points[asked]))]
                values[hit] = PENALTY
        swarm.tell(values)
        history[k] = swarm.best_value if swarm.best_value < PENALTY else np.inf
    motion = problem.motion(swarm.best_x)
    limits = motion.limit_use(problem.robot)
    legal = bool(swarm.best_value < PENALTY)
    return BezierResult(
        motion=motion,
        value=metric_values(motion, problem.robot, (problem.metric,))[problem.metric],
        feasible=legal and max(limits.values()) <= 1.0,
        limits=limits,
        evaluations=swarm.evaluations,
        gradients=0,
        history=history,
        note="" if legal else "no particle found a legal motion",
    )
