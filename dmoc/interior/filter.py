"""Which trial points a line search accepts: a filter of violation θ and barrier objective φ.

Source: Wächter and Biegler (2006), section 2.3, with their constants.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

# Enough progress, their (18): θ falls by this share, or φ by this share of θ. Without the margins
# points could creep towards a corner of the filter that is no solution.
_GAMMA_THETA = 1e-5
_GAMMA_PHI = 1e-8
# The switching condition, (19): α |φ'|^2.3 > θ^1.1. Where the step promises more of the objective
# than there is violation left, only descent of φ may be accepted; else feasible points could be
# traded for ever better feasibility and the search end at one that is not optimal.
_POWER_THETA = 1.1
_POWER_PHI = 2.3
_ARMIJO = 1e-8  # that descent, (20)
_SAFETY = 0.05  # of the shortest step, (23)
# Relative to the first violation: beyond the one nothing is accepted, above the other the
# objective has no say yet.
_LARGEST_THETA = 1e4
_SMALL_THETA = 1e-4
# Differences of φ below this share of it are rounding.
_ROUNDING = 10 * 2.220446049250313e-16


@dataclass(frozen=True)
class Merit:
    """Violation θ = Σ|rows| and φ = f − μ Σ log(slack) of a point; `rate` is dφ along the step."""

    theta: float
    phi: float
    rate: float = 0.0


@dataclass
class Filter:
    """Pairs (θ, φ) that no accepted point may be worse than in both."""

    first_theta: float
    pairs: list[tuple[float, float]] = field(default_factory=list)

    def clear(self) -> None:
        """Forget all pairs: φ of another μ is not comparable."""
        self.pairs = []

    def accepts(self, start: Merit, trial: Merit, step: float) -> bool:
        """Whether `trial`, reached with `step`, may follow `start`."""
        largest = _LARGEST_THETA * max(1.0, self.first_theta)
        if not (math.isfinite(trial.theta) and math.isfinite(trial.phi)) or trial.theta > largest:
            return False
        if self._by_objective(start, step):
            enough = self._armijo(start, trial, step)
        else:
            enough = trial.theta <= (1 - _GAMMA_THETA) * start.theta or _no_more(
                trial.phi - start.phi, -_GAMMA_PHI * start.theta, start.phi
            )
        return enough and all(
            trial.theta <= theta or _no_more(trial.phi, phi, phi) for theta, phi in self.pairs
        )

    def remember(self, start: Merit, trial: Merit, step: float) -> None:
        """Add `start` after an accepted step, unless the step was one of descent."""
        descent = self._switches(start, step) and self._armijo(start, trial, step)
        if not descent:
            self.pairs.append(
                ((1 - _GAMMA_THETA) * start.theta, start.phi - _GAMMA_PHI * start.theta)
            )

    def shortest_step(self, start: Merit) -> float:
        """Below it the search has failed."""
        least = _GAMMA_THETA
        if start.rate < 0:
            least = min(least, -_GAMMA_PHI * start.theta / start.rate)
            if start.theta <= self._small():
                least = min(least, start.theta**_POWER_THETA / (-start.rate) ** _POWER_PHI)
        return _SAFETY * least

    def _small(self) -> float:
        return _SMALL_THETA * max(1.0, self.first_theta)

    def _by_objective(self, start: Merit, step: float) -> bool:
        return start.theta <= self._small() and self._switches(start, step)

    def _switches(self, start: Merit, step: float) -> bool:
        return start.rate < 0 and step * (-start.rate) ** _POWER_PHI > start.theta**_POWER_THETA

    def _armijo(self, start: Merit, trial: Merit, step: float) -> bool:
        return _no_more(trial.phi - start.phi, _ARMIJO * step * start.rate, start.phi)


def _no_more(value: float, bound: float, size: float) -> bool:
    """value ≤ bound up to the rounding of numbers of `size`."""
    return value - bound <= _ROUNDING * abs(size)
