"""One path in one station: geometry, kinematics, collision, planning, certificates."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planning.alternatives_search import alternatives as alternatives
    from planning.certificate import certify as certify
    from planning.check import check_station as check_station
    from planning.edge_clearance import DepartureLine as DepartureLine
    from planning.edge_motion import plan_motion as plan_motion
    from planning.roadmap import plan_path as plan_path
    from planning.station import Station as Station
    from planning.station import Stud as Stud
    from planning.station import demo_station as demo_station
    from planning.station import load_station as load_station
    from planning.world import CollisionWorld as CollisionWorld

# Loaded on first use, so that importing the package costs nothing.
_HOME = {
    "CollisionWorld": "planning.world",
    "DepartureLine": "planning.edge_clearance",
    "Station": "planning.station",
    "Stud": "planning.station",
    "alternatives": "planning.alternatives_search",
    "certify": "planning.certificate",
    "check_station": "planning.check",
    "demo_station": "planning.station",
    "load_station": "planning.station",
    "plan_motion": "planning.edge_motion",
    "plan_path": "planning.roadmap",
}

__all__ = [
    "CollisionWorld",
    "DepartureLine",
    "Station",
    "Stud",
    "alternatives",
    "certify",
    "check_station",
    "demo_station",
    "load_station",
    "plan_motion",
    "plan_path",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
