"""`solve`: one motion between two joint vectors, nothing in the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from dmoc.motion.cost import ElectricalCost
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.running_cost import executed_cost
from dmoc.programme.builder import Families
from dmoc.programme.guess import detour_guess, straight_guess
from dmoc.programme.types import Guess, NlpSolution
from dmoc.solving.grids import prolonged
from dmoc.solving.nlp import ONE_AT_A_TIME, solve_nlp
from dmoc.solving.solvers import DEFAULT_PARAMS, SolveParams

# Problems travel in groups, so that a robot is sent once for many of them.
GROUP = 8


def solve_many(
    problems: Sequence[MotionProblem],
    executor: Executor | None = None,
    params: SolveParams = DEFAULT_PARAMS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> list[Motion]:
    """`solve(problem, params, seed=seed)` for every problem, in their order.

    Every motion depends on its own problem only: nothing is handed from one to the next, so the
    result is the same for any executor of `concurrent.futures`, any number of workers and any
    order of completion. `progress(done, total)` is called as groups arrive, in order.
    """
    total, motions = len(problems), list[Motion]()
    groups = [list(problems[i : i + GROUP]) for i in range(0, total, GROUP)]
    arguments = (groups, [params] * len(groups), [seed] * len(groups))
    arriving = (
        map(_solve_group, *arguments)
        if executor is None
        else executor.map(_solve_group, *arguments)
    )
    for group, solved in zip(groups, arriving):
        motions += [_with_robot(problem, motion) for problem, motion in zip(group, solved)]
        if progress is not None:
            progress(len(motions), total)
    return motions


def _solve_group(problems: list[MotionProblem], params: SolveParams, seed: int) -> list[Motion]:
    return [_without_robot(solve(problem, params, seed=seed)) for problem in problems]


def _without_robot(motion: Motion) -> Motion:
    """Robots stay at home: the caller has them."""
    t = motion.trajectory
    if t is None:
        return motion
    return motion.replace(trajectory=t.on(None))


def _with_robot(problem: MotionProblem, motion: Motion) -> Motion:
    t = motion.trajectory
    if t is None:
        return motion
    return motion.replace(trajectory=t.on(problem.robot))


COARSE_INTERVALS = 10
# The coarse grid only starts the fine one, so its last digits are not wanted.
COARSE_TOLERANCE = 1e-3
# More iterations than this in all count as a struggle worth another guess.
SUSPICIOUS_ITERATIONS = 100
SUSPICIOUS_ITERATIONS_ELECTRICAL = 300
OTHER_GUESSES = 3
ALL_LIMITS = Families(velocity=True, acceleration=True)
# Friction this soft [rad/s] has few local optima; an electrical cost is first solved with it.
SOFT_FRICTION_RAD_S = 0.3


def solve(
    problem: MotionProblem,
    params: SolveParams = DEFAULT_PARAMS,
    guess: Guess | None = None,
    seed: int = 0,
) -> Motion:
    """The locally optimal motion of `problem` without obstacles.

    Without a guess: the straight joint-space line, on ten intervals first where N ≥ 20 and no speed
    is priced. If that
    fails or looks suspicious (many iterations), up to three detours drawn from `seed` are tried
    and the cheapest motion is kept. Deterministic.

    Expected failure is a status of the motion (`motion.require()` raises it); bad input raised
    `ProblemError` when the problem was built.
    """
    with ONE_AT_A_TIME:
        if guess is not None:
            solution = solve_nlp(problem, guess, params=params)
        else:
            solution = _best_of_guesses(problem, params, seed)
        return motion_from_solution(problem, solution)


def _best_of_guesses(problem: MotionProblem, params: SolveParams, seed: int) -> NlpSolution:
    electrical = isinstance(problem.cost, ElectricalCost)
    most = SUSPICIOUS_ITERATIONS_ELECTRICAL if electrical else SUSPICIOUS_ITERATIONS
    best: NlpSolution | None = None
    used = 0
    for start in _guesses(problem, seed):
        solution = _through_grids(problem, params, start)
        used += solution.iterations
        if best is None or _rank(solution) < _rank(best):
            best = solution
        if best.status is Status.CONVERGED and solution.iterations <= most:
            break
    assert best is not None
    return replace(best, iterations=used)


def motion_from_solution(problem: MotionProblem, solution: NlpSolution) -> Motion:
    """A `Motion` from what the programme's solver returned."""
    trajectory = JointTrajectory(
        t_s=solution.step_s * np.arange(problem.num_intervals + 1.0),
        q_rad=solution.q_rad,
        velocity_rad_s=solution.velocity_rad_s,
        torque_nm=solution.torque_nm,
        robot=problem.robot,
    )
    motion = Motion(
        status=solution.status,
        source="refined",
        trajectory=trajectory,
        cost=solution.cost,
        smoothing_cost=solution.smoothing_cost,
        iterations=solution.iterations,
        max_defect=solution.max_defect,
        solver=solution.solver,
        planner="none",
        method="free",
    )
    return motion.judged(executed_cost(problem, trajectory)) if solution.status.ok else motion


