"""After a failed certificate: watch the places it named, and start again from a free iterate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmoc.arrays import Array
from dmoc.clearance import Certificate
from dmoc.refinement.iterate import Iterate, fixed_knots
from dmoc.refinement.points import look
from dmoc.refinement.steps import Stage, demanded

__all__ = ["repaired_stage", "restart"]

# Deeper than this the iterate has jumped through something: going back beats pushing out.
_SHALLOW_M = 0.01


def repaired_stage(stage: Stage, certificate: Certificate | None) -> Stage | None:
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
    stage: Stage, before: Stage, iterate: Iterate, history: list[Iterate], trust: Array
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
