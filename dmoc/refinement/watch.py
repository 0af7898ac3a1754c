"""Where the curve comes nearest between the checked points: these places are watched as well.

A corner that passes between two checked points is nearer than at either; the points of an interval
alone would leave the motion millimetres short of what was asked. Places are searched anew after
every step, so that they move with the curve.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.clearance import Certificate, Clearance, Rows
from dmoc.refinement.iterate import Iterate, Points, fixed_knots
from dmoc.refinement.points import View, joined, look
from dmoc.refinement.steps import RefineRound, demanded

# Deeper than this the iterate has jumped through something: going back beats pushing out.
_SHALLOW_M = 0.01


def repaired_stage(stage: RefineRound, certificate: Certificate | None) -> RefineRound | None:
    """The next stage, which watches the nearest failing place of every interval and demands more
    there; None where nothing can be done (the failures lie between given knots).
    """
    repair = stage.repair + 1
    if certificate is None or not certificate.failures:
        # No candidate was near enough to be certified. Half-spaces may get out with a fresh trust
        # region, once; boxes cannot.
        retry = stage.method == "halfspaces" and stage.repair == 0
        return replace(stage, repair=repair) if retry else None
    fixed = fixed_knots(stage.problem)
    places: dict[int, tuple[float, float]] = {}
    for f in certificate.failures:
        if not (fixed[f.interval] and fixed[f.interval + 1]):
            place = (f.distance_m, f.fraction)
            places[f.interval] = min(places.get(f.interval, place), place)
    if not places:
        return None
    intervals = np.array(list(places))
    points = stage.base.with_extra(intervals, [fraction for _, fraction in places.values()])
    margin = stage.margin_m.copy()
    margin[intervals] += stage.params.repair_margin_m
    stage = replace(stage, base=points, margin_m=margin, points=points, repair=repair)
    return replace(stage, required_m=demanded(stage, points))


def restart(
    stage: RefineRound, before: RefineRound, iterate: Iterate, history: list[Iterate], trust: Array
) -> tuple[Iterate, Array]:
    """Where the repaired stage goes on, and its trust region.

    Half-spaces push out of a shallow violation. Out of a deep one, and with boxes always, the loop
    goes back to the latest iterate that is free at all places now watched (the seed, at worst),
    and takes smaller steps at the knots beside the new places.
    """
    params = stage.params
    added = stage.base.interval[len(before.base.interval) :]
    if stage.method == "halfspaces":
        seen = look(stage.clearance, iterate, stage.points, params.cap_m)
        if seen.phi_m.min(initial=1.0) > -_SHALLOW_M:
            return iterate, np.maximum(trust, params.repair_trust_rad)
    kept = list(history)
    while len(kept) > 1:
        seen = look(stage.clearance, kept[-1], stage.points, params.cap_m)
        if seen.phi_m.min(initial=1.0) >= params.floor_m:
            break
        kept.pop()
    if stage.method == "halfspaces":
        slower = np.maximum(trust, params.repair_trust_rad)
    else:
        slower = trust.copy()
        for knot in np.unique(added):
            slower[knot : knot + 2] *= params.shrink
    return kept[-1], slower


# Only what comes nearer than the demand and this much is of interest [m].
_NEAR_M = 0.005
# Between a checked point and the next one: so many places are predicted, and around the nearest of
# them so many more looked at on either side.
_PLACES, _FINER = 8, 4
# Nearer than this share of an interval to a checked point is that point.
_SAME = 1.0 / 256


def watching(stage: RefineRound, iterate: Iterate, view: View) -> tuple[RefineRound, View]:
    """`stage` with the places of `iterate` that come nearest, in place of those of before.

    `view` is that of `iterate` at the points of `stage`; returned is the one at the new points.
    """
    if stage.method != "halfspaces":
        return stage, view
    known = view.first(len(stage.base.interval))
    cap = stage.params.clearance_m + stage.params.spare_m + _NEAR_M
    spacing = 1.0 / len(stage.params.fractions)
    extra = nearest_places(stage.clearance, iterate, stage.base, known, cap, spacing)
    extra = _movable(extra, fixed_knots(stage.problem), spacing)
    points = stage.base.with_extra(extra.interval, extra.fraction)
    seen = look(stage.clearance, iterate, extra, stage.params.cap_m)
    return replace(stage, points=points, required_m=demanded(stage, points)), joined(known, seen)


def nearest_places(
    clearance: Clearance,
    iterate: Iterate,
    points: Points,
    view: View,
    cap_m: float,
    spacing: float,
) -> Points:
    """Where body pairs are nearest along the curve and nearer than `cap_m`, away from `points`.

    `view` is that of the points, which lie `spacing` intervals apart. Its gradients predict what
    comes near between them (distances of convex bodies under translation lie above the tangent);
    places predicted to be near are measured, and the smallest of every pair again more finely.
    """
    at = points.interval + points.fraction
    if not len(at):
        return points
    cell = spacing / _PLACES
    # A place before the first or after the last interval is none of this motion's.
    ends = float(points.interval[0]), float(np.nextafter(points.interval[-1] + 1.0, 0.0))
    places = np.clip(at[:, None] + cell * np.arange(-_PLACES, _PLACES + 1), *ends)
    moved = iterate.curve(_points(places.ravel())).reshape(*places.shape, -1)
    rows = view.rows
    moved = (moved - view.q_rad[:, None])[rows.knot]
    predicted = rows.distance_m[:, None] + np.einsum("rn,rsn->rs", rows.gradient, moved)
    near = np.unique(np.round(places[rows.knot][predicted < cap_m] / cell)) * cell
    near = np.clip(near, *ends)
    least = _smallest_of_pairs(clearance.rows(iterate.curve(_points(near)), cap_m), near, cell)
    finer = cell / _FINER * np.arange(-_FINER + 1, _FINER)
    tried = np.clip(least[:, None] + finer, *ends)
    phi = clearance.phi(iterate.curve(_points(tried.ravel()))).reshape(tried.shape)
    found = np.unique(tried[np.arange(len(least)), phi.argmin(axis=1)])
    return _points(found[np.abs(found[:, None] - at).min(axis=1, initial=np.inf) > _SAME])


def _movable(places: Points, fixed: npt.NDArray[np.bool_], least_share: float) -> Points:
    """Those places on which free knots have a share of at least `least_share`.

    Beside a given knot the curve hardly follows its other one: a demand there would be met by
    moving that knot far, at any price.
    """
    share = np.where(fixed[places.interval], 0.0, 1.0 - places.fraction)
    share += np.where(fixed[places.interval + 1], 0.0, places.fraction)
    keep = share >= least_share
    return Points(places.interval[keep], places.fraction[keep])


def _smallest_of_pairs(rows: Rows, at: Array, cell: float) -> Array:
    """Of every body pair the places whose neighbours, one cell away, are not nearer."""
    number = {pair: k for k, pair in enumerate(dict.fromkeys(rows.pair))}
    pair: npt.NDArray[np.int64] = np.array([number[name] for name in rows.pair], dtype=np.int64)
    key = pair * len(at) + rows.knot
    kept, inverse = np.unique(key, return_inverse=True)
    distance = np.full(len(kept), np.inf)
    np.minimum.at(distance, inverse, rows.distance_m)
    pair, place = np.divmod(kept, max(len(at), 1))
    beside = (pair[1:] == pair[:-1]) & (at[place[1:]] - at[place[:-1]] < 1.5 * cell)
    before = np.where(np.append(False, beside), np.append(np.inf, distance[:-1]), np.inf)
    after = np.where(np.append(beside, False), np.append(distance[1:], np.inf), np.inf)
    return np.asarray(at[place[(distance < before) & (distance <= after)]])


def _points(at: Array) -> Points:
    interval = np.floor(at).astype(np.int64)
    return Points(interval, at - interval)
