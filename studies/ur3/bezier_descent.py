"""Gradient descent over Bézier control points: L-BFGS-B with exact gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from dmoc.arrays import Array
from studies.ur3.bezier_motion import NUM_CONTROLS, bernstein
from studies.ur3.bezier_problem import BezierProblem, BezierResult, Evaluator, metric_values
from studies.ur3.bezier_swarm import Forbidden
from studies.ur3.curve_cost import LIMIT_SHARE

#: Extra cost rate (K,) of sampled configurations q (K, n) and its gradient (K, n): near obstacles.
Avoid = Callable[[Array], tuple[Array, Array]]


# What is left of a penalised excess may be this much beyond the margin, which is four times wider.
ACCEPTED = 0.25 * (1.0 - LIMIT_SHARE)


@dataclass(frozen=True)
class DescentParams:
    """`starts` runs: the straight line, then random ones within `spread_rad` of it.

    Each run goes through the `smoothing_rad_s` of the kinks in turn with at most `iterations`
    steps; the price of limit excess is raised by `price_factor` up to `price_rounds` times while a
    limit is broken. At most `detours` runs whose curve touches something are led around it.
    The winner descends once more with `last_smoothing_rad_s`. `num_samples` midpoints are enough
    for a curve of degree six.
    """

    starts: int = 4
    iterations: int = 70
    smoothing_rad_s: tuple[float, ...] = (0.05, 0.01)
    last_smoothing_rad_s: float = 0.002
    spread_rad: float = 1.5
    price: float = 1e4
    price_factor: float = 30.0
    price_rounds: int = 2
    detours: int = 2
    num_samples: int = 32


def descend_bezier(
    problem: BezierProblem,
    seed: int = 0,
    params: DescentParams = DescentParams(),
    forbidden: Forbidden | None = None,
    avoid: Avoid | None = None,
    start: Array | None = None,
) -> BezierResult:
    """Minimise the problem's metric over its inner control points from several starts.

    `start` (5 n,), if given, replaces the straight line as the first start. Velocity,
    acceleration and torque limits enter as exterior penalties with a 1 % margin, joint limits and
    end ranges as bounds. The cheapest run wins if its curve touches nothing, as `forbidden` says;
    otherwise it is drawn back towards the straight line until it is free, improved from there with
    the extra cost of `avoid`, and compared with the next one.
    """
    rng = np.random.default_rng([seed, 2])
    search = _Search(problem, params, forbidden, avoid)
    n = problem.robot.num_joints
    runs = []
    for k in range(params.starts):
        x = problem.straight if start is None or k > 0 else np.asarray(start, dtype=float)
        if k > 0:
            offset = params.spread_rad * (2.0 * rng.random((5, n)) - 1.0)
            offset[[0, 4]] = 0.0
            if k % 2 == 0:
                offset[:, problem.idle_joints] = 0.0
            x = x + offset.ravel()
        runs.append(search.run(x))
    runs.sort(key=lambda item: item[0])
    best = search.sharpened(_freest(search, runs, params.detours))
    best = search.within_limits_exactly(best)
    motion = problem.motion(best)
    limits = motion.limit_use(problem.robot)
    free = not search.touches(best)
    return BezierResult(
        motion=motion,
        value=metric_values(motion, problem.robot, (problem.metric,))[problem.metric],
        feasible=free and max(limits.values()) <= 1.0,
        limits=limits,
        evaluations=search.evaluations,
        gradients=search.evaluations,
        history=np.array([value for value, _ in runs]),
        note="" if free else "every start ended in a curve that touches something",
    )


def _freest(search: _Search, runs: list[tuple[float, Array]], detours: int) -> Array:
    """The cheapest free curve, leading at most `detours` runs around what they touch."""
    best: tuple[float, Array] | None = None
    for value, x in runs:
        if best is not None and best[0] <= value:
            break
        if not search.touches(x):
            return x
        if detours > 0:
            detours -= 1
            led = search.around(x)
            if led is not None and (best is None or led[0] < best[0]):
                best = led
    return runs[0][1] if best is None else best[1]


class _Search:
    def __init__(
        self,
        problem: BezierProblem,
        params: DescentParams,
        forbidden: Forbidden | None,
        avoid: Avoid | None,
    ) -> None:
        lower, upper = problem.bounds
        self.problem = problem
        self.evaluator = Evaluator(replace(problem, num_samples=params.num_samples))
        self.params, self.forbidden, self.avoid = params, forbidden, avoid
        self.box = np.stack([lower, upper], axis=1)
        self.straight = np.clip(problem.straight, lower, upper)
        self.dense = bernstein(np.linspace(0.0, 1.0, 65), NUM_CONTROLS - 1)
        self.evaluations = 0

    def run(self, x: Array) -> tuple[float, Array]:
        """One start: continuation in smoothing, then in the price of limits; nothing in the way."""
        x = np.clip(x, *self.box.T)
        x = self._still(self._repaired(self._within_limits(x, self.params.smoothing_rad_s, False)))
        return self._cost(x), x

    def sharpened(self, x: Array) -> Array:
        """x after a last descent with sharper friction, if that is legal and costs less."""
        tried = self._minimise(x, self.params.last_smoothing_rad_s, self.params.price, False)
        tried = self._still(tried)
        better = self._cost(tried) < self._cost(x) and self._excess(tried) <= ACCEPTED
        return tried if better and (self.touches(x) or not self.touches(tried)) else x

    def around(self, x: Array) -> tuple[float, Array] | None:
        """A free curve near x: drawn back to the straight line, then improved with `avoid`."""
        shares = np.linspace(1.0, 0.0, 17)[1:, None]
        drawn = self.straight + shares * (x - self.straight)
        free = [y for y in drawn if not self.touches(y)]
        if not free:
            return self._freed(x)
        found = free[0]
        if self.avoid is not None:
            led = self._within_limits(found, self.params.smoothing_rad_s[-1:], True)
            led = self._still(self._repaired(led))
            if not self.touches(led) and self._cost(led) < self._cost(found):
                found = led
        return self._cost(found), found

    def _freed(self, x: Array) -> tuple[float, Array] | None:
        """Where the straight line touches, too: pushed out by `avoid` alone, if that frees it."""
        if self.avoid is None:
            return None
        x = self._still(self._repaired(self._within_limits(x, (0.05, 0.01), True)))
        return None if self.touches(x) else (self._cost(x), x)

    def _cost(self, x: Array) -> float:
        return float(self.evaluator.evaluate(x[None]).cost[0])

    def touches(self, x: Array) -> bool:
        """Whether the curve of x touches something at one of 65 samples."""
        if self.forbidden is None:
            return False
        return bool(self.forbidden((self.dense @ self.problem.controls(x))[None])[0])

    def _excess(self, x: Array) -> float:
        return float(self.evaluator.evaluate(x[None]).excess[0])

    def _within_limits(self, x: Array, smoothing: tuple[float, ...], around: bool) -> Array:
        price = self.params.price
        for level in smoothing:
            x = self._minimise(x, level, price, around)
        for _ in range(self.params.price_rounds):
            if self._excess(x) <= ACCEPTED:
                break
            price *= self.params.price_factor
            x = self._minimise(x, smoothing[-1], price, around)
        return x

    def _repaired(self, x: Array) -> Array:
        """The farthest curve towards x from the straight line that keeps the limits.

        Velocity and acceleration are linear in the control points, so a blend of two curves
        exceeds a limit no more than the worse of them.
        """
        if self._excess(x) <= ACCEPTED or self._excess(self.straight) > ACCEPTED:
            return x
        low, high = 0.0, 1.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            fits = self._excess(self.straight + middle * (x - self.straight)) <= ACCEPTED
            low, high = (middle, high) if fits else (low, middle)
        return self.straight + low * (x - self.straight)

    def within_limits_exactly(self, x: Array) -> Array:
        """x, or the first of 24 steps towards the straight line that keeps limits everywhere.

        A peak of torque between samples or at an end may be a percent beyond what they saw.
        """
        for share in np.linspace(1.0, 0.0, 25):
            tried = self.straight + share * (x - self.straight)
            use = self.problem.motion(tried).limit_use(self.problem.robot)
            if max(use.values()) <= 1.0 and (self.touches(x) or not self.touches(tried)):
                return tried
        return x

    def _still(self, x: Array) -> Array:
        """x with idle joints standing still wherever that costs less.

        Smoothed friction lets a joint creep for nothing; the exact model does not.
        """
        n = self.problem.robot.num_joints
        for j in np.flatnonzero(self.problem.idle_joints):
            tried = x.copy()
            tried[j::n] = self.straight[j::n]
            if np.array_equal(tried, x):
                continue
            cost, excess = self.evaluator.evaluate(np.stack([x, tried]))
            if cost[1] < cost[0] and excess[1] <= max(excess[0], ACCEPTED):
                x = x if self.touches(tried) and not self.touches(x) else tried
        return x

    def _minimise(self, x: Array, smoothing: float, price: float, around: bool) -> Array:
        def value(y: Array) -> tuple[float, Array]:
            self.evaluations += 1
            cost, gradient = self.evaluator.descend(y, smoothing, price)
            if around and self.avoid is not None:
                e = self.evaluator
                extra, slope = self.avoid(e.curves(y))
                by_points = e.cost.basis[0].T @ slope
                cost += e.cost.weight * float(np.sum(extra))
                gradient = gradient + e.cost.weight * by_points[1:-1].ravel()
            return cost, gradient

        objective: Any = value
        solver: Any = minimize  # its stubs know no `jac=True`
        found = solver(
            objective,
            x,
            jac=True,
            method="L-BFGS-B",
            bounds=self.box,
            options={"maxiter": self.params.iterations, "maxcor": 20, "ftol": 1e-9},
        )
        return np.asarray(found.x)
