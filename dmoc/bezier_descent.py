"""Gradient descent over Bézier control points: L-BFGS-B with exact gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from dmoc.arrays import Array
from dmoc.bezier_problem import BezierProblem, BezierResult, Evaluator, metric_values
from dmoc.bezier_swarm import Forbidden

__all__ = ["Avoid", "DescentParams", "descend_bezier"]

#: Extra cost rate (K,) of sampled configurations q (K, n) and its gradient (K, n): near obstacles.
Avoid = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class DescentParams:
    """`starts` runs: the straight line, then random ones within `spread_rad` of it.

    Each run goes through the `smoothing_rad_s` of the kinks in turn with at most `iterations`
    steps; the price of limit excess is raised by `price_factor` up to `price_rounds` times while a
    limit is broken.
    """

    starts: int = 3
    iterations: int = 80
    smoothing_rad_s: tuple[float, ...] = (0.05, 0.01)
    spread_rad: float = 0.6
    price: float = 100.0
    price_factor: float = 30.0
    price_rounds: int = 3


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
    end ranges as bounds. A run whose curve `forbidden` says touches something is repeated from
    where it ended with the extra cost of `avoid`, if there is one. The best legal run is returned.
    """
    rng = np.random.default_rng([seed, 2])
    lower, upper = problem.bounds
    search = _Search(problem, params, forbidden, avoid, lower, upper)
    n = problem.robot.num_joints
    best: tuple[bool, float, Array] | None = None
    history = []
    for k in range(params.starts):
        x = problem.straight if start is None or k > 0 else np.asarray(start, dtype=float)
        if k > 0:
            offset = params.spread_rad * (2.0 * rng.random((5, n)) - 1.0)
            offset[[0, 4]] = 0.0
            x = x + offset.ravel()
        legal, value, x = search.run(np.clip(x, lower, upper))
        if best is None or (legal, -value) > (best[0], -best[1]):
            best = (legal, value, x)
        history.append(best[1] if best[0] else np.inf)
    assert best is not None
    motion = problem.motion(best[2])
    limits = motion.limit_use(problem.robot)
    return BezierResult(
        motion=motion,
        value=metric_values(motion, problem.robot, (problem.metric,))[problem.metric],
        feasible=best[0] and max(limits.values()) <= 1.0,
        limits=limits,
        evaluations=search.evaluations,
        gradients=search.evaluations,
        history=np.array(history),
        note="" if best[0] else "no start led to a legal motion",
    )


class _Search:
    def __init__(
        self, problem: BezierProblem, params: DescentParams, forbidden: Forbidden | None,
        avoid: Avoid | None, lower: Array, upper: Array,
    ) -> None:  # fmt: skip
        self.evaluator = Evaluator(problem)
        self.params, self.forbidden, self.avoid = params, forbidden, avoid
        self.box = np.stack([lower, upper], axis=1)
        self.evaluations = 0

    def run(self, x: Array) -> tuple[bool, float, Array]:
        """One start: continuation in smoothing, then in the price of limits, then around things."""
        x = self._within_limits(x, self.params.smoothing_rad_s, False)
        if self._touches(x) and self.avoid is not None:
            x = self._within_limits(x, self.params.smoothing_rad_s[-1:], True)
        cost, excess = self.evaluator.evaluate(x[None])
        legal = bool(excess[0] <= 0.5 * (1.0 - 0.99)) and not self._touches(x)
        return legal, float(cost[0]), x

    def _touches(self, x: Array) -> bool:
        if self.forbidden is None:
            return False
        return bool(self.forbidden(self.evaluator.curves(x[None]))[0])

    def _within_limits(self, x: Array, smoothing: tuple[float, ...], around: bool) -> Array:
        price = self.params.price
        for level in smoothing:
            x = self._minimise(x, level, price, around)
        for _ in range(self.params.price_rounds):
            if self.evaluator.evaluate(x[None]).excess[0] <= 0.25 * (1.0 - 0.99):
                break
            price *= self.params.price_factor
            x = self._minimise(x, smoothing[-1], price, around)
        return x

    def _minimise(self, x: Array, smoothing: float, price: float, around: bool) -> Array:
        def value(y: Array) -> tuple[float, Array]:
            self.evaluations += 1
            cost, gradient = self.evaluator.descend(y, smoothing, price)
            if around and self.avoid is not None:
                e = self.evaluator
                extra, slope = self.avoid(e.curves(y))
                by_points = e.basis[0].T @ slope
                cost += e.weight * float(np.sum(extra))
                gradient = gradient + e.weight * by_points[1:-1].ravel()
            return cost, gradient

        objective: Any = value
        found = minimize(
            objective, x, jac=True, method="L-BFGS-B", bounds=self.box,
            options={"maxiter": self.params.iterations, "maxcor": 20, "ftol": 1e-9},
        )  # fmt: skip
        return np.asarray(found.x)
