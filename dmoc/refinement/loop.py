"""The refinement loop: outer iterations, a last tight solve, certificate, repair."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.motion.clearance import Certificate, Clearance
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointPath, JointTrajectory
from dmoc.physics.running_cost import executed_cost
from dmoc.programme.types import Guess, NlpSolution
from dmoc.refinement.fallback import fallback_motion
from dmoc.refinement.iterate import (
    Iterate,
    fixed_knots,
    iterate_from_guess,
    iterate_from_path,
    iterate_from_trajectory,
)
from dmoc.refinement.params import METHOD_NAMES, Method, RefineParams, Trace
from dmoc.refinement.points import View, look, points_of
from dmoc.refinement.steps import RefineRound, Step, demanded, take_step
from dmoc.refinement.watch import repaired_stage, restart, watching
from dmoc.solving.nlp import solve_nlp

_NO_RISE_M = 1e-3
_MOST_PUSHES = 8
# So often in a row a free iterate may get dearer for the sake of its clearance.
_MOST_CLIMBS = 6
# So much of the spare clearance may be used up before a motion counts as too near.
_SPENT = 0.5


def refine(
    problem: MotionProblem,
    path: JointPath | JointTrajectory | Guess | None,
    clearance: Clearance,
    *,
    method: Method = "halfspaces",
    params: RefineParams | None = None,
    trace: Trace | None = None,
    fallback: bool = True,
    worth: float = float("inf"),
) -> Motion:
    """Turn a path into a locally optimal motion that is proven free between its knots.

    `path` is collision-free (a `JointPath` is time-scaled first; a `JointTrajectory` keeps its
    timing; a `Guess` is on the problem's grid already); None starts from the straight line.
    `method` is `halfspaces` (linearised distances at points of every interval), `boxes` (the
    paper's section 2.4) or `none` (obstacles are ignored, only the certificate looks at them).
    `trace` is called after every solve.

    Returns a `Motion`: `certified` says what `clearance.certify` said of exactly this trajectory.
    Where the outer iterations end dearer than `worth` the last solve and the certificate are left
    out and the motion is not certified.
    Without a certificate the time-scaled `JointPath`, if that is certified, is returned as
    `source="fallback"` (unless `fallback` is false); else the status is `uncertified` and `note`
    names interval and pair.

    Errors: `ProblemError` for an unknown method.
    """
    if method not in ("halfspaces", "boxes", "none"):
        raise ProblemError.of(
            "method",
            field="method",
            value=repr(method),
            legal="halfspaces, boxes, none",
            fix="use halfspaces unless you compare with the paper",
        )
    params = params or RefineParams()
    if isinstance(path, JointTrajectory):
        first = iterate_from_trajectory(problem, path)
    elif isinstance(path, Guess):
        first = iterate_from_guess(problem, path)
    else:
        first = iterate_from_path(problem, path)
    if method == "none" or fixed_knots(problem).all():
        motion = _unconstrained(problem, first, clearance, params)
    else:
        motion = _Loop(problem, clearance, method, params, trace, worth).run(first)
    wanted = fallback and method != "none" and isinstance(path, JointPath)
    if wanted and not motion.certified:
        assert isinstance(path, JointPath)
        spare = fallback_motion(problem, path, clearance, note=motion.note)
        if spare is not None:
            return spare
    return motion


def _unconstrained(
    problem: MotionProblem, first: Iterate, clearance: Clearance, params: RefineParams
) -> Motion:
    """Loosely first where that will do: most obstacle-free optima of a station touch something."""
    solution, certificate, used = None, None, 0
    for solver in (params.tight,) if params.always_tight else (params.loose, params.tight):
        guess = first.guess() if solution is None else Iterate.of(solution).guess()
        solution = solve_nlp(problem, guess, params=solver)
        used += solution.iterations
        if solution.status.ok:
            certificate = clearance.certify(Iterate.of(solution).trajectory(problem))
        if certificate is None or not certificate.ok:
            break
    assert solution is not None
    return _motion(problem, "none", solution, certificate if solution.status.ok else None, used)


@dataclass(frozen=True)
class _Descent:
    """Where the outer iterations ended; `outer` counts all so far, `solver_iterations` these.

    `solution` is that of the iterate, None if no step was accepted.
    """

    stage: RefineRound
    iterate: Iterate
    view: View
    trust_rad: Array
    outer: int
    solver_iterations: int
    solution: NlpSolution | None


@dataclass(frozen=True)
class _Loop:
    problem: MotionProblem
    clearance: Clearance
    method: Method
    params: RefineParams
    trace: Trace | None
    worth: float

    def run(self, first: Iterate) -> Motion:
        params = self.params
        points = points_of(self.problem, params.fractions)
        stage = RefineRound(
            self.problem,
            self.clearance,
            self.method,
            params,
            points,
            np.zeros(self.problem.num_intervals),
            points,
            np.zeros(0),
            0,
            self.trace,
        )
        stage = replace(stage, required_m=demanded(stage, points))
        start_trust = 1.0 if self.method == "boxes" else params.trust_rad
        trust = np.full(self.problem.num_intervals + 1, start_trust)
        iterate, view = first, look(self.clearance, first, points, params.cap_m)
        used = 0
        if self.method == "boxes":
            iterate, view, used = self._freed(stage, iterate, view)
        history, outer = [iterate], 0
        while True:
            descent = self._descend(stage, iterate, view, trust, outer, history)
            stage, iterate, view = descent.stage, descent.iterate, descent.view
            trust, outer, solution = descent.trust_rad, descent.outer, descent.solution
            used += descent.solver_iterations
            if solution is not None and iterate.cost > self.worth:
                dear = _motion(self.problem, self.method, solution, None, used)
                return dear.replace(note="dearer than a motion that is known")
            # Loose solves are enough to walk; what is delivered is solved once to full accuracy.
            last = None
            if solution is None or self._wants_tight(solution):
                stage, last, spent = self._settled(stage, iterate, view, trust, outer)
                used += spent
                if last.accepted:
                    iterate, view, trust = last.iterate, last.view, last.trust_rad
                    solution = last.solution
            certificate = None
            if solution is None:
                assert last is not None
                solution = last.solution
            elif solution.max_defect <= params.largest_defect or (last and last.accepted):
                certificate = self.clearance.certify(iterate.trajectory(self.problem))
            motion = _motion(self.problem, self.method, solution, certificate, used)
            if motion.certified or stage.repair >= params.repair_rounds:
                return motion
            # The certificate looks between the points; where it fails, they demand more and closer.
            repaired = repaired_stage(stage, certificate)
            if repaired is None:
                return motion
            iterate, trust = restart(repaired, stage, iterate, history, trust)
            stage = repaired
            view = look(self.clearance, iterate, stage.points, params.cap_m)

    def _descend(
        self,
        stage: RefineRound,
        iterate: Iterate,
        view: View,
        trust: Array,
        outer: int,
        history: list[Iterate],
    ) -> _Descent:
        """Outer iterations until J stands still, the trust region is gone, or the limit."""
        params, used, idle, more, climbs = self.params, 0, 0, 0, 0
        solution = None
        limit = outer + (params.max_outer_repair if stage.repair else params.max_outer)
        while outer < limit:
            step = take_step(stage, iterate, view, trust, outer, params.loose)
            used += step.solver_iterations
            trust = step.trust_rad
            outer += 1
            if not step.accepted:
                idle += 1
                if idle >= 2 or solution is None:
                    break
                continue
            idle = 0
            change, before = abs(iterate.cost - step.iterate.cost), iterate
            dearer = step.iterate.cost > iterate.cost
            deepest = float(np.min(view.phi_m - stage.required_m, initial=0.0))
            iterate, view, solution = step.iterate, step.view, step.solution
            history.append(iterate)
            risen = float(np.min(view.phi_m - stage.required_m, initial=0.0)) - deepest
            below_floor = bool(np.any(view.phi_m < np.minimum(params.floor_m, stage.required_m)))
            climbs = climbs + 1 if dearer and not below_floor else 0
            if climbs > _MOST_CLIMBS:
                break
            if dearer and risen <= _NO_RISE_M:
                # Neither cheaper nor freer: the linearisation reaches too far.
                trust = trust * params.shrink_dearer
            still = change <= params.stop_fraction * abs(iterate.cost)
            stage, view = watching(stage, iterate, view)
            if still and not (below_floor and risen > 0.1 * params.floor_m):
                if more == params.max_outer_short or not self._is_short(stage, view):
                    break
                more += 1
                trust = self._within_step(trust, before, iterate)
        return _Descent(stage, iterate, view, trust, outer, used, solution)

    def _settled(
        self, stage: RefineRound, iterate: Iterate, view: View, trust: Array, outer: int
    ) -> tuple[RefineRound, Step, int]:
        """The last tight step, and more while one falls short of what was asked; their iterations.

        Such a step is the last that was accepted, or the first.
        """
        step = take_step(stage, iterate, view, trust, outer, self.params.tight)
        used = step.solver_iterations
        for _ in range(self.params.max_outer_short):
            watched, view = watching(stage, step.iterate, step.view)
            if not step.accepted or not self._is_short(watched, view):
                break
            trust = self._within_step(step.trust_rad, iterate, step.iterate)
            more = take_step(watched, step.iterate, view, trust, outer, self.params.tight)
            used += more.solver_iterations
            if not more.accepted:
                break
            stage, iterate, step = watched, step.iterate, more
        return stage, step, used

    def _within_step(self, trust: Array, before: Iterate, after: Iterate) -> Array:
        """A trust region smaller than the last step: where a motion slides along a body and only
        misses the demand by the curvature of the distance, steps that size miss it again.
        """
        step = float(np.max(np.abs(after.q_rad - before.q_rad)))
        return np.minimum(trust, self.params.shrink * step)

    def _is_short(self, stage: RefineRound, view: View) -> bool:
        """Whether half-spaces keep less than was asked and a share of what is aimed for above."""
        if self.method != "halfspaces":
            return False
        return bool(np.any(view.phi_m < stage.required_m - _SPENT * self.params.spare_m))

    def _freed(self, stage: RefineRound, iterate: Iterate, view: View) -> tuple[Iterate, View, int]:
        """A seed that is free at all watched points, for boxes, which cannot leave a violation.

        A path sampled on N knots may cut a corner; a few half-space steps push it out.
        """
        pushing = replace(stage, method="halfspaces")
        trust = np.full(len(iterate.q_rad), self.params.trust_rad)
        floor, used = np.minimum(self.params.floor_m, stage.required_m), 0
        for _ in range(_MOST_PUSHES):
            if not np.any(view.phi_m < floor):
                break
            step = take_step(pushing, iterate, view, trust, 0, self.params.loose)
            used += step.solver_iterations
            iterate, view, trust = step.iterate, step.view, step.trust_rad
        return iterate, view, used

    def _wants_tight(self, solution: NlpSolution) -> bool:
        return self.params.always_tight or solution.max_defect > self.params.largest_defect


def _motion(
    problem: MotionProblem,
    method: Method,
    solution: NlpSolution,
    certificate: Certificate | None,
    used: int,
) -> Motion:
    usable = bool(solution.status.ok)
    certified = bool(usable and certificate is not None and certificate.ok)
    status, note = solution.status, ""
    if usable and not certified:
        status = Status.UNCERTIFIED
        if certificate is None:
            note = "no candidate kept the demanded distances"
        elif certificate.failures:
            f = certificate.failures[0]
            note = (
                f"interval {f.interval}, fraction {f.fraction:.3g}: {f.pair[0]} - {f.pair[1]} at "
                f"{1e3 * f.distance_m:.1f} mm"
            )
    trajectory = Iterate.of(solution).trajectory(problem) if usable else None
    motion = Motion(
        status=status,
        source="refined",
        trajectory=trajectory,
        cost=solution.cost if usable else float("inf"),
        smoothing_cost=solution.smoothing_cost,
        iterations=used,
        max_defect=solution.max_defect,
        min_clearance_m=None if certificate is None else certificate.min_clearance_m,
        proven_clearance_m=None if certificate is None else certificate.proven_clearance_m,
        certified=certified,
        note=note,
        solver=solution.solver,
        method=METHOD_NAMES[method],
    )
    return motion if trajectory is None else motion.judged(executed_cost(problem, trajectory))
