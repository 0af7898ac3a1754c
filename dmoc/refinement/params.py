"""Settings of the refinement and what it tells while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.solving.solvers import DEFAULT_SOLVER, SolveParams

Method = Literal["halfspaces", "boxes", "none"]

# What `Motion.method` says of a motion of each.
METHOD_NAMES: dict[Method, str] = {"halfspaces": "half-spaces", "boxes": "boxes", "none": "free"}


def method_named(name: str) -> Method:
    """The method that a person calls `half-spaces` or `boxes`; its name in Python does too."""
    for method, spoken in METHOD_NAMES.items():
        if method != "none" and name in (method, spoken):
            return method
    raise ProblemError.of(
        "method", field="method", value=name, legal="half-spaces, boxes", fix="leave it out"
    )


@dataclass(frozen=True)
class RefineParams:
    """Settings of `refine`.

    Clearance: `clearance_m` is the paper's d_c, wanted at every checked point; half-spaces aim
    `spare_m` higher, so that the certificate can prove d_c; an iterate is accepted from `floor_m`
    on; pairs further than `cap_m` are not looked at; `push_out_m` is the most that one outer
    iteration may demand from a point that violates.
    Points: `fractions` λ of every interval are checked (only 0 is the paper's knot-only form);
    `rows_per_point` half-spaces are kept at each, three times as many after a violation.
    Outer iterations: at most `max_outer` (`max_outer_repair` after a repair), until J changes by
    less than `stop_fraction`, and then at most `max_outer_short` more while half-spaces still fall
    short of d_c and come nearer to it; trust region `trust_rad` per knot, times `trust_growth` on
    acceptance, at most `trust_most_rad`; after a step that is neither cheaper nor freer, times
    `shrink_dearer`.
    On a violation the offending knots shrink to `shrink` times their step (neighbours to
    `shrink_beside`), at most `max_backtracks` times an outer iteration.
    Repair: up to `repair_rounds`, each with `repair_margin_m` more at the places that the
    certificate named and a trust region of at least `repair_trust_rad`.
    `loose` and `tight` are the solver's settings before and in the last solve; the last solve is
    left out where `always_tight` is false and the loose one already leaves a defect of at most
    `largest_defect` of h·u_max.
    """

    clearance_m: float = 0.02
    spare_m: float = 0.001
    floor_m: float = 0.002
    cap_m: float = 0.2
    push_out_m: float = 0.03
    fractions: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75)
    rows_per_point: int = 4
    max_outer: int = 40
    max_outer_repair: int = 12
    max_outer_short: int = 3
    stop_fraction: float = 0.003
    trust_rad: float = 0.3
    trust_growth: float = 1.6
    trust_most_rad: float = 1.5
    shrink: float = 0.35
    shrink_beside: float = 0.6
    shrink_dearer: float = 0.3
    max_backtracks: int = 6
    repair_rounds: int = 6
    repair_margin_m: float = 0.01
    repair_trust_rad: float = 0.15
    loose: SolveParams = field(
        default_factory=lambda: SolveParams(
            tolerance=1e-5,
            acceptable_tolerance=1e-3,
            acceptable_iterations=15,
            max_iterations=60,
            curve_corrections=0,
            solver=DEFAULT_SOLVER,
        )
    )
    tight: SolveParams = field(
        default_factory=lambda: SolveParams(tolerance=1e-8, solver=DEFAULT_SOLVER)
    )

    always_tight: bool = True
    largest_defect: float = 1e-6

    @classmethod
    def screening(cls, **changes: Any) -> RefineParams:
        """Settings that stop at 1 %, for edges that only have to be ranked."""
        settings = cls(stop_fraction=0.01, always_tight=False, max_outer_short=0)
        return replace(settings, **changes)

    @classmethod
    def paper(cls, **changes: Any) -> RefineParams:
        """The published form of the boxes: knots only, stop at 0.1 %, no repair."""
        settings = cls(stop_fraction=1e-3, fractions=(0.0,), repair_rounds=0, max_outer=200)
        return replace(settings, **changes)

    def by(self, solver: str) -> RefineParams:
        """These settings with all solves by `solver`."""
        return self.replace(
            loose=replace(self.loose, solver=solver), tight=replace(self.tight, solver=solver)
        )

    def replace(self, **changes: Any) -> RefineParams:
        """These settings with some fields changed."""
        return replace(self, **changes)


@dataclass(frozen=True)
class RefineRecord:
    """One solve of the loop, for figures and tests.

    `outer` counts accepted iterations so far; `q_rad` (N+1, n) is the candidate, `lower_rad` and
    `upper_rad` its box; `rows` the number of half-spaces; `least_phi_m` the smallest distance at
    the checked points; `backtracks` the shrinks so far in this outer iteration.
    """

    outer: int
    accepted: bool
    cost: float
    step_s: float
    q_rad: Array
    velocity_rad_s: Array
    lower_rad: Array
    upper_rad: Array
    rows: int
    least_phi_m: float
    backtracks: int
    repair: int
    solver_iterations: int


Trace = Callable[[RefineRecord], None]
