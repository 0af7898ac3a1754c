"""Where the refinement looks, what it demands there, and what it sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.clearance import Clearance, Rows
from dmoc.motion.motion import MotionProblem
from dmoc.refinement.iterate import Iterate, Points, fixed_knots

# Share of a fixed end's clearance that the points beside it must keep.
_END_SHARE = 0.9


@dataclass(frozen=True)
class View:
    """Distances at the checked points of one iterate: `phi` (P,) and the pairs behind it."""

    q_rad: Array
    chord_rad: Array
    phi_m: Array
    rows: Rows

    def first(self, count: int) -> View:
        """The view of the first `count` points."""
        keep = np.flatnonzero(self.rows.knot < count)
        return View(
            self.q_rad[:count],
            self.chord_rad[:count],
            self.phi_m[:count],
            Rows(
                self.rows.knot[keep],
                self.rows.distance_m[keep],
                self.rows.gradient[keep],
                tuple(self.rows.pair[k] for k in keep),
            ),
        )


def joined(view: View, other: View) -> View:
    """The view of the points of both, those of `view` first."""
    a, b = view.rows, other.rows
    return View(
        np.concatenate([view.q_rad, other.q_rad]),
        np.concatenate([view.chord_rad, other.chord_rad]),
        np.concatenate([view.phi_m, other.phi_m]),
        Rows(
            np.concatenate([a.knot, b.knot + len(view.phi_m)]),
            np.concatenate([a.distance_m, b.distance_m]),
            np.concatenate([a.gradient, b.gradient]),
            a.pair + b.pair,
        ),
    )


def points_of(problem: MotionProblem, fractions: tuple[float, ...]) -> Points:
    """λ ∈ `fractions` of every interval that has a free end (λ = 0 only at free knots)."""
    fixed = fixed_knots(problem)
    interval = np.repeat(np.arange(problem.num_intervals), len(fractions))
    fraction = np.tile(np.asarray(fractions, dtype=float), problem.num_intervals)
    at_fixed = (fixed[interval] & (fraction == 0.0)) | (fixed[interval + 1] & (fraction == 1.0))
    keep = ~(fixed[interval] & fixed[interval + 1]) & ~at_fixed
    return Points(interval[keep].astype(np.int64), fraction[keep])


def look(clearance: Clearance, iterate: Iterate, points: Points, cap_m: float) -> View:
    """Distances and their gradients on the interpolant of `iterate`."""
    q = iterate.curve(points)
    rows = clearance.rows(q, cap_m)
    phi = np.full(len(q), cap_m)
    np.minimum.at(phi, rows.knot, rows.distance_m)
    return View(q, iterate.chord(points), phi, rows)


def required_clearance(
    clearance: Clearance,
    problem: MotionProblem,
    points: Points,
    clearance_m: float,
    spare_m: float = 0.0,
) -> Array:
    """d_c and `spare_m` at every point (P,), less beside a fixed knot that is itself nearer.

    In the interval between a fixed knot of distance φ_f and a free one, the demand rises linearly
    from 0.9 φ_f to that.
    """
    fixed = fixed_knots(problem)
    aimed = clearance_m + spare_m
    required = np.full(len(points.interval), aimed)
    first = int(np.flatnonzero(fixed[:-1] & ~fixed[1:])[0]) if (~fixed).any() else 0
    last = int(np.flatnonzero(~fixed[:-1] & fixed[1:])[0]) + 1 if (~fixed).any() else 0
    ends = np.vstack([_fixed_knot(problem, first), _fixed_knot(problem, last)])
    for phi, beside, away in zip(
        clearance.phi(ends), (first, last - 1), (points.fraction, 1 - points.fraction)
    ):
        ramp = np.minimum(aimed, _END_SHARE * phi + away * clearance_m)
        required = np.where(points.interval == beside, np.minimum(required, ramp), required)
    return required


def _fixed_knot(problem: MotionProblem, knot: int) -> Array:
    num = problem.num_intervals
    if knot == 0:
        return problem.start_rad
    if knot == num:
        return problem.goal_rad
    if problem.depart_rad is not None and knot <= len(problem.depart_rad):
        return problem.depart_rad[knot - 1]
    assert problem.arrive_rad is not None
    return problem.arrive_rad[knot - (num - len(problem.arrive_rad))]


def knots_of(
    points: Points, offending: npt.NDArray[np.bool_], num_knots: int
) -> npt.NDArray[np.bool_]:
    """Which knots (N+1,) carry an offending point: both ends of its interval, or its own knot."""
    hit = np.zeros(num_knots, dtype=bool)
    hit[points.interval[offending]] = True
    inner = offending & (points.fraction > 0)
    hit[points.interval[inner] + 1] = True
    return hit
