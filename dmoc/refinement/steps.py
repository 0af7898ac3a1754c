"""One outer iteration: linearise, solve, check exactly, shrink where it fails, solve again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.clearance import Clearance
from dmoc.motion.motion import MotionProblem
from dmoc.programme.types import Box, NlpSolution, PathRows
from dmoc.refinement.boxes import box_half_widths, kept_level
from dmoc.refinement.halfspaces import half_spaces
from dmoc.refinement.iterate import Iterate, Points, fixed_knots
from dmoc.refinement.params import Method, RefineParams, RefineRecord, Trace
from dmoc.refinement.points import View, knots_of, look, required_clearance
from dmoc.solving.nlp import solve_nlp
from dmoc.solving.solvers import SolveParams

# An iterate that violates may come back this much nearer without being called worse.
_SAME_M = 1e-4
_SMALLEST_TRUST_RAD = 1e-4
# On the way out of a violation the sum of depths must fall to this share.
_FREER_SHARE = 0.9
# After so many failed programmes an outer iteration gives up.
_MOST_FAILURES = 2


@dataclass(frozen=True)
class RefineRound:
    """What stays the same over the outer iterations between two repairs.

    `base` are the points that are always checked, `margin_m` (N,) what a repair demands more in
    each interval; `points` (P,) and `required_m` (P,) are the base and what is watched besides.
    """

    problem: MotionProblem
    clearance: Clearance
    method: Method
    params: RefineParams
    base: Points
    margin_m: Array
    points: Points
    required_m: Array
    repair: int = 0
    trace: Trace | None = None


def demanded(stage: RefineRound, points: Points) -> Array:
    """What `stage` demands at any points (P,) [m]. Boxes know no spare: they are as published."""
    spare = stage.params.spare_m if stage.method == "halfspaces" else 0.0
    required = required_clearance(
        stage.clearance, stage.problem, points, stage.params.clearance_m, spare
    )
    return np.asarray(required + stage.margin_m[points.interval])


@dataclass(frozen=True)
class Step:
    """What one outer iteration gave: the new iterate and its view, or the old ones."""

    iterate: Iterate
    view: View
    trust_rad: Array
    accepted: bool
    solver_iterations: int
    solution: NlpSolution


def take_step(
    stage: RefineRound,
    iterate: Iterate,
    view: View,
    trust_rad: Array,
    outer: int,
    solver: SolveParams,
) -> Step:
    """Solve inside the trust region around `iterate` until a candidate passes the exact check.

    `trust_rad` (N+1,) scales the half-spaces' trust region [rad] or, for boxes, multiplies their
    half-widths. A candidate passes when every checked point is above what its method demands, or,
    where the present iterate is already below, not nearer than now.
    """
    problem, params = stage.problem, stage.params
    fixed = fixed_knots(problem)
    half = _half_widths(stage, view, fixed, trust_rad)
    rows = _rows(stage, view, half, params.push_out_m, params.rows_per_point)
    guess, used, failed = iterate.guess(), 0, 0
    scale, stuck_at = np.ones(len(fixed)), np.inf
    for backtrack in range(params.max_backtracks + 1):
        box = _box(problem, iterate, half * scale[:, None])
        solution = solve_nlp(problem, guess, box=box, rows=rows, params=solver)
        used += solution.iterations
        candidate = Iterate.of(solution)
        usable = solution.status.ok and np.all(np.isfinite(candidate.q_rad))
        if usable:
            seen = look(stage.clearance, candidate, stage.points, params.cap_m)
            bad = seen.phi_m < _threshold(stage, iterate, view)
            accepted = not bad.any() or _is_freer(stage, view, seen)
            least = float(seen.phi_m.min(initial=params.cap_m))
        else:
            accepted, least = False, float("nan")
        if stage.trace is not None:
            stage.trace(
                RefineRecord(
                    outer,
                    accepted,
                    solution.cost,
                    solution.step_s,
                    candidate.q_rad,
                    candidate.velocity_rad_s,
                    box.q_lower_rad,
                    box.q_upper_rad,
                    0 if rows is None else len(rows.lower),
                    least,
                    backtrack,
                    stage.repair,
                    solution.iterations,
                )
            )
        if accepted:
            trust = trust_rad * scale
            return Step(candidate, seen, _grown(stage, trust), True, used, solution)
        guess = replace(guess, multipliers=None)
        if usable:
            if abs(least - stuck_at) < _SAME_M:
                break
            stuck_at = least
            scale = _shrunk(stage, candidate, iterate, half, scale, bad)
            if backtrack == 0:
                # A pair that had no row may have been hit.
                rows = _rows(stage, view, half, params.push_out_m, 3 * params.rows_per_point)
        else:
            failed += 1
            if failed == _MOST_FAILURES:
                break
            # Contradicting rows, most likely: smaller steps, and only forbid getting nearer.
            scale = scale * params.shrink
            rows = _rows(stage, view, half * scale[:, None], 0.0, params.rows_per_point)
        if np.max(half * scale[:, None]) < _SMALLEST_TRUST_RAD:
            break
    return Step(iterate, view, trust_rad * scale, False, used, solution)


def _half_widths(
    stage: RefineRound, view: View, fixed: npt.NDArray[np.bool_], trust_rad: Array
) -> Array:
    if stage.method == "boxes":
        half = box_half_widths(
            stage.clearance, view, stage.points, stage.required_m, fixed, stage.params
        )
        return half * trust_rad[:, None]
    half = np.repeat(trust_rad[:, None], stage.problem.robot.num_joints, axis=1)
    half[fixed] = 0.0
    return half


def _rows(
    stage: RefineRound, view: View, half: Array, push_out_m: float, rows_per_point: int
) -> PathRows | None:
    if stage.method == "boxes":
        return None
    return half_spaces(view, stage.points, stage.required_m, half, push_out_m, rows_per_point)


def _box(problem: MotionProblem, iterate: Iterate, half: Array) -> Box:
    robot = problem.robot
    return Box(
        np.clip(iterate.q_rad - half, robot.q_lower_rad, robot.q_upper_rad),
        np.clip(iterate.q_rad + half, robot.q_lower_rad, robot.q_upper_rad),
    )


def _threshold(stage: RefineRound, iterate: Iterate, view: View) -> Array:
    """What a candidate must keep at every point (P,)."""
    floor = np.minimum(stage.params.floor_m, stage.required_m)
    if stage.method == "halfspaces":
        return np.minimum(floor, view.phi_m - _SAME_M)
    kept = kept_level(stage.required_m, stage.params)
    at_knot = stage.points.fraction == 0
    if np.isfinite(iterate.cost):
        # What was too near from the start may come nearer by a hair a step, but not to the floor.
        hair = np.maximum(view.phi_m - _SAME_M, np.minimum(view.phi_m, 2 * stage.params.floor_m))
        near, between = np.minimum(kept, hair), 0.8 * stage.required_m
    else:
        # A seed is no solution: its curve between the knots changes with the first solve.
        near, between = np.minimum(floor, view.phi_m - _SAME_M), floor
    free = np.where(at_knot, stage.required_m - 1e-7, between)
    return np.where(view.phi_m >= stage.required_m, free, near)


def _is_freer(stage: RefineRound, before: View, after: View) -> bool:
    """Whether half-spaces on the way out of a violation got nearer to the floor as a whole.

    Point by point would be too strict: while a deep point comes out, a shallow one may sink.
    """
    if stage.method != "halfspaces":
        return False
    floor = np.minimum(stage.params.floor_m, stage.required_m)
    old = np.maximum(floor - before.phi_m, 0.0)
    new = np.maximum(floor - after.phi_m, 0.0)
    if old.max(initial=0.0) <= 0.0:
        return False
    return bool(new.max() <= old.max() and new.sum() <= _FREER_SHARE * old.sum())


def _shrunk(
    stage: RefineRound,
    candidate: Iterate,
    iterate: Iterate,
    half: Array,
    scale: Array,
    bad: npt.NDArray[np.bool_],
) -> Array:
    """The scale of every knot's box after a violation at the points `bad`."""
    params = stage.params
    hit = knots_of(stage.points, bad, len(scale))
    beside = (np.roll(hit, 1) | np.roll(hit, -1)) & ~hit
    if stage.method == "boxes":
        return np.where(hit, params.shrink * scale, np.where(beside, 0.6 * scale, scale))
    step = np.max(np.abs(candidate.q_rad - iterate.q_rad), axis=1)
    width = np.maximum(half.max(axis=1), 1e-12)
    taken = np.minimum(step / width, scale)
    out = np.where(hit, params.shrink * taken, scale)
    return np.where(beside, params.shrink_beside * taken, out)


def _grown(stage: RefineRound, trust: Array) -> Array:
    params = stage.params
    if stage.method == "boxes":
        # The next boxes follow from the new distances; a backtracked knot recovers step by step.
        return np.minimum(trust * params.trust_growth, 1.0)
    return np.minimum(trust * params.trust_growth, params.trust_most_rad)
