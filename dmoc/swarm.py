"""Particle swarm in a box, with walls: seeded, vectorised, knows nothing of robots.

Velocity and position of particle p (w inertia, c_1 cognitive, c_2 social, r uniform in [0, 1]):

    v <- w v + c_1 r_1 (best_p - x) + c_2 r_2 (best - x),   x <- x + v

Walls as in Robinson and Rahmat-Samii (2004), IEEE Trans. Antennas Propag. 52, 397-407: at an
*invisible* wall a particle flies on and is simply not evaluated until it returns; an *absorbing*
wall stops it on the wall; a *reflecting* wall turns its velocity round. A value of +inf marks a
forbidden point inside the box (a collision, say): behind invisible walls the particle flies
through it, which is what lets a swarm reach the far side of a split solution space; the other
two put it back where it came from, stopped or turned round.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dmoc.errors import Fault, ProblemError

Wall = Literal["invisible", "absorbing", "reflecting"]


@dataclass(frozen=True)
class SwarmParams:
    """Size, stopping rule and weights; the weights are Clerc and Kennedy's constriction."""

    particles: int = 24
    iterations: int = 60
    inertia: float = 0.7298
    cognitive: float = 1.49618
    social: float = 1.49618
    max_step: float | tuple[float, ...] = 0.5  # largest |v| as a fraction of the box, per axis
    wall: Wall = "invisible"

    def __post_init__(self) -> None:
        faults = []
        if self.particles < 1 or self.iterations < 1:
            value = f"{self.particles}, {self.iterations}"
            faults.append(Fault("swarm-size", "", "particles, iterations", value, ">= 1"))
        if self.wall not in ("invisible", "absorbing", "reflecting"):
            legal = "invisible | absorbing | reflecting"
            faults.append(Fault("swarm-wall", "", "wall", str(self.wall), legal))
        if not np.all(np.asarray(self.max_step) > 0):
            faults.append(Fault("swarm-step", "", "max_step", str(self.max_step), "> 0"))
        if faults:
            raise ProblemError(faults)


@dataclass(frozen=True)
class SwarmResult:
    """Best point `x` (d,), its value (inf: nothing allowed was found), cost of finding it.

    `history` (iterations,) is the best value after each iteration.
    """

    x: np.ndarray
    value: float
    evaluations: int
    history: np.ndarray


