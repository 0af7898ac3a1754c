"""Primal-dual interior-point method with a filter line search on a staged programme.

The method is that of Wächter and Biegler (2006) with the adaptive barrier parameter of Nocedal,
Wächter and Waltz (2009), as the measured settings of Ipopt choose it, but without a restoration
phase: where the line search fails the outcome says so, and another solver has to go on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dmoc.arrays import Array
from dmoc.interior import point_kernels as kernels
from dmoc.interior.barrier_rule import BarrierRule
from dmoc.interior.filter import Filter, Merit
from dmoc.interior.oracle import Oracle
from dmoc.interior.point_kernels import FreeBox, Point
from dmoc.interior.system import NewtonSystem

LARGEST_DUAL = 1.0
LARGEST_VIOLATION = 1e-8
LARGEST_PRODUCT = 1e-4
ACCEPTABLE_VIOLATION = 1e-2
ACCEPTABLE_PRODUCT = 1e-2
_AVERAGE_MULTIPLIER = 100.0
_LEAST_TAU = 0.99
_RELAXATION = 1e-8
_PUSH, _SHARE = 1e-2, 1e-2
# Ipopt's 1e-4 are too near to the bounds where rows have joined or boxes have moved: a tenth more
# iterations on edges, two thirds more on time-optimal motions.
_WARM_PUSH, _WARM_SHARE, _WARM_MULTIPLIER = 1e-3, 1e-3, 3e-3
_LARGEST_FIRST_MULTIPLIER = 1e3
_CORRECTIONS, _CORRECTION_SHARE = 4, 0.99


@dataclass(frozen=True)
class Bounds:
    """Bounds of x (size,) and of all rows (rows,); momentum rows have both equal."""

    lower: Array
    upper: Array
    rows_lower: Array
    rows_upper: Array


@dataclass(frozen=True)
class Start:
    """Where to begin: x, and multipliers of bounds and rows if warm."""

    x: Array
    bounds: Array | None = None
    rows: Array | None = None


@dataclass(frozen=True)
class Tolerances:
    """As of `dmoc.solving.solvers.SolveParams`."""

    tolerance: float
    acceptable: float
    acceptable_iterations: int
    max_iterations: int


Reason = Literal["converged", "acceptable", "iterations", "stuck"]


@dataclass(frozen=True)
class Outcome:
    """The last point with its objective and multipliers (z_up − z_lo of x, y of the rows)."""

    reason: Reason
    x: Array
    objective: float
    bounds: Array
    rows: Array
    iterations: int


@dataclass(frozen=True)
class _Trial:
    w: Array
    defect: Array
    objective: float
    worst: float
    logs: float
    merit: Merit
    with_slopes: bool


def minimise(
    oracle: Oracle, system: NewtonSystem, bounds: Bounds, start: Start, limits: Tolerances
) -> Outcome:
    """The local minimum next to `start`; parameters of `oracle` are set before."""
    return _Run(oracle, system, bounds, start, limits).run()


class _Run:
    """One solve. Arrays as in `dmoc.interior.point_kernels`."""

    def __init__(
        self, oracle: Oracle, system: NewtonSystem, bounds: Bounds, start: Start, limits: Tolerances
    ) -> None:
        self.oracle, self.system, self.limits = oracle, system, limits
        self.frames = oracle.frames
        self.size, self.equal = self.frames.size, self.frames.num_momentum
        num_rows = len(bounds.rows_lower)
        self.fixed = bounds.lower == bounds.upper
        self.target = bounds.rows_lower[: self.equal]
        self.lo = np.concatenate([bounds.lower, bounds.rows_lower[self.equal :]])
        self.up = np.concatenate([bounds.upper, bounds.rows_upper[self.equal :]])
        self.lo -= _RELAXATION * np.maximum(1.0, np.abs(self.lo))
        self.up += _RELAXATION * np.maximum(1.0, np.abs(self.up))
        self.lo[: self.size][self.fixed] = -np.inf
        self.up[: self.size][self.fixed] = np.inf
        self.box = FreeBox(self.lo, self.up, self.fixed, self.size, self.equal)
        total = len(self.lo)
        self.w, self.y = np.zeros(total), np.zeros(num_rows)
        self.z_lo, self.z_up = np.zeros(total), np.zeros(total)
        self.grad, self.pull = np.zeros(self.size), np.zeros(self.size)
        self.sigma, self.inwards = np.zeros(total), np.zeros(total)
        self.slopes = np.zeros(len(oracle.slopes))
        self.rule = BarrierRule.for_tolerance(limits.tolerance)
        system.restart()
        self._begin(start)
        self.filter = Filter(self.theta)

    def _begin(self, start: Start) -> None:
        warm = start.bounds is not None and start.rows is not None
        push, share = (_WARM_PUSH, _WARM_SHARE) if warm else (_PUSH, _SHARE)
        size, equal = self.size, self.equal
        self.w[:size] = start.x
        kernels.push_inside(self.w[:size], self.lo[:size], self.up[:size], push, share)
        defect = self._evaluate(self.w, with_slopes=True)[3]
        self.w[size:] = defect[equal:]  # of slacks that are 0
        # Far inside also when warm: a family of rows may have joined since, and be violated.
        kernels.push_inside(self.w[size:], self.lo[size:], self.up[size:], _PUSH, _SHARE)
        objective, theta, worst, defect = self._gather(self.w)
        logs = kernels.log_slacks(self.w, self.lo, self.up)
        below, above = self.lo > -np.inf, self.up < np.inf
        if start.bounds is not None and start.rows is not None:
            given = np.concatenate([start.bounds, start.rows[equal:]])
            self.z_lo[below] = np.maximum(-given[below], _WARM_MULTIPLIER)
            self.z_up[above] = np.maximum(given[above], _WARM_MULTIPLIER)
            self.y[:] = start.rows
            self.y[equal:][~(below | above)[size:]] = 0.0
        else:
            self.z_lo[below], self.z_up[above] = 1.0, 1.0
        merit = Merit(theta, objective)
        self._move_to(_Trial(self.w, defect, objective, worst, logs, merit, True))
        if not warm:
            self._least_squares()

    def _least_squares(self) -> None:
        """Multipliers of the rows that leave the least dual residual, by the same system."""
        size = self.size
        self.sigma[:] = (self.lo > -np.inf) | (self.up < np.inf)
        self.sigma[:size] = 1.0
        self.inwards[:] = self.z_up - self.z_lo
        self.system.set_identity(self.slopes, self.sigma[size:])
        if self.system.factorise(self.sigma, self.fixed):
            step = self._step(1.0, np.zeros(len(self.y)))
            if np.all(np.abs(step.y) <= _LARGEST_FIRST_MULTIPLIER):
                self.y = step.y
                self._update()

    def run(self) -> Outcome:
        acceptable = 0
        for iteration in range(self.limits.max_iterations + 1):
            error, dual, product, mean_product = self._measured(0.0)
            small = self.worst <= LARGEST_VIOLATION and product <= LARGEST_PRODUCT
            if error <= self.limits.tolerance and dual <= LARGEST_DUAL and small:
                return self._outcome("converged", iteration)
            good = (
                error <= self.limits.acceptable
                and self.worst <= ACCEPTABLE_VIOLATION
                and product <= ACCEPTABLE_PRODUCT
            )
            # Several in a row: a point may pass by chance on the way to a better one.
            acceptable = acceptable + 1 if good else 0
            if acceptable >= self.limits.acceptable_iterations > 0:
                return self._outcome("acceptable", iteration)
            if iteration == self.limits.max_iterations:
                return self._outcome("iterations", iteration)
            if not self._advance(error, mean_product):
                return self._outcome("stuck", iteration)
        raise AssertionError

    def _advance(self, error: float, mean_product: float) -> bool:
        """One step; False where no step helps."""
        oracle, size = self.oracle, self.size
        oracle.hessian(self.w[:size], self.y)
        kernels.centring(self._point(), self.lo, self.up, self.sigma, self.inwards)
        self.system.set_hessian(oracle.curves, self.slopes, self.sigma[size:])
        if not self.system.factorise(self.sigma, self.fixed):
            return False

        def mean_after() -> float:
            step = self._step(0.0, self.defect)
            longest = kernels.bound_step(self.w, step.w, self.lo, self.up, 1.0)
            here = self._point()
            dual = kernels.multiplier_step(here, step, 1.0)
            return float(kernels.mean_product_after(here, step, self.lo, self.up, longest, dual))

        def error_at(mu: float) -> float:
            return self._measured(mu)[0]

        # The affine step is made only when the rule asks for its mean: one back-solve, for the
        # factor is there already.
        if self.rule.choose(self.objective, self.theta, mean_product, error_at, mean_after):
            self.filter.clear()
        if self._search(error):
            return True
        if not self.rule.free:
            return False
        # A probed μ can be too ambitious for any step to pass: once more with a central one.
        self.rule.fix(mean_product)
        self.filter.clear()
        return self._search(error)

    def _search(self, error: float) -> bool:
        """Backtrack along the step for the present μ; False if nothing is accepted."""
        mu = self.rule.mu
        # Fraction to the boundary: close to 1 near a solution, or convergence would stay linear.
        tau = max(_LEAST_TAU, 1.0 - (error if self.rule.free else mu))
        step = self._step(mu, self.defect)
        rate = float(self.grad @ step.w[: self.size] + mu * (self.inwards @ step.w))
        start = Merit(self.theta, self.objective - mu * self.logs, rate)
        alpha = kernels.bound_step(self.w, step.w, self.lo, self.up, tau)
        shortest = min(self.filter.shortest_step(start), alpha)
        first = True
        while alpha >= shortest:
            trial = self._try(step, alpha, mu, with_slopes=first)
            if self.filter.accepts(start, trial.merit, alpha):
                self._accept(start, trial, step, alpha, tau, mu)
                return True
            # A full step that only bends out of the rows (Maratos): correct before shortening.
            worse = first and trial.merit.theta >= start.theta
            if worse and self._corrected(start, trial, alpha, tau, mu):
                return True
            first = False
            alpha *= 0.5
        return False

    def _corrected(self, start: Merit, trial: _Trial, alpha: float, tau: float, mu: float) -> bool:
        """Second-order corrections of a rejected full step."""
        defect, length = self.defect, alpha
        for _ in range(_CORRECTIONS):
            defect = length * defect + trial.defect
            step = self._step(mu, defect)
            length = kernels.bound_step(self.w, step.w, self.lo, self.up, tau)
            theta = trial.merit.theta
            trial = self._try(step, length, mu, with_slopes=False)
            if self.filter.accepts(start, trial.merit, alpha):
                self._accept(start, trial, step, length, tau, mu)
                return True
            if not trial.merit.theta < _CORRECTION_SHARE * theta:
                return False
        return False

    def _try(self, step: Point, alpha: float, mu: float, with_slopes: bool) -> _Trial:
        w = self.w + alpha * step.w
        objective, theta, worst, defect = self._evaluate(w, with_slopes)
        logs = kernels.log_slacks(w, self.lo, self.up)
        merit = Merit(theta, objective - mu * logs)
        return _Trial(w, defect, objective, worst, logs, merit, with_slopes)

    def _accept(
        self, start: Merit, trial: _Trial, step: Point, alpha: float, tau: float, mu: float
    ) -> None:
        self.filter.remember(start, trial.merit, alpha)
        dual = kernels.multiplier_step(self._point(), step, tau)
        self.y += alpha * step.y
        self.z_lo += dual * step.z_lo
        self.z_up += dual * step.z_up
        self._move_to(trial)
        # z·slack within a factor of μ, or the diagonal z/slack says nothing of the curvature.
        kernels.keep_near(self.w, self.lo, self.up, mu, self.z_lo, self.z_up)

    def _move_to(self, trial: _Trial) -> None:
        if not trial.with_slopes:
            self.oracle.jacobian(trial.w[: self.size])
        self.slopes[:] = self.oracle.slopes
        self.system.set_rows(self.slopes)
        self.w, self.defect, self.objective = trial.w, trial.defect, trial.objective
        self.theta, self.worst, self.logs = trial.merit.theta, trial.worst, trial.logs
        self._update()

    def _update(self) -> None:
        """Gradients at the present point and multipliers."""
        cost, limit = self.frames.objective, self.frames.limit
        self.system.pull(self.y[: self.equal], self.pull)
        kernels.gradients(self.slopes, self.y, cost, limit, self.grad, self.pull)

    def _evaluate(self, w: Array, with_slopes: bool) -> tuple[float, float, float, Array]:
        x = w[: self.size]
        self.oracle.jacobian(x) if with_slopes else self.oracle.rows(x)
        return self._gather(w)

    def _gather(self, w: Array) -> tuple[float, float, float, Array]:
        """Objective, Σ|defect|, largest |defect| and the defect, from the oracle's values."""
        defect = np.empty(len(self.y))
        objective, theta, worst = kernels.gather_rows(
            self.oracle.values, self.frames.rows, self.target, w, self.box, defect
        )
        return objective, theta, worst, defect

    def _point(self) -> Point:
        return Point(self.w, self.y, self.z_lo, self.z_up)

    def _step(self, mu: float, defect: Array) -> Point:
        """The Newton step for the barrier parameter μ and a defect of the rows."""
        size, equal, limit = self.size, self.equal, self.frames.limit
        gradient = np.empty(size)
        barrier = (self.sigma, self.inwards, mu, self.slopes, limit, self.box)
        kernels.right_hand_side(self.grad, self.pull, self.y, defect, *barrier, gradient)
        here = self._point()
        step = Point(*(np.empty(len(part)) for part in here))
        step.w[:size], step.y[:equal] = self.system.solve(gradient, defect[:equal])
        kernels.complete(here, defect, *barrier, step)
        return step

    def _measured(self, mu: float) -> tuple[float, float, float, float]:
        """Ipopt's scaled optimality error, largest dual residual, |z·slack − μ|, mean z·slack."""
        dual, product, total, scale, scale_z, count = kernels.measure(
            self.grad, self.pull, self._point(), self.box, mu
        )
        many = _AVERAGE_MULTIPLIER
        by = max(many, scale / max(count + len(self.y), 1)) / many
        by_z = max(many, scale_z / max(count, 1)) / many
        error = float(max(dual / by, self.worst, product / by_z))
        return error, dual, product, total / max(count, 1)

    def _outcome(self, reason: Reason, iterations: int) -> Outcome:
        x, bounds = self.w[: self.size].copy(), (self.z_up - self.z_lo)[: self.size]
        return Outcome(reason, x, self.objective, bounds, self.y.copy(), iterations)