def _guesses(problem: MotionProblem, seed: int) -> Iterator[Guess]:
    yield straight_guess(problem)
    rng = np.random.default_rng(seed)
    for _ in range(OTHER_GUESSES):
        yield detour_guess(problem, rng)


def _rank(solution: NlpSolution) -> tuple[bool, float]:
    """Usable before unusable, then cheap before dear."""
    return (not solution.status.ok, solution.cost + solution.smoothing_cost)


def _through_grids(problem: MotionProblem, params: SolveParams, start: Guess) -> NlpSolution:
    cost = problem.cost
    if isinstance(cost, ElectricalCost):
        return _through_friction(problem, cost, params, start)
    ends = problem.depart_rad is not None or problem.arrive_rad is not None
    # With a price that sees the speeds at the knots ten iterations do from any start.
    if problem.num_intervals < 2 * COARSE_INTERVALS or ends or cost.kappa > 0:
        return solve_nlp(problem, start, params=params)
    coarse = problem.replace(num_intervals=COARSE_INTERVALS)
    rough = replace(params, tolerance=max(COARSE_TOLERANCE, params.tolerance), limit_curve=False)
    first = solve_nlp(coarse, _thinned(start), params=rough)
    if not first.status.ok:
        solution = solve_nlp(problem, start, params=params)
    else:
        solution = solve_nlp(problem, prolonged(problem, coarse, first), params=params)
        if not solution.status.ok:
            first = replace(first, iterations=first.iterations + solution.iterations)
            solution = solve_nlp(problem, start, params=params)
    return replace(solution, iterations=first.iterations + solution.iterations)


def _through_friction(
    problem: MotionProblem, cost: ElectricalCost, params: SolveParams, start: Guess
) -> NlpSolution:
    """With soft friction first, and with the limits from the start.

    Braking gives energy back: without limits, on a coarse grid above all, optima of an electrical
    cost are wild motions that live on errors of the discretisation. So no grid comes before.
    """
    if cost.friction_smoothing_rad_s >= SOFT_FRICTION_RAD_S:
        return solve_nlp(problem, start, params=params, families=ALL_LIMITS)
    soft = problem.replace(cost=replace(cost, friction_smoothing_rad_s=SOFT_FRICTION_RAD_S))
    rough = replace(params, tolerance=max(COARSE_TOLERANCE, params.tolerance), curve_corrections=0)
    first = solve_nlp(soft, start, params=rough, families=ALL_LIMITS)
    if first.status.ok:
        start = Guess(first.q_rad, first.torque_nm, first.step_s, first.multipliers)
    solution = solve_nlp(problem, start, params=params, families=ALL_LIMITS)
    return replace(solution, iterations=first.iterations + solution.iterations)


def _thinned(guess: Guess) -> Guess:
    """The guess on the coarse grid."""
    many = len(guess.torque_nm)
    at = np.linspace(0, 1, many + 1)
    to = np.linspace(0, 1, COARSE_INTERVALS + 1)
    middle, to_middle = (at[1:] + at[:-1]) / 2, (to[1:] + to[:-1]) / 2
    q = np.stack([np.interp(to, at, column) for column in guess.q_rad.T], axis=1)
    u = np.stack([np.interp(to_middle, middle, c) for c in guess.torque_nm.T], axis=1)
    return Guess(q, u, guess.step_s * many / COARSE_INTERVALS)