class Swarm:
    """Ask/tell state of one swarm: for objectives that come from outside, a real robot included.

    `lower`, `upper` (d,) bound the box; `start` (k, d) places the first k particles, the others
    are uniform in the box. `start_velocity` (particles, d) is what they begin with, at random if
    None; `max_velocity` (d,) bounds |v| in the units of the box instead of `params.max_step`.
    `seed` may be a generator to go on with. Use `ask()` -> points (m, d), evaluate them,
    `tell(values)` (m,).
    """

    def __init__(
        self,
        lower: np.ndarray,
        upper: np.ndarray,
        seed: int | np.random.Generator,
        params: SwarmParams = SwarmParams(),
        start: np.ndarray | None = None,
        start_velocity: np.ndarray | None = None,
        max_velocity: np.ndarray | None = None,
    ) -> None:
        self.lower = np.asarray(lower, dtype=float)
        self.upper = np.asarray(upper, dtype=float)
        if self.lower.ndim != 1 or self.lower.shape != self.upper.shape:
            legal = "two vectors of one length"
            value = f"{self.lower.shape}, {self.upper.shape}"
            raise ProblemError.of("swarm-box", "", "lower, upper", value, legal)
        if not (self.lower <= self.upper).all():
            raise ProblemError.of(
                "swarm-box", "", "lower, upper", "lower > upper", "lower <= upper"
            )
        self.params = params
        self._rng = np.random.default_rng(seed)
        shape = (params.particles, self.lower.size)
        span = self.upper - self.lower
        given = np.empty((0, span.size))
        if start is not None:
            given = _rows(start, "start", span.size)[: params.particles]
        if len(given) < params.particles:
            self._x = self.lower + span * self._rng.random(shape)
        else:
            self._x = np.empty(shape)
        self._x[: len(given)] = np.clip(given, self.lower, self.upper)
        self._limit = self._limits(span, max_velocity)
        if start_velocity is None:
            self._v = 0.25 * span * (2.0 * self._rng.random(shape) - 1.0)
        else:
            self._v = _rows(start_velocity, "start_velocity", span.size).copy()
            if self._v.shape != shape:
                legal = f"{shape}, a row for each particle"
                raise ProblemError.of(
                    "swarm-start", "", "start_velocity", str(self._v.shape), legal
                )
        self._before = self._x.copy()
        self._own_x = self._x.copy()
        self._own_value = np.full(params.particles, np.inf)
        self._asked: np.ndarray | None = None
        self.best_x = self._x[0].copy()
        self.best_value = np.inf
        self.evaluations = 0

    def _limits(self, span: np.ndarray, max_velocity: np.ndarray | None) -> np.ndarray:
        """Largest |v| of every coordinate (d,)."""
        if max_velocity is None:
            step = np.asarray(self.params.max_step, dtype=float)
            if step.ndim and step.shape != span.shape:
                legal = f"one number or {span.size}"
                raise ProblemError.of("swarm-step", "", "max_step", str(step.shape), legal)
            return np.asarray(step * span)
        limit = np.asarray(max_velocity, dtype=float)
        if limit.shape != span.shape or not (limit >= 0).all():
            legal = f"{span.size} numbers >= 0"
            raise ProblemError.of("swarm-step", "", "max_velocity", str(limit), legal)
        return limit

    def promising(self, values: np.ndarray) -> np.ndarray:
        """Which of the points of the last `ask` would improve on their particle's best (m,)."""
        if self._asked is None:
            raise ProblemError.of(
                "swarm-order", "", "promising", "no ask before", "ask, then promising"
            )
        return np.asarray(np.asarray(values, dtype=float) < self._own_value[self._asked])

    def ask(self) -> np.ndarray:
        """Points (m, d) inside the box to be evaluated now; m <= particles, m may be 0."""
        inside = ((self._x >= self.lower) & (self._x <= self.upper)).all(axis=1)
        self._asked = np.flatnonzero(inside)
        return self._x[self._asked].copy()

    def tell(self, values: np.ndarray) -> None:
        """Values (m,) of the points of the last `ask`, +inf for forbidden; then everybody moves."""
        if self._asked is None:
            raise ProblemError.of("swarm-order", "", "tell", "no ask before", "ask, then tell")
        found = np.full(self.params.particles, np.inf)
        told = np.asarray(values, dtype=float)
        if told.shape != self._asked.shape or np.isnan(told).any():
            legal = f"{self._asked.size} numbers or +inf"
            raise ProblemError.of("swarm-values", "", "values", str(told.shape), legal)
        found[self._asked] = told
        self.evaluations += int(told.size)
        better = found < self._own_value
        self._own_value[better] = found[better]
        self._own_x[better] = self._x[better]
        leader = int(np.argmin(self._own_value))
        if self._own_value[leader] < self.best_value:
            self.best_value = float(self._own_value[leader])
            self.best_x = self._own_x[leader].copy()
        if self.params.wall != "invisible":
            self._leave_forbidden(~np.isfinite(found))
        self._asked = None
        self._move()

    def _leave_forbidden(self, forbidden: np.ndarray) -> None:
        self._x[forbidden] = self._before[forbidden]
        self._v[forbidden] *= 0.0 if self.params.wall == "absorbing" else -1.0

    def _move(self) -> None:
        p = self.params
        shape = self._x.shape
        self._before = self._x.copy()
        pull = p.cognitive * self._rng.random(shape) * (self._own_x - self._x)
        # Nobody has found an allowed point yet: there is nothing to be drawn to but oneself.
        if np.isfinite(self.best_value):
            pull += p.social * self._rng.random(shape) * (self.best_x - self._x)
        self._v = np.clip(p.inertia * self._v + pull, -self._limit, self._limit)
        self._x = self._x + self._v
        if p.wall == "invisible":
            return
        below, above = self._x < self.lower, self._x > self.upper
        if p.wall == "absorbing":
            self._v[below | above] = 0.0
        else:
            self._x = np.where(below, 2 * self.lower - self._x, self._x)
            self._x = np.where(above, 2 * self.upper - self._x, self._x)
            self._v[below | above] *= -1.0
        self._x = np.clip(self._x, self.lower, self.upper)


def _rows(values: np.ndarray, name: str, size: int) -> np.ndarray:
    """Finite rows (k, size)."""
    rows = np.atleast_2d(np.asarray(values, dtype=float))
    if rows.ndim != 2 or rows.shape[1] != size or not np.isfinite(rows).all():
        legal = f"(k, {size}), finite"
        raise ProblemError.of("swarm-start", "", name, str(rows.shape), legal)
    return rows


def minimise(
    objective: Callable[[np.ndarray], np.ndarray],
    lower: np.ndarray,
    upper: np.ndarray,
    seed: int,
    params: SwarmParams = SwarmParams(),
    start: np.ndarray | None = None,
) -> SwarmResult:
    """Minimise `objective`: points (m, d) -> values (m,), +inf where forbidden.

    Runs `params.iterations` rounds of the swarm and nothing else: same seed, same result.
    `start` as in `Swarm`. If every point met was forbidden, `value` is inf.
    """
    swarm = Swarm(lower, upper, seed, params, start)
    history = np.empty(params.iterations)
    for k in range(params.iterations):
        points = swarm.ask()
        swarm.tell(objective(points) if len(points) else np.empty(0))
        history[k] = swarm.best_value
    return SwarmResult(swarm.best_x, swarm.best_value, swarm.evaluations, history)
