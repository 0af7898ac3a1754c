"""What the lazy loop is told and what it reports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from dmoc.errors import ProblemError
from sequencing.gtsp.problem import Tour

Status = Literal["proven", "gap", "evaluation_limit", "round_limit", "no_tour", "open"]
Phase = Literal["estimate", "refute", "certify"]


@dataclass(frozen=True)
class LazyStop:
    """When the loop ends (always at a proof).

    gap          relative gap at which a tour is good enough.
    kind         'strict': against the proven lower bound; 'conditional': against the conditional.
    evaluations  most evaluations of this call (costs given as `known` do not count).
    rounds       most batches of this call.
    """

    gap: float = 0.0
    kind: Literal["strict", "conditional"] = "strict"
    evaluations: int | None = None
    rounds: int | None = None

    def __post_init__(self) -> None:
        if not self.gap >= 0 or self.kind not in ("strict", "conditional"):
            raise ProblemError.of(
                "lazy-stop",
                field="gap, kind",
                value=f"{self.gap}, {self.kind!r}",
                legal="gap ≥ 0; kind 'strict' or 'conditional'",
            )


@dataclass(frozen=True)
class LazyRound:
    """State after one batch.

    upper_bound        cost of the best tour that is evaluated throughout (inf: none yet).
    lower_bound        proven; −inf while nothing is proven.
    conditional_bound  proven on the condition named above; −inf while nothing is.
    minimum            cheapest tour found under this round's mixed costs; no bound.
    evaluations        of this call so far; `batch`: in this round.
    """

    index: int
    phase: Phase
    upper_bound: float
    lower_bound: float
    conditional_bound: float
    minimum: float
    evaluations: int
    batch: int

    @property
    def gap(self) -> float:
        """(upper − lower) / |upper|, proven; inf while nothing is proven."""
        return relative_gap(self.upper_bound, self.lower_bound)

    @property
    def conditional_gap(self) -> float:
        """The same against the conditional bound."""
        return relative_gap(self.upper_bound, self.conditional_bound)


@dataclass(frozen=True)
class LazyResult:
    """`tour` is evaluated throughout; its `lower_bound` and `proven` are strict.

    status      proven | gap (target reached) | evaluation_limit | round_limit | no_tour (proven
                only if tour.proven) | open (the exact solver met its limit before a proof).
    known       every evaluated travel: give it back as `known` to resume.
    violations  evaluated travels that cost less than their bound; if there are any, the bounds
                are not strict, whatever was said, and nothing is called proven.
    calibration median of true cost over estimate.
    """

    tour: Tour
    status: Status
    conditional_bound: float
    rounds: tuple[LazyRound, ...]
    evaluations: int
    violations: int
    calibration: float
    known: Mapping[tuple[int, int], float] = field(repr=False)

    @property
    def conditional_gap(self) -> float:
        return relative_gap(self.tour.cost, self.conditional_bound)


def relative_gap(upper: float, lower: float) -> float:
    """(upper − lower) / |upper|; inf where either is not finite."""
    if not math.isfinite(upper) or not math.isfinite(lower):
        return math.inf
    return max(0.0, upper - lower) / max(abs(upper), 1e-300)
