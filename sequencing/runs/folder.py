"""The folder of a finished run: written whole, read back as what was planned.

`result.json` is written last and carries the checksum of `motions.npz`, so a folder in which the
two do not belong together (a run interrupted while it was replacing an older one) is noticed.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array, arrays_of
from dmoc.errors import InputError, RobotError
from dmoc.input_file import content_of
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot, Tool, load_robot
from planning.station.build import available_stations, demo_station, load_station
from planning.station.station import Station
from sequencing.cycle_types import Cycle, CycleCost, CycleMotion, Weld
from sequencing.runs.archive import csv_text, json_text, npz_bytes, sha256_of, write_atomic
from sequencing.runs.clock import CycleTimeline, timeline
from sequencing.runs.inputs import forget_pages, keep_inputs, kept_inputs
from sequencing.runs.result import (
    SCHEMA_VERSION,
    RunResult,
    input_hashes,
    result_of,
    result_of_motions,
)
from sequencing.runs.tables import tables_markdown


def station_of(run: Run) -> Station:
    """The station that `run` was planned in: the one it keeps, else the file it was read from.

    Errors: `InputError` run-station when the file is gone or the station has changed since.
    """
    wanted = run.result["inputs"]["station_fingerprint"]
    value = "no station file"
    own, kept = kept_inputs(run.folder)
    for candidate in [*([] if own is None else [own]), *_candidates(run)]:
        if isinstance(candidate, str):
            station = demo_station(candidate)
        else:
            station = load_station(candidate, kept if candidate == own else None)
        # A run of before hashed its station in another way: then its files decide.
        files = run.result["inputs"].get("files")
        if station.fingerprint == wanted or (files and input_hashes(station) == files):
            return station
        value = "the station has changed since the run"
    raise InputError.of(
        "run-station",
        file=str(run.folder),
        field="inputs.station_fingerprint",
        value=value,
        legal=f"a station with fingerprint {wanted[:12]}…",
        fix="plan the station again",
    )


def _candidates(run: Run) -> list[str | Path]:
    found: list[str | Path] = []
    timing = run.folder / "timing.json"
    if timing.is_file():
        try:
            source = json.loads(timing.read_text(encoding="utf-8")).get("station_source", "")
        except (ValueError, AttributeError):
            source = ""
        if source and Path(source).is_file():
            found.append(Path(source))
    return found + [name for name in available_stations() if run.name in name or name in run.name]


_SAMPLES_PER_INTERVAL = 4


def motion_file_name(item: CycleMotion) -> str:
    """`m000_S01_S07.csv`; characters that a file name should not have become `-`."""
    parts = [re.sub(r"[^A-Za-z0-9.-]+", "-", text) for text in (item.origin, item.target)]
    return "_".join([item.key, *parts]) + ".csv"


def motion_csv(trajectory: JointTrajectory, robot: Robot) -> str:
    """Time, q, q̇, q̈, τ at the knots and three times between, with units in the header.

    τ is the inverse dynamics of the interpolant (`torque_nm`); `control_nm` is the transcription's
    torque, constant on the interval that begins with the row (the last interval's at the end).
    """
    if trajectory.robot is None:
        trajectory = trajectory.on(robot)
    steps = np.arange(_SAMPLES_PER_INTERVAL * trajectory.num_intervals + 1)
    knot = np.minimum(steps // _SAMPLES_PER_INTERVAL, trajectory.num_intervals - 1)
    share = (steps - knot * _SAMPLES_PER_INTERVAL) / _SAMPLES_PER_INTERVAL
    times = trajectory.t_s[knot] + share * (trajectory.t_s[knot + 1] - trajectory.t_s[knot])
    sample = trajectory.sample(times)
    columns = [
        times[:, None] - trajectory.t_s[0],
        sample.q_rad,
        sample.velocity_rad_s,
        sample.acceleration_rad_s2,
        sample.torque_nm,
        trajectory.torque_nm[knot],
    ]
    joints = range(1, trajectory.q_rad.shape[1] + 1)
    header = ["t_s"]
    for unit in (
        "q{}_rad",
        "velocity{}_rad_s",
        "acceleration{}_rad_s2",
        "torque{}_nm",
        "control{}_nm",
    ):
        header += [unit.format(j) for j in joints]
    return csv_text(header, np.hstack(columns).tolist())


_ARRAYS = ("t_s", "q_rad", "velocity_rad_s", "torque_nm")


@dataclass(frozen=True)
class Run:
    """A run read back: `result` is result.json; motions and welds in order of execution.

    `robot` is read from the files that the run keeps (one of before: from the package) and None
    where there are none or they have changed (`robot_note` says which); or pass one to `read_run`.
    """

    folder: Path
    result: Mapping[str, Any]
    motions: tuple[CycleMotion, ...]
    welds: tuple[Weld, ...]
    robot: Robot | None = field(default=None, repr=False)
    robot_note: str = ""

    @property
    def name(self) -> str:
        """Name of the station."""
        return str(self.result["name"])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints in the URDF's order."""
        return tuple(self.result["robot"]["joint_names"])

    @property
    def planned(self) -> bool:
        """Whether a station was planned; otherwise these are motions without one."""
        return self.result["tables"] is not None

    @property
    def costs(self) -> dict[str, float]:
        """`travel`, `welding` and `total`; without a station what the motions cost."""
        if self.planned:
            return dict(self.result["tables"]["energy_based"])
        return CycleCost(float(sum(item.motion.cost for item in self.motions)), 0.0).to_dict()

    @property
    def trajectories(self) -> dict[str, JointTrajectory]:
        """Trajectory of every motion that has one, by key."""
        found = {item.key: item.motion.trajectory for item in self.motions}
        return {key: value for key, value in found.items() if value is not None}

    @property
    def timeline(self) -> CycleTimeline:
        """Motions and welds on one clock."""
        return timeline(self.welds, self.motions)

    def limit(self, name: str) -> Array:
        """A limit (n,) of the robot that was planned with, by its field name in `Robot`."""
        return np.array(self.result["robot"]["limits"][name], dtype=float)


def write_run(cycle: Cycle, out: Path | str, timing: Mapping[str, Any]) -> None:
    """Write result.json, timing.json, motions.npz, a CSV per motion and tables.md to `out`.

    Every file is replaced in one step; other files in `out` are left alone, but for CSV files of
    motions that an earlier run had and this one has not, and pages and programs of another result.
    Station and robot are kept in `inputs`. `timing` (CPU and wall seconds) goes to
    timing.json only, with the place of the station file: for the same cycle all other files have
    the same bytes.
    """
    out, station = Path(out), cycle.station
    write_atomic(out / "timing.json", json_text({"station_source": str(station.source), **timing}))
    keep_inputs(out, station.robot, station.source)
    _write(out, station.robot, cycle.motions, lambda files: result_of(cycle, files))


def write_motions(
    name: str,
    robot: Robot,
    motions: Sequence[CycleMotion],
    cost: Cost | ElectricalCost,
    out: Path | str,
    seed: int,
) -> Run:
    """Write motions that belong to no station as a run, and read it back.

    The files are those of `write_run` but timing.json; every command that takes a run takes it.
    """
    keep_inputs(Path(out), robot, None)
    _write(
        Path(out),
        robot,
        motions,
        lambda files: result_of_motions(name, robot, motions, cost, seed, files),
    )
    return read_run(out, robot)


def _write(
    out: Path,
    robot: Robot,
    motions: Sequence[CycleMotion],
    result_with: Callable[[Mapping[str, str]], RunResult],
) -> None:
    arrays: dict[str, Array] = {}
    names = set()
    for item in motions:
        trajectory = item.motion.trajectory
        if trajectory is None:
            continue
        arrays |= {f"{item.key}/{key}": getattr(trajectory, key) for key in _ARRAYS}
        name = motion_file_name(item)
        names.add(name)
        write_atomic(out / "motions" / name, motion_csv(trajectory, robot))
    for stale in sorted((out / "motions").glob("m[0-9]*.csv")):
        if stale.name not in names:
            stale.unlink()
    content = npz_bytes(arrays)
    result = result_with({"motions.npz": hashlib.sha256(content).hexdigest()})
    before = out / "result.json"
    if before.is_file() and before.read_bytes() != json_text(result).encode():
        forget_pages(out)
    write_atomic(out / "motions.npz", content)
    write_atomic(out / "tables.md", tables_markdown(result))
    write_atomic(out / "result.json", json_text(result))


def read_run(folder: Path | str, robot: Robot | None = None) -> Run:
    """The run in `folder`; `robot` replaces the one that the run names.

    Errors: `InputError` (run-missing, run-damaged, run-version, run-mixed, run-motion).
    """
    folder = Path(folder)
    result = _read_result(folder)
    archive = _read_motions(folder, result)
    try:
        note = ""
        if robot is None:
            robot, note = _robot_of(result["robot"], kept_inputs(folder)[1])
        elif robot.fingerprint != result["robot"]["fingerprint"]:
            note = f"robot {robot.name} is not the one that the run was planned with"
        motions = tuple(_motion_of(entry, archive, robot) for entry in result["motions"])
        welds = tuple(
            Weld(
                w["stud"],
                int(w["alternative"]),
                w["q_rad"],
                w["cost"],
                w["time_s"],
                w.get("contact_depth_m", 0.0),
            )
            for w in result["welds"]
        )
    except (KeyError, TypeError, ValueError) as error:
        raise _damaged(folder / "result.json", error) from error
    return Run(folder, MappingProxyType(result), motions, welds, robot, note)


def _read_result(folder: Path) -> dict[str, Any]:
    path = folder / "result.json"
    if not path.is_file():
        raise InputError.of(
            "run-missing",
            file=str(folder),
            field="result.json",
            legal="a folder that a plan or demo command wrote with --out",
            fix="plan the station first, or check the path",
        )
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        version = result["schema_version"]
        for key in ("name", "robot", "motions", "welds", "files"):
            result[key]
    except (ValueError, KeyError, TypeError) as error:
        raise _damaged(path, error) from error
    if version != SCHEMA_VERSION:
        raise InputError.of(
            "run-version",
            file=str(path),
            field="schema_version",
            value=str(version),
            legal=str(SCHEMA_VERSION),
            fix="plan the station again with this version",
        )
    # Folders of single motions from before have not all fields: None says the same.
    return {**dict.fromkeys(RunResult.__annotations__), **result}


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError.of(
        "run-damaged",
        file=str(path),
        value=f"{type(error).__name__}: {error}"[:200],
        legal="the result.json of a run",
        fix="plan the station again",
    )


def _read_motions(folder: Path, result: Mapping[str, Any]) -> dict[str, Array]:
    path = folder / "motions.npz"
    if not path.is_file() or sha256_of(path) != result["files"].get("motions.npz"):
        value = "no file" if not path.is_file() else "another checksum than result.json says"
        raise InputError.of(
            "run-mixed",
            file=str(path),
            value=value,
            legal="the motions.npz that was written with result.json",
            fix="plan the station again; finished edges are read from the store",
        )
    try:
        return arrays_of(content_of(path))
    except ValueError as error:
        raise _damaged(path, error) from error


def _motion_of(
    entry: Mapping[str, Any], archive: Mapping[str, Array], robot: Robot | None
) -> CycleMotion:
    trajectory = None
    if f"{entry['key']}/t_s" in archive:
        columns = {name: archive[f"{entry['key']}/{name}"] for name in _ARRAYS}
        trajectory = JointTrajectory(**columns, robot=robot)
    motion = Motion(
        status=Status(entry["status"]),
        source=entry["source"],
        trajectory=trajectory,
        cost=float("inf") if entry["cost"] is None else entry["cost"],
        executed_cost=entry.get("executed_cost"),
        smoothing_cost=entry["smoothing_cost"] or 0.0,
        iterations=entry["iterations"],
        max_defect=entry["max_defect"],
        replay_error_rad=entry["replay_error_rad"],
        min_clearance_m=entry["min_clearance_m"],
        proven_clearance_m=entry.get("proven_clearance_m"),
        certified=entry["certified"],
        note=entry["note"],
        solver=entry.get("solver", ""),
        planner=entry.get("planner", ""),
        method=entry.get("method", ""),
    )
    return CycleMotion(entry["key"], entry["from"], entry["to"], entry["kind"], motion)


def _robot_of(entry: Mapping[str, Any], kept: Path | None) -> tuple[Robot | None, str]:
    """The robot that the run keeps, else the one of the package; None and why not."""
    note = f"robot {entry['name']} is not in the package: torques come from the file"
    for name in (kept, entry["name"]):
        if name is None:
            continue
        try:
            robot = load_robot(name)
        except RobotError:
            continue
        robot = robot.with_base(pin.SE3(np.array(entry["world_from_base"])))
        robot = robot.with_mass_scale(entry["mass_scale"]).with_tool(Tool(**entry["tool"]))
        robot = robot.with_payload(entry["payload_kg"]).with_limits(**entry["limits"])
        if robot.fingerprint == entry["fingerprint"]:
            return robot, ""
        note = f"robot {entry['name']} has changed since: torques come from the file"
    return None, note
