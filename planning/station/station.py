"""A station: robot with tool, obstacles, studs, cost; read from station.yaml (frozen)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.arrays import Array, StaysReadonly
from dmoc.errors import InputError
from dmoc.motion.cost import Cost
from dmoc.robot.robot import Robot
from planning.geometry.mesh import shape_fingerprint
from planning.geometry.shapes import Body
from planning.station.studs import Stud


def station_fingerprint(station: Station) -> str:
    """sha256 of everything in a station that changes a motion or an alternative."""
    digest = hashlib.sha256()

    def add(*values: Any) -> None:
        for value in values:
            if isinstance(value, np.ndarray):
                digest.update(str(value.shape).encode())
                digest.update(np.ascontiguousarray(value).tobytes())
            else:
                digest.update(repr(value).encode())
            digest.update(b"|")

    add(station.robot.fingerprint, shape_fingerprint(station.robot), station.robot.flange)
    for body in (*station.tool_bodies, *station.obstacles):
        add(body.name, body.pose, body.touches)
        for shape in (*body.shapes, *((body.mesh,) if body.mesh else ())):
            add(shape.kind, shape.size_m, shape.pose, shape.vertices_m, shape.faces)
    for stud in station.studs:
        add(
            stud.id,
            stud.position_m,
            stud.normal,
            stud.weld_time_s,
            stud.depart_direction,
            stud.depart_m,
            stud.spin_free,
            stud.on,
        )
        if stud.spin_rad is not None:
            add(stud.spin_rad)
    cost = station.cost
    add(
        station.spin_steps,
        station.home_rad,
        station.clearance_m,
        station.stray_m,
        cost.time,
        cost.effort,
        cost.velocity,
        station.precedence,
        station.allowed_collisions,
        station.engine,
    )
    return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class Station(StaysReadonly):
    """What exists in one station, in world axes [m, rad, s].

    `robot` has tool inertia, payload and base applied. `tool_bodies` are posed in the flange
    frame, the one with `touches` meets the weld; `obstacles` in the world. `allowed_collisions`
    are the pairs that are never checked: neighbours in the chain, tool against the link that
    carries it, what stands still against what stands still, and those the files name (robot.yaml,
    station.yaml, its SRDF). `engine` measures distances in the worlds of this station.
    `stray_m`: how far the tip may stray from a departure line while tip and part may touch.
    `fingerprint` changes with anything that changes a motion or an alternative; stations of equal
    fingerprint are equal.
    """

    name: str
    robot: Robot
    tool_bodies: tuple[Body, ...]
    obstacles: tuple[Body, ...]
    studs: tuple[Stud, ...]
    spin_steps: int
    home_rad: Array | None
    clearance_m: float
    cost: Cost
    precedence: tuple[tuple[str, str], ...]
    allowed_collisions: tuple[tuple[str, str], ...]
    source: Path
    fingerprint: str
    stray_m: float = 0.005
    engine: str = "native"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Station) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)

    def replace(self, **changes: Any) -> Station:
        """This station with other fields (nothing is checked) and the fingerprint they make.

        With another robot or other bodies, `allowed_collisions` stays the one of the old.
        """
        changed = replace(self, **changes)
        object.__setattr__(changed, "fingerprint", station_fingerprint(changed))
        return changed

    def stud(self, stud_id: str) -> Stud:
        """The stud of that id; `InputError` if there is none."""
        for stud in self.studs:
            if stud.id == stud_id:
                return stud
        raise InputError.of(
            "stud-unknown",
            file=str(self.source),
            field="stud",
            value=stud_id,
            legal=", ".join(stud.id for stud in self.studs),
            fix="name a stud",
        )
