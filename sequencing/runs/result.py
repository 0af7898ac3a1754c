"""The object that result.json holds: everything about a run except how long it took."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from planning.path.rrt_connect import available_planner
from planning.station.station import Station
from sequencing.cycle_types import Cycle, CycleMotion, Search, Tables
from sequencing.runs.archive import sha256_of
from sequencing.runs.inputs import named_files


def cost_shares(trajectory: JointTrajectory, cost: Cost | ElectricalCost) -> dict[str, float]:
    r"""The terms of J on the knots, in the order they are printed.

    .. math:: J = c_t T + c_e \sum_k h_k u_k^T u_k
              + c_v \sum_k h_k \bigl(\| (q_{k+1} - q_k) / h_k \|^2
              + \kappa \| \dot q_{k+1} - \dot q_k \|^2\bigr)

    with κ of the reported cost and u_k the torque that is constant on interval k. The keys are
    `time`, `effort`, `velocity`. For an `ElectricalCost` the effort is the price of the joules,
    which needs the drive model and is therefore left out; time and velocity are the same. Matrices
    Q, R add a term `matrices`, with the state at the middle of an interval.
    """
    h = np.diff(trajectory.t_s)
    speed = np.diff(trajectory.q_rad, axis=0) / h[:, None]
    shares = {"time": cost.time * float(h.sum())}
    if isinstance(cost, Cost):
        shares["effort"] = cost.effort * float(h @ np.sum(trajectory.torque_nm**2, axis=1))
    within = cost.reported_kappa * np.diff(trajectory.velocity_rad_s, axis=0) ** 2
    shares["velocity"] = cost.velocity * float(h @ np.sum(speed**2 + within, axis=1))
    if isinstance(cost, Cost) and (cost.state_matrix or cost.torque_matrix):
        middle = (trajectory.q_rad[1:] + trajectory.q_rad[:-1]) / 2
        shares["matrices"] = float(h @ cost.matrix_rate(middle, speed, trajectory.torque_nm))
    return shares


def input_hashes(station: Station) -> dict[str, str]:
    """Name → sha256 of station.yaml, of every file that it names, and of the robot's two files.

    Names are relative to the station's folder (`robot/…` for the robot's), so that equal inputs
    give equal entries wherever they lie. A station that was built without files gives the
    robot's only.
    """
    hashes: dict[str, str] = {}
    for name, path in named_files(Path(station.source)).items():
        hashes[name] = sha256_of(path)
    urdf = Path(station.robot.urdf)
    shapes = (item.shape.mesh for item in station.robot.link_shapes())
    meshes = (path for path in shapes if path is not None)
    for path in (urdf, urdf.with_name("robot.yaml"), *meshes):
        if path.is_file():
            hashes[f"robot/{path.name}"] = sha256_of(path)
    return dict(sorted(hashes.items()))


SCHEMA_VERSION = 1

# Packages whose version can change a number in the result.
_PACKAGES = (
    "dmoc",
    "casadi",
    "coal",
    "numba",
    "numpy",
    "ompl",
    "pin",
    "python-fcl",
    "scipy",
    "toppra",
    "trimesh",
)


class RunResult(TypedDict):
    """result.json, field by field; what only a planned cycle has is None in a run of motions."""

    schema_version: int
    name: str
    seed: int
    solver: str | None
    planner: str | None
    method: str | None
    versions: dict[str, str]
    inputs: dict[str, Any]
    robot: dict[str, Any]
    cost: dict[str, Any]
    configurations: int | None
    unreachable: list[dict[str, str]] | None
    duration_s: float
    certified: int
    clearance_m: float | None
    fallbacks: int | None
    search: dict[str, Any] | None
    tour: dict[str, Any] | None
    welds: list[dict[str, Any]]
    motions: list[dict[str, Any]]
    tables: dict[str, Any] | None
    polish: dict[str, Any] | None
    second_look: dict[str, Any] | None
    files: dict[str, str]


def result_of_motions(
    name: str,
    robot: Robot,
    motions: Sequence[CycleMotion],
    cost: Cost | ElectricalCost,
    seed: int,
    files: Mapping[str, str],
) -> RunResult:
    """result.json of motions; `files` maps names of files beside it to their sha256."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": name,
        "seed": seed,
        "solver": None,
        "planner": None,
        "method": None,
        "versions": package_versions(),
        "inputs": {
            "station_fingerprint": "none",
            "robot_fingerprint": robot.fingerprint,
            "files": {},
        },
        "robot": robot_entry(robot),
        "cost": {"kind": type(cost).__name__, **asdict(cost)},
        "configurations": None,
        "unreachable": None,
        "duration_s": float(sum(item.motion.duration_s for item in motions)),
        "certified": sum(item.motion.certified is True for item in motions),
        "clearance_m": None,
        "fallbacks": None,
        "search": None,
        "tour": None,
        "welds": [],
        "motions": [motion_entry(item, cost) for item in motions],
        "tables": None,
        "polish": None,
        "second_look": None,
        "files": dict(sorted(files.items())),
    }


def result_of(cycle: Cycle, files: Mapping[str, str]) -> RunResult:
    """result.json of a cycle: that of its motions, and all that its station decides."""
    station, tour = cycle.station, cycle.tour
    bare = result_of_motions(
        station.name, station.robot, cycle.motions, station.cost, cycle.seed, files
    )
    return {
        **bare,
        "solver": cycle.solver,
        "planner": available_planner(),
        "method": cycle.method,
        "inputs": {
            "station_fingerprint": station.fingerprint,
            "robot_fingerprint": station.robot.fingerprint,
            "files": input_hashes(station),
        },
        "configurations": cycle.configurations,
        "unreachable": [{"stud": stud, "reason": reason} for stud, reason in cycle.unreachable],
        "duration_s": cycle.duration_s,
        "clearance_m": station.clearance_m,
        "fallbacks": cycle.fallbacks,
        "search": search_entry(cycle.search),
        "tour": {
            "nodes": [int(node) for node in tour.nodes],
            "cost": tour.cost,
            "lower_bound": tour.lower_bound,
            "proven": tour.proven,
            "method": tour.method,
        },
        "welds": [
            {
                "stud": weld.stud,
                "alternative": int(weld.alternative),
                "q_rad": weld.q_rad.tolist(),
                "cost": weld.cost,
                "time_s": weld.time_s,
                "contact_depth_m": weld.contact_depth_m,
            }
            for weld in cycle.welds
        ],
        "tables": tables_entry(cycle.tables),
        "polish": None if cycle.polish is None else cycle.polish.to_dict(),
        "second_look": None if cycle.second_look is None else asdict(cycle.second_look),
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
    limits = (
        "q_lower_rad",
        "q_upper_rad",
        "velocity_limit_rad_s",
        "acceleration_limit_rad_s2",
        "torque_limit_nm",
    )
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
        "warnings": [doubt.to_dict() for doubt in robot.description.warnings],
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
        "executed_cost": motion.executed_cost,
        "cost_gap": motion.cost_gap,
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
        "least_time": None if tables.least_time is None else tables.least_time.to_dict(),
        "saving_against_least_time_percent": tables.saving_against_least_time_percent,
        "travel_s": {
            name: value if math.isfinite(value) else None
            for name, value in zip(("old", "least_time", "new"), tables.travel_s, strict=True)
        },
    }
