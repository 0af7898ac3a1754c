r"""Knots on the departure lines: how a motion leaves one weld and reaches the next.

The first m interior knots lie on the line of the weld that is left, at the fractions (k/m)² of
its length for k = 1..m, as a constant acceleration along the line would have them; the last m
likewise on the line of the weld that is reached. The grid may be refined without changing the
motion that is asked for: doubling N doubles m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.programme.guess import straight_guess
from dmoc.programme.types import Guess, NlpSolution
from dmoc.solving.grids import prolonged
from dmoc.solving.nlp import solve_nlp
from dmoc.solving.solvers import DEFAULT_SOLVER, SolveParams

LineFunction = Callable[[float], Array]
"""Joint vector (n,) at a fraction of the departure line: 0 at the weld, 1 at the line's end."""

INTERVALS_PER_LINE_KNOT = 20
# Line knots per twenty intervals: two are right more often than any other number.
FIRST_TRIED = 2
MOST_OF_TWENTY = 4
# Enough to tell which of two optima is cheaper.
RANKING = SolveParams(tolerance=1e-4, limit_curve=False)


def num_line_knots(num_intervals: int) -> int:
    """m for a grid of N intervals: one knot for every twenty intervals, at least one."""
    return max(1, round(num_intervals / INTERVALS_PER_LINE_KNOT))


def departure_fractions(num_knots: int) -> Array:
    """(k/m)² for k = 1..m."""
    return (np.arange(1, num_knots + 1) / num_knots) ** 2


def line_through(samples_rad: Array) -> LineFunction:
    """The line function of joint vectors (K, n) at equal distances along the line."""
    samples = np.asarray(samples_rad, dtype=float)
    places = np.linspace(0.0, 1.0, len(samples))

    def at(fraction: float) -> Array:
        return np.array([np.interp(fraction, places, column) for column in samples.T])

    return at


def with_departure(
    problem: MotionProblem,
    depart: LineFunction | None,
    arrive: LineFunction | None,
    num_intervals: int | None = None,
    num_knots: int | None = None,
) -> MotionProblem:
    """`problem` on N intervals with its given knots on the two lines.

    `depart` and `arrive` give the joint vector at a fraction of the line of the weld that is left
    and of the weld that is reached; None means that end has no line.
    """
    num = problem.num_intervals if num_intervals is None else num_intervals
    fractions = departure_fractions(num_line_knots(num) if num_knots is None else num_knots)
    return problem.replace(
        num_intervals=num,
        depart_rad=None if depart is None else np.array([depart(f) for f in fractions]),
        arrive_rad=None if arrive is None else np.array([arrive(f) for f in fractions[::-1]]),
    )


@dataclass(frozen=True)
class DepartureProblem:
    """A problem with its knots on the departure lines, and where its solve may start.

    `guess` is the obstacle-free optimum that the choice of the knots found, on the grid of
    `problem`; None where nothing was chosen or nothing was solved.
    """

    problem: MotionProblem
    guess: Guess | None


def best_departure(
    problem: MotionProblem,
    depart: LineFunction | None,
    arrive: LineFunction | None,
    num_intervals: int | None = None,
    solver: str = DEFAULT_SOLVER,
) -> DepartureProblem:
    """`with_departure` with the number of line knots per twenty intervals that costs least.

    With m of twenty a line takes m twentieths of the motion: one suits long motions, three or four
    those between neighbouring welds, where the lines are most of the way. The obstacle-free optima
    on twenty intervals decide, so that the choice does not depend on the grid; they are searched
    from m = 2 in the direction in which they get cheaper, up to m = 4.
    """
    num = problem.num_intervals if num_intervals is None else num_intervals
    if depart is None and arrive is None:
        return DepartureProblem(problem.replace(num_intervals=num), None)
    ranking = replace(RANKING, solver=solver)
    trials: dict[int, MotionProblem] = {}
    found: dict[int, NlpSolution] = {}

    def cost(knots: int, beside: int = 0) -> float:
        if knots not in found:
            trial = with_departure(problem, depart, arrive, INTERVALS_PER_LINE_KNOT, knots)
            known = found.get(beside)
            if known is not None and known.status.ok:  # a quarter fewer iterations than from afar
                start = Guess(known.q_rad, known.torque_nm, known.step_s, known.multipliers)
            else:
                start = straight_guess(trial)
            trials[knots], found[knots] = trial, solve_nlp(trial, start, params=ranking)
        solution = found[knots]
        return solution.cost if solution.status.ok else np.inf

    best = FIRST_TRIED
    step = 1 if cost(best) > cost(best + 1, best) else -1
    while 1 <= best + step <= MOST_OF_TWENTY and cost(best + step, best) < cost(best):
        best += step
    chosen = with_departure(problem, depart, arrive, num, best * num_line_knots(num))
    solution = found[best]
    guess = prolonged(chosen, trials[best], solution) if solution.status.ok else None
    return DepartureProblem(chosen, guess)
