"""Many motions at once: same motions, byte for byte, whatever the number of workers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

from dmoc.motion import Motion, MotionProblem
from dmoc.nlp_types import DEFAULT_PARAMS, SolveParams
from dmoc.solver import solve

__all__ = ["solve_many"]

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
