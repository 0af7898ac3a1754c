"""The refinement loop: outer iterations, a last tight solve, certificate, repair."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.clearance import Certificate, Clearance
from dmoc.errors import Fault, ProblemError
from dmoc.motion import Motion, MotionProblem
from dmoc.nlp import solve_nlp
from dmoc.nlp_types import NlpSolution
from dmoc.refinement.fallback import fallback_motion
from dmoc.refinement.iterate import Iterate, fixed_knots, iterate_from_path, iterate_from_trajectory
from dmoc.refinement.params import Method, RefineParams, Trace
from dmoc.refinement.points import View, look, points_of, required_clearance
from dmoc.refinement.steps import Stage, take_step
from dmoc.status import Status
from dmoc.trajectory import JointPath, JointTrajectory

__all__ = ["refine"]


def refine(
    problem: MotionProblem,
    path: JointPath | JointTrajectory | None,
    clearance: Clearance,
    *,
    method: Method = "halfspaces",
    params: RefineParams | None = None,
    trace: Trace | None = None,
) -> Motion:
    """Turn a path into a locally optimal motion that is proven free between its knots.

    `path` is collision-free (a `JointPath` is time-scaled first; a `JointTrajectory` keeps its
    timing); None starts from the straight line. `method` is `halfspaces` (linearised distances at
    points of every interval), `boxes` (the paper's section 2.4) or `none` (obstacles are ignored,
    only the certificate looks at them). `trace` is called after every solve.

    Returns a `Motion`: `certified` says what `clearance.certify` said of exactly this trajectory.
    Without a certificate the time-scaled `JointPath`, if that is certified, is returned as
    `source="fallback"`; else the status is `uncertified` and `note` names interval and pair.

    Errors: `ProblemError` for an unknown method.
    """
    if method not in ("halfspaces", "boxes", "none"):
        raise ProblemError(
            Fault("method", field="method", value=repr(method), legal="halfspaces, boxes, none",
                  fix="use halfspaces unless you compare with the paper")
        )  # fmt: skip
    params = params or RefineParams()
    if isinstance(path, JointTrajectory):
        first = iterate_from_trajectory(problem, path)
    else:
        first = iterate_from_path(problem, path)
    if method == "none" or fixed_knots(problem).all():
        motion = _unconstrained(problem, first, clearance, params)
    else:
        motion = _Loop(problem, clearance, method, params, trace).run(first)
    if not motion.certified and method != "none" and isinstance(path, JointPath):
        spare = fallback_motion(problem, path, clearance, note=motion.note)
        if spare is not None:
            return spare
    return motion


def _unconstrained(
    problem: MotionProblem, first: Iterate, clearance: Clearance, params: RefineParams
) -> Motion:
    solution = solve_nlp(problem, first.guess(), params=params.tight)
    certificate = None
    if solution.status.ok:
        certificate = clearance.certify(Iterate.of(solution).trajectory(problem))
    return _motion(problem, solution, certificate, solution.iterations)


@dataclass(frozen=True)
class _Loop:
    problem: MotionProblem
    clearance: Clearance
    method: Method
    params: RefineParams
    trace: Trace | None

    def run(self, first: Iterate) -> Motion:
        params = self.params
        points = points_of(self.problem, params.fractions)
        required = required_clearance(self.clearance, self.problem, points, params.clearance_m)
        stage = Stage(
            self.problem, self.clearance, self.method, params, points, required, 0, self.trace
        )
        start_trust = 1.0 if self.method == "boxes" else params.trust_rad
        trust = np.full(self.problem.num_intervals + 1, start_trust)
        iterate, view = first, look(self.clearance, first, points, params.cap_m)
        history, used, outer = [first], 0, 0
        while True:
            iterate, view, trust, outer, spent = self._descend(
                stage, iterate, view, trust, outer, history
            )
            used += spent
            last = take_step(stage, iterate, view, trust, outer, params.tight)
            used += last.solver_iterations
            certificate = None
            if last.accepted:
                iterate, view = last.iterate, last.view
                certificate = self.clearance.certify(iterate.trajectory(self.problem))
            motion = _motion(self.problem, last.solution, certificate, used)
            if motion.certified or stage.repair >= params.repair_rounds:
                return motion
            repaired = self._repair(stage, certificate)
            if repaired is None:
                return motion
            stage = repaired
            if self.method == "boxes":
                iterate, trust = self._step_back(stage, history, trust)
            else:
                trust = np.maximum(trust, params.repair_trust_rad)
            view = look(self.clearance, iterate, stage.points, params.cap_m)

    def _descend(
        self,
        stage: Stage,
        iterate: Iterate,
        view: View,
        trust: Array,
        outer: int,
        history: list[Iterate],
    ) -> tuple[Iterate, View, Array, int, int]:
        """Outer iterations until J stands still, the trust region is gone, or the limit."""
        params, used, idle = self.params, 0, 0
        limit = outer + params.max_outer if stage.repair else params.max_outer
        while outer < limit:
            step = take_step(stage, iterate, view, trust, outer, params.loose)
            used += step.solver_iterations
            trust = step.trust_rad
            outer += 1
            if not step.accepted:
                idle += 1
                if idle >= 2:
                    break
                continue
            idle = 0
            change = abs(iterate.cost - step.iterate.cost)
            deepest = float(np.min(view.phi_m - stage.required_m, initial=0.0))
            iterate, view = step.iterate, step.view
            history.append(iterate)
            risen = float(np.min(view.phi_m - stage.required_m, initial=0.0)) - deepest
            below_floor = bool(np.any(view.phi_m < np.minimum(params.floor_m, stage.required_m)))
            still = change <= params.stop_fraction * abs(iterate.cost)
            if still and not (below_floor and risen > 0.1 * params.floor_m):
                break
        return iterate, view, trust, outer, used

    def _repair(self, stage: Stage, certificate: Certificate | None) -> Stage | None:
        """The next stage, which also watches the places that the certificate named."""
        repair = stage.repair + 1
        if certificate is None or not certificate.failures:
            # Nothing was near enough to be certified. Half-spaces may get out with a fresh trust
            # region, once; boxes cannot.
            retry = self.method == "halfspaces" and stage.repair == 0
            return replace(stage, repair=repair) if retry else None
        fixed = fixed_knots(self.problem)
        # The nearest place of every interval: more would say the same.
        places: dict[int, tuple[float, float]] = {}
        for f in certificate.failures:
            if not (fixed[f.interval] and fixed[f.interval + 1]):
                place = (f.distance_m, f.fraction)
                places[f.interval] = min(places.get(f.interval, place), place)
        if not places:
            return None
        interval = np.array(list(places))
        fraction = np.array([fraction for _, fraction in places.values()])
        points = stage.points.with_extra(interval, fraction)
        required = required_clearance(self.clearance, self.problem, points, self.params.clearance_m)
        margin = np.zeros(len(points.interval))
        margin[: len(stage.points.interval)] = (
            stage.required_m - required[: len(stage.points.interval)]
        )
        hit = np.isin(points.interval, interval)
        margin[hit] += self.params.repair_margin_m
        return replace(stage, points=points, required_m=required + margin, repair=repair)

    def _step_back(
        self, stage: Stage, history: list[Iterate], trust: Array
    ) -> tuple[Iterate, Array]:
        """The latest iterate that is free at all points now watched, and smaller boxes there."""
        added = np.unique(stage.points.interval[stage.points.fraction % 0.25 > 0])
        slower = trust.copy()
        for knot in added:
            slower[knot : knot + 2] *= self.params.shrink
        while len(history) > 1:
            seen = look(self.clearance, history[-1], stage.points, self.params.cap_m)
            if seen.phi_m.min(initial=1.0) >= self.params.floor_m:
                break
            history.pop()
        return history[-1], slower


def _motion(
    problem: MotionProblem, solution: NlpSolution, certificate: Certificate | None, used: int
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
    return Motion(
        status=status,
        source="refined",
        trajectory=Iterate.of(solution).trajectory(problem) if usable else None,
        cost=solution.cost if usable else float("inf"),
        smoothing_cost=solution.smoothing_cost,
        iterations=used,
        max_defect=solution.max_defect,
        min_clearance_m=None if certificate is None else certificate.min_clearance_m,
        certified=certified,
        note=note,
    )
