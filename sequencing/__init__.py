"""Many motions: which ones, in what order, and when."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sequencing.cycle import PlanStop as PlanStop
    from sequencing.cycle import plan_station as plan_station
    from sequencing.cycle_types import Cycle as Cycle
    from sequencing.run_files import read_run as read_run
    from sequencing.run_files import write_run as write_run
    from sequencing.store import EdgeStore as EdgeStore
    from sequencing.timing import schedule as schedule

# Loaded on first use, so that importing the package costs nothing.
_HOME = {
    "Cycle": "sequencing.cycle_types",
    "EdgeStore": "sequencing.store",
    "PlanStop": "sequencing.cycle",
    "plan_station": "sequencing.cycle",
    "read_run": "sequencing.run_files",
    "schedule": "sequencing.timing",
    "write_run": "sequencing.run_files",
}

__all__ = [
    "Cycle",
    "EdgeStore",
    "PlanStop",
    "plan_station",
    "read_run",
    "schedule",
    "write_run",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
