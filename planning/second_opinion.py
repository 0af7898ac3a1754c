"""What the other collision engines say of a station: compiled distances against coal and fcl."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dmoc.arrays import Array
from planning.alternative import StudAlternatives, weld_line
from planning.departure_line import DepartureLine
from planning.scene import ENGINES
from planning.station import Station
from planning.world import CollisionWorld

__all__ = ["DISAGREEMENT_M", "second_opinions"]

#: Engines that differ by more disagree [m].
DISAGREEMENT_M = 1e-3
CAP_M = 0.3
#: Weld poses that are compared, spread over all alternatives; and configurations drawn at random.
MOST_WELDS, RANDOM = 60, 60


def second_opinions(station: Station, studs: Sequence[StudAlternatives]) -> list[dict[str, Any]]:
    """How far every engine is from that of the station, at weld poses and random configurations.

    One entry per other engine: `engine`, `configurations`, `largest_m` (of the differences where
    both see a gap), `above_1_mm` and `touching` (one sees contact deeper than 1 mm, the other
    none): how many configurations; `worst`: pair and joint angles of the largest difference.
    Depths are not compared: an overlap has several legal ones.
    """
    rng = np.random.default_rng(0)
    robot = station.robot
    drawn = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (RANDOM, robot.num_joints))
    asked: list[tuple[Array, tuple[DepartureLine, ...]]] = [(q, ()) for q in drawn]
    welds = [(item.q_rad, weld_line(station, found.stud), found.stud.on)
             for found in studs for item in found.alternatives]  # fmt: skip
    for q, line, on in welds[:: max(1, len(welds) // MOST_WELDS)]:
        asked.append((q, (line,) if on else ()))
    own = CollisionWorld(station)
    answers = [own.distance(q, CAP_M, lines) for q, lines in asked]
    return [
        _opinion(CollisionWorld(station, engine=name), asked, answers)
        for name in ENGINES if name != own.engine
    ]  # fmt: skip


def _opinion(
    other: CollisionWorld,
    asked: Sequence[tuple[Array, tuple[DepartureLine, ...]]],
    answers: Sequence[tuple[float, tuple[str, str] | None]],
) -> dict[str, Any]:
    largest, worst, above, touching = 0.0, None, 0, 0
    for (q, lines), (ours, pair) in zip(asked, answers, strict=True):
        theirs, their_pair = other.distance(q, CAP_M, lines)
        if min(ours, theirs) <= 0.0:
            touching += bool(abs(ours - theirs) > DISAGREEMENT_M and max(ours, theirs) > 0.0)
            continue
        gap = abs(ours - theirs)
        above += gap > DISAGREEMENT_M
        if gap > largest:
            largest = gap
            named = pair or their_pair or ("", "")
            worst = {"pair": list(named), "q_rad": [float(x) for x in q]}
    return {
        "engine": other.engine, "configurations": len(asked), "largest_m": float(largest),
        "above_1_mm": int(above), "touching": touching, "worst": worst,
    }  # fmt: skip
