"""A robot of a cell whose motions are a finished run of `dmoc plan`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from dmoc.errors import InputError
from dmoc.input_file import FieldPath, InputFaults
from dmoc.robot.robot import Robot
from planning.geometry.shapes import Body
from planning.station.build import available_stations, demo_station
from planning.station.parts import build_tool, pose_of
from planning.station.station import Station
from sequencing.runs.folder import Run, read_run, station_of
from sequencing.timing.cell.schema import CellRobotEntry
from sequencing.timing.cell.types import CellRobot


def robot_from_run(build: InputFaults, entry: CellRobotEntry, k: int) -> CellRobot | None:
    """Robot, motions, weld times, tool and fixtures of a run, moved to the cell's base."""
    field: FieldPath = ("robots", k)
    for key, value in (
        ("model", entry.model),
        ("urdf", entry.urdf),
        ("order", entry.order),
        ("payload_kg", entry.payload_kg or None),
    ):
        if value is not None and value != "given":
            build.refuse(field)(
                "run-field",
                str(value),
                "nothing: the run brings its own",
                "take it out (loads: sets payloads of a run)",
                key,
            )
    run = read_run(build.folder / str(entry.run))
    if run.robot is None:
        build.refuse((*field, "run"))(
            "run-robot", run.robot_note, "a robot of the package, unchanged", "plan it again"
        )
        return None
    base = pose_of(entry.base, build.refuse(field), "base")
    robot = run.robot.with_base(pin.SE3(base[:3, :3].copy(), base[:3, 3].copy()))
    station = _station(run)
    bodies = _tool(build, entry, station, field)
    weld_s = {weld.stud: float(weld.time_s) for weld in run.welds}
    motions = [m for m in run.motions if m.motion.trajectory is not None]
    trajectories = tuple(t.on(robot) for m in motions if (t := m.motion.trajectory) is not None)
    if not trajectories:
        build.refuse((*field, "run"))(
            "run-empty", "no motion", "at least one motion", "plan the station again"
        )
        return None
    labels = tuple(f"{m.origin} -> {m.target}" for m in motions)
    pauses = tuple(weld_s.get(m.target, 0.0) for m in motions)
    return CellRobot(
        entry.name,
        robot,
        bodies,
        trajectories,
        (robot,) * len(trajectories),
        labels,
        pauses,
        fixtures=() if station is None else _moved(station, robot),
    )


def _station(run: Run) -> Station | None:
    """The run's station; else the packaged one of that name, if robot and tool are the same."""
    try:
        return station_of(run)
    except InputError:
        if run.name not in available_stations():
            return None
    station = demo_station(run.name)
    same = station.robot.fingerprint == run.result["robot"]["fingerprint"]
    return station if same else None


def _moved(station: Station, robot: Robot) -> tuple[Body, ...]:
    """Part and fixtures of the station, moved with its robot into the cell."""
    move = robot.base.homogeneous @ np.linalg.inv(station.robot.base.homogeneous)
    return tuple(replace(body, pose=move @ body.pose) for body in station.obstacles)


def _tool(
    build: InputFaults, entry: CellRobotEntry, station: Station | None, field: FieldPath
) -> tuple[Body, ...]:
    """The tool's solids: given in the cell, else of the run's station.

    A run holds the tool's inertia but not its shape; leaving the gun out of the collision check
    would be a silent wrong answer, so a run whose station is gone must come with `tool`.
    """
    if entry.tool is not None:
        made = build_tool(entry.tool, build.folder, build.refuse((*field, "tool")))
        return () if made is None else made[0]
    if station is not None:
        return station.tool_bodies
    build.refuse(field)(
        "run-tool",
        "nothing",
        "tool: {shapes: [...]}, in the flange frame",
        "copy the tool of the run's station into this robot's entry (its part and fixtures go "
        "into obstacles)",
        "tool",
    )
    return ()
