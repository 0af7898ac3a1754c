"""A station: robot with tool, obstacles, studs, cost; read from station.yaml (frozen)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.cost import Cost
from dmoc.errors import Fault, InputError
from dmoc.robot import Robot
from planning.shapes import Body
from planning.station_fingerprint import station_fingerprint
from planning.studs import Stud

__all__ = ["Station", "Stud", "available_stations", "demo_station", "load_station"]


@dataclass(frozen=True, eq=False)
class Station:
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

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

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
        raise InputError(
            Fault("stud-unknown", file=str(self.source), field="stud", value=stud_id,
                  legal=", ".join(stud.id for stud in self.studs), fix="name a stud")
        )  # fmt: skip


def load_station(path: str | Path) -> Station:
    """The station of a station.yaml (or of the folder that holds one).

    Errors: `InputError` with every fault found, each with code, file, line, field, value, legal
    range and fix.
    """
    from planning.station_build import build_station  # the builder imports the types above

    target = Path(path)
    if target.is_dir():
        target = target / "station.yaml"
    return build_station(target)


def _stations_root() -> Path:
    return Path(str(resources.files("planning"))) / "stations"


def available_stations() -> tuple[str, ...]:
    """Names that `demo_station` knows."""
    names = []
    for path in _stations_root().glob("*/station*.yaml"):
        names.append(path.parent.name + path.stem.removeprefix("station"))
    return tuple(sorted(names))


def demo_station(name: str) -> Station:
    """A station of the package: `stud_welding_a`, its 8-stud subset `stud_welding_a_8`, …"""
    for path in sorted(_stations_root().glob("*/station*.yaml")):
        if path.parent.name + path.stem.removeprefix("station") == name:
            return load_station(path)
    raise InputError(
        Fault("station-unknown", field="station", value=name,
              legal=", ".join(available_stations()), fix="use one of these names")
    )  # fmt: skip
