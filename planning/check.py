"""`dmoc check`: what a station file holds, and what each stud can be welded with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dmoc.errors import Fault, InputError
from planning.alternatives_search import alternatives
from planning.plausible import station_warnings
from planning.second_opinion import second_opinions
from planning.station import Station, load_station
from planning.world import CollisionWorld

__all__ = ["check_home", "check_station"]


def check_station(path: str | Path, engines: bool = False) -> dict[str, Any]:
    """The object of `dmoc check --json`.

    `studs`: per stud `id`, `alternatives` (their number), `reason` (empty, or what took the
    candidates away, most frequent first), `weld_cost` [least, most] or null; besides `name`,
    `robot`, `configurations`, `clearance_m`, an empty `errors`, and `warnings`: what is legal but
    hardly meant, each like an error (code, file, field, value, legal, fix). With `engines` also
    `engines`: how far the other collision engines are from the station's
    (`planning.second_opinion`); more than 1 mm is a warning.

    Errors: `InputError` with every fault of the file, or the home pose's collision.
    """
    station = load_station(path)
    world = CollisionWorld(station)
    check_home(station, world)
    rows = []
    studs = alternatives(station, world)
    for found in studs:
        counted = sorted(found.reasons.items(), key=lambda item: (-item[1], item[0]))
        costs = [item.weld_cost for item in found.alternatives]
        rows.append({
            "id": found.stud.id,
            "alternatives": len(found.alternatives),
            "reason": "" if costs else ", ".join(f"{text} ({n})" for text, n in counted),
            "weld_cost": [min(costs), max(costs)] if costs else None,
        })  # fmt: skip
    doubts = list(station_warnings(station))
    opinions = second_opinions(station, studs) if engines else []
    doubts += [_disagreement(station, opinion) for opinion in opinions
               if opinion["above_1_mm"] or opinion["touching"]]  # fmt: skip
    return {
        "name": station.name, "robot": station.robot.name, "clearance_m": station.clearance_m,
        "configurations": sum(row["alternatives"] for row in rows), "studs": rows, "errors": [],
        "warnings": [fault.to_dict() for fault in doubts],
        **({"engines": opinions} if engines else {}),
    }  # fmt: skip


def _disagreement(station: Station, opinion: dict[str, Any]) -> Fault:
    return Fault(
        "engines-disagree", file=str(station.source), field="engine",
        value=f"{opinion['engine']} differs by up to {1e3 * opinion['largest_m']:.2f} mm; "
        f"{opinion['above_1_mm']} of {opinion['configurations']} configurations above 1 mm, "
        f"{opinion['touching']} touching for one only",
        legal="<= 1 mm", fix="look at the pair under engines.worst: a thin or badly formed piece",
    )  # fmt: skip


def check_home(station: Station, world: CollisionWorld) -> None:
    """Raise `InputError` if the home pose touches something or cannot be held."""
    if station.home_rad is None:
        return
    robot = station.robot
    torque = np.abs(robot.gravity_torque_nm(station.home_rad))
    weak = [
        Fault("home-torque", file=str(station.source), field="home_rad",
              value=f"{torque[j]:.4g} N·m to stand still on joint {j + 1}",
              legal=f"<= {robot.torque_limit_nm[j]:.4g} N·m",
              fix="check payload_kg, tool.mass_kg and tool.com_m, or choose another home pose")
        for j in np.flatnonzero(torque > robot.torque_limit_nm)
    ]  # fmt: skip
    if weak:
        raise InputError(weak)
    pair = world.collide(station.home_rad, station.clearance_m)
    if pair is not None:
        raise InputError(
            Fault("home-collision", file=str(station.source), field="home_rad",
                  value=f"{pair[0]} and {pair[1]} at {np.round(station.home_rad, 4).tolist()}",
                  legal=f"a pose that keeps {station.clearance_m:g} m from everything",
                  fix="choose another home pose, or null")
        )  # fmt: skip
