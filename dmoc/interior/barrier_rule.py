"""How the barrier parameter μ is chosen: by a probing step while that helps, else monotonically.

Source: Nocedal, Wächter and Waltz (2009); the probing rule is Mehrotra's, μ = σ·(mean z·slack) with
σ = (mean after the affine step / mean now)³.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

SMALLEST_MU = 1e-11
# Least μ per tolerance: smaller would only make the condensed system stiff, z²/μ on its diagonal.
_SHARE_OF_TOLERANCE = 1e-4
# The probe may ask for more centring than there is now, but not without end.
_LARGEST_SIGMA = 100.0
_LARGEST_FACTOR = 1e3  # of the first mean product: the most that μ may become
_MARGIN = 1e-5  # of progress in objective or violation, so that ties do not count for ever
# The monotone rule of Wächter and Biegler (2006), (7): a barrier problem solved to ten times μ is
# solved well enough, and the next μ falls at first by a factor, near the end faster than linearly.
_SOLVED_FACTOR = 10.0
_LINEAR, _POWER = 0.2, 1.5
_FIXED_SHARE = 0.8  # of the mean product, when the probing rule is left


@dataclass
class BarrierRule:
    """μ of one solve between `least` and `largest`; `free` while the probing rule holds.

    `pairs` are those (objective, Σ|defect|) of accepted points that no later one may exceed in
    both while the rule holds.
    """

    least: float = SMALLEST_MU
    free: bool = True
    mu: float = 0.0
    largest: float = 0.0
    pairs: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def for_tolerance(cls, tolerance: float) -> BarrierRule:
        """The rule of a solve to `tolerance`."""
        return cls(max(SMALLEST_MU, _SHARE_OF_TOLERANCE * tolerance))

    def choose(
        self,
        objective: float,
        theta: float,
        mean_product: float,
        error_at: Callable[[float], float],
        mean_after: Callable[[], float],
    ) -> bool:
        """Set `mu` for the next step; whether it is another one.

        `error_at(μ)` is the error of the barrier problem, `mean_after()` the mean z·slack after the
        affine step.
        """
        if self.largest == 0.0:
            self.largest = _LARGEST_FACTOR * max(mean_product, self.least)
        # The probing rule has no proof of its own; this watch on its progress gives one.
        progress = all(objective <= f or theta <= t for f, t in self.pairs)
        if progress:
            margin = _MARGIN * min(1.0, theta)
            self.pairs.append((objective - margin, theta - margin))
            self.free = True
        elif self.free:
            self.fix(mean_product)
            return True
        if self.free:
            sigma = min((mean_after() / mean_product) ** 3, _LARGEST_SIGMA) if mean_product else 1.0
            # A larger least μ far from an optimum was tried: near flat ones it never ends.
            self.mu = min(max(sigma * mean_product, self.least), self.largest)
            return True
        changed = False
        while self.mu > self.least and error_at(self.mu) <= _SOLVED_FACTOR * self.mu:
            self.mu = max(self.least, min(_LINEAR * self.mu, self.mu**_POWER))
            changed = True
        return changed

    def fix(self, mean_product: float) -> None:
        """Leave the probing rule."""
        self.free = False
        self.mu = min(max(_FIXED_SHARE * mean_product, self.least), self.largest)
