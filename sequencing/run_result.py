"""The object that result.json holds: everything about a run except how long it took."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict
from importlib import metadata
from typing import Any

from dmoc.cost import Cost, ElectricalCost
from dmoc.robot import Robot
from sequencing.cycle_types import Cycle, CycleMotion, Search, Tables
from sequencing.run_inputs import input_hashes
from sequencing.run_shares import cost_shares

__all__ = ["SCHEMA_VERSION", "result_of"]

SCHEMA_VERSION = 1

# Packages whose version can change a number in the result.
_PACKAGES = (
    "dmoc", "casadi", "coal", "numba", "numpy", "ompl", "pin", "python-fcl", "scikit-learn",
    "scipy", "toppra", "trimesh",
)  # fmt: skip


def result_of(cycle: Cycle, files: Mapping[str, str]) -> dict[str, Any]:
    """result.json of a cycle; `files` maps names of files beside it to their sha256."""
    station = cycle.station
    return {
        "schema_version": SCHEMA_VERSION,
        "name": station.name,
        "seed": cycle.seed,
        "method": cycle.method,
        "versions": package_versions(),
        "inputs": {
            "station_fingerprint": station.fingerprint,
            "robot_fingerprint": station.robot.fingerprint,
            "files": input_hashes(station),
        },
        "robot": robot_entry(station.robot),
        "cost": {"kind": type(station.cost).__name__, **asdict(station.cost)},
        "configurations": cycle.configurations,
        "unreachable": [{"stud": stud, "reason": reason} for stud, reason in cycle.unreachable],
        "duration_s": cycle.duration_s,
        "certified": cycle.certified,
        "clearance_m": station.clearance_m,
        "fallbacks": cycle.fallbacks,
        "search": search_entry(cycle.search),
        "tour": {
            "nodes": [int(node) for node in cycle.tour.nodes],
            "cost": cycle.tour.cost,
            "lower_bound": cycle.tour.lower_bound,
            "proven": cycle.tour.proven,
            "method": cycle.tour.method,
        },
        "welds": [
            {
                "stud": weld.stud,
                "alternative": int(weld.alternative),
                "q_rad": weld.q_rad.tolist(),
                "cost": weld.cost,
                "time_s": weld.time_s,
            }
            for weld in cycle.welds
        ],
        "motions": [motion_entry(item, station.cost) for item in cycle.motions],
        "tables": tables_entry(cycle.tables),
        "polish": None if cycle.polish is None else cycle.polish.to_dict(),
        "files": dict(sorted(files.items())),
    }


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that can change a number."""
    versions = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def robot_entry(robot: Robot) -> dict[str, Any]:
    """What is needed to rebuild and to judge the robot: limits, tool, payload, base, tags."""
    tool = robot.tool
    limits = ("q_lower_rad", "q_upper_rad", "velocity_limit_rad_s", "acceleration_limit_rad_s2",
              "torque_limit_nm")  # fmt: skip
    return {
        "name": robot.name,
        "fingerprint": robot.fingerprint,
        "joint_names": list(robot.model.names)[1:],
        "limits": {name: getattr(robot, name).tolist() for name in limits},
        "payload_kg": robot.payload_kg,
        "mass_scale": robot.mass_scale,
        "world_from_base": robot.base.homogeneous.tolist(),
        "tool": {
            "mass_kg": tool.mass_kg,
            "com_m": tool.com_m.tolist(),
            "inertia_kg_m2": tool.inertia_kg_m2.tolist(),
            "tip_position_m": tool.tip_position_m.tolist(),
            "tip_quaternion_xyzw": tool.tip_quaternion_xyzw.tolist(),
        },
        "provenance": dict(sorted(robot.provenance.items())),
    }


def motion_entry(item: CycleMotion, cost: Cost | ElectricalCost) -> dict[str, Any]:
    """A motion of result.json: how it ended, what it costs and what the cost consists of."""
    motion = item.motion
    shares = {} if motion.trajectory is None else cost_shares(motion.trajectory, cost)
    return {
        "key": item.key,
        "from": item.origin,
        "to": item.target,
        "kind": item.kind,
        "status": motion.status.value,
        "source": motion.source,
        "solver": motion.solver,
        "planner": motion.planner,
        "method": motion.method,
        "certified": motion.certified,
        "min_clearance_m": motion.min_clearance_m,
        "proven_clearance_m": motion.proven_clearance_m,
        "cost": motion.cost,
        "cost_shares": shares,
        "smoothing_cost": motion.smoothing_cost,
        "duration_s": motion.duration_s,
        "iterations": motion.iterations,
        "max_defect": motion.max_defect,
        "replay_error_rad": motion.replay_error_rad,
        "note": motion.note,
    }


def search_entry(search: Search) -> dict[str, Any]:
    """How the sequence was found: edges, bound or estimate by name, and every round."""
    entry = asdict(search)
    entry["rounds"] = [dict(item) for item in search.rounds]
    return entry


def tables_entry(tables: Tables) -> dict[str, Any]:
    """Tables 1 and 2."""
    return {
        "studs": [asdict(row) for row in tables.studs],
        "time_based": tables.time_based.to_dict(),
        "time_based_totals": list(tables.time_based_totals),
        "energy_based": tables.energy_based.to_dict(),
        "saving_percent": tables.saving_percent,
    }
