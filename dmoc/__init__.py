"""One motion of one robot: dynamics, optimal control, refinement, drives."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dmoc.batch import solve_many as solve_many
    from dmoc.cost import Cost as Cost
    from dmoc.cost import ElectricalCost as ElectricalCost
    from dmoc.errors import DmocError as DmocError
    from dmoc.motion import Motion as Motion
    from dmoc.motion import MotionNotSolved as MotionNotSolved
    from dmoc.motion import MotionProblem as MotionProblem
    from dmoc.refinement import refine as refine
    from dmoc.resimulation import replay_motion as replay_motion
    from dmoc.robot import Robot as Robot
    from dmoc.robot import load_robot as load_robot
    from dmoc.solver import solve as solve
    from dmoc.status import Status as Status
    from dmoc.trajectory import JointPath as JointPath
    from dmoc.trajectory import JointTrajectory as JointTrajectory

# Loaded on first use, so that importing the package costs nothing.
_HOME = {
    "Cost": "dmoc.cost",
    "DmocError": "dmoc.errors",
    "ElectricalCost": "dmoc.cost",
    "JointPath": "dmoc.trajectory",
    "JointTrajectory": "dmoc.trajectory",
    "Motion": "dmoc.motion",
    "MotionNotSolved": "dmoc.motion",
    "MotionProblem": "dmoc.motion",
    "Robot": "dmoc.robot",
    "Status": "dmoc.status",
    "load_robot": "dmoc.robot",
    "refine": "dmoc.refinement",
    "replay_motion": "dmoc.resimulation",
    "solve": "dmoc.solver",
    "solve_many": "dmoc.batch",
}

__all__ = [
    "Cost",
    "DmocError",
    "ElectricalCost",
    "JointPath",
    "JointTrajectory",
    "Motion",
    "MotionNotSolved",
    "MotionProblem",
    "Robot",
    "Status",
    "load_robot",
    "refine",
    "replay_motion",
    "solve",
    "solve_many",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
