"""Trajectories that belong to no station as a run, so that they can be drawn and exported."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from dmoc.motion import Motion
from dmoc.robot import Robot
from dmoc.status import Status
from dmoc.trajectory import JointTrajectory
from sequencing.cycle_types import CycleMotion
from sequencing.run_files import Run
from sequencing.run_result import SCHEMA_VERSION, package_versions, robot_entry

__all__ = ["loose_run"]


def loose_run(
    name: str, robot: Robot, trajectories: Mapping[str, JointTrajectory], seed: int = 0
) -> Run:
    """A run of `trajectories` in their order, by name of the motion, without welds.

    Nothing is known of collisions: `certified` is None, and exports say that none is certified.
    """
    motions = []
    for number, (label, curve) in enumerate(trajectories.items()):
        if curve.robot is None:
            curve = JointTrajectory(
                curve.t_s, curve.q_rad, curve.velocity_rad_s, curve.torque_nm, robot
            )
        motion = Motion(Status.CONVERGED, "refined", curve, cost=float("nan"))
        motions.append(CycleMotion(f"m{number:03d}", label, "end", "travel", motion))
    result = {
        "schema_version": SCHEMA_VERSION, "name": name, "seed": seed,
        "versions": package_versions(), "robot": robot_entry(robot), "certified": 0,
        "inputs": {"station_fingerprint": "none (no station)",
                   "robot_fingerprint": robot.fingerprint, "files": {}},
    }  # fmt: skip
    return Run(Path(name), MappingProxyType(result), tuple(motions), (), robot)
