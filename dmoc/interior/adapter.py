"""One programme, solved by the structured method if it fits."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.interior.frames import Frames, frames_of
from dmoc.interior.method import Bounds, Outcome, Start, Tolerances, minimise
from dmoc.interior.oracle import Oracle
from dmoc.interior.system import NewtonSystem
from dmoc.programme.builder import MotionProgramme

# More iterations than this are a struggle that a method with a restoration phase ends sooner.
MOST_ITERATIONS = 100
_CODES = {
    "converged": "Solve_Succeeded",
    "acceptable": "Solved_To_Acceptable_Level",
    "iterations": "Maximum_Iterations_Exceeded",
    "stuck": "Search_Direction_Becomes_Too_Small",
}
_ORACLES: dict[tuple[Any, ...], Oracle | None] = {}
_SYSTEMS: dict[tuple[Any, ...], NewtonSystem] = {}


def solve_structured(
    motion: MotionProgramme,
    arguments: dict[str, Array],
    tolerance: float,
    acceptable: float,
    acceptable_iterations: int,
    max_iterations: int,
) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """`arguments` and results as of `nlpsol`; None if the programme does not fit.

    The return status is one of Ipopt's; `Search_Direction_Becomes_Too_Small` means that another
    solver has to go on, for there is no restoration phase. Memory is kept per programme for the
    life of the process; a result does not depend on it. Not for several threads at once.
    """
    if motion.key not in _ORACLES:
        frames = frames_of(motion)
        _ORACLES[motion.key] = None if frames is None else Oracle(frames)
    oracle = _ORACLES[motion.key]
    if oracle is None:
        return None
    bounds = Bounds(*(arguments[name] for name in ("lbx", "ubx", "lbg", "ubg")))
    last_free = _last_free_knot(oracle.frames, bounds)
    if last_free is None:
        return None
    key = (motion.key, last_free)
    if key not in _SYSTEMS:
        _SYSTEMS[key] = NewtonSystem(oracle.frames, last_free)
    oracle.set_params(arguments["p"])
    start = Start(arguments["x0"], arguments.get("lam_x0"), arguments.get("lam_g0"))
    limits = Tolerances(
        tolerance, acceptable, acceptable_iterations, min(max_iterations, MOST_ITERATIONS)
    )
    outcome = minimise(oracle, _SYSTEMS[key], bounds, start, limits)
    return _as_nlpsol(outcome, max_iterations)


def _as_nlpsol(outcome: Outcome, max_iterations: int) -> tuple[dict[str, Any], dict[str, Any]]:
    reason = outcome.reason
    if reason == "iterations" and outcome.iterations < max_iterations:
        reason = "stuck"
    result = {
        "x": outcome.x,
        "f": outcome.objective,
        "lam_x": outcome.bounds,
        "lam_g": outcome.rows,
    }
    return result, {
        "return_status": _CODES[reason],
        "iter_count": outcome.iterations,
        "solver": "structured",
    }


def _last_free_knot(frames: Frames, bounds: Bounds) -> int | None:
    """K, or None if the pattern of free knots or the kind of rows does not fit."""
    equal = frames.num_momentum
    if np.any(bounds.rows_lower[equal:] == bounds.rows_upper[equal:]):
        return None
    knots = np.arange(frames.num_intervals + 1)[:, None] * 2 * frames.num_joints
    free = (bounds.lower != bounds.upper)[knots + np.arange(frames.num_joints)]
    some = np.flatnonzero(free.any(axis=1))
    if len(some) == 0 or some[0] == 0 or some[-1] == frames.num_intervals:
        return None
    return int(some[-1]) if free[some[-1]].all() else None
