"""A cell: robots with their fixed paths, what surrounds them, hand-overs, and their DC links."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pinocchio as pin
from pydantic import ValidationError

from dmoc.errors import DmocError, Fault, InputError
from dmoc.robot import Robot
from dmoc.trajectory import JointTrajectory
from dmoc.yaml_file import FieldPath, YamlTree, field_name, read_yaml
from planning.shapes import Body
from planning.station import available_stations, demo_station
from planning.station_file import RobotEntry, faults_of
from planning.station_parts import Refuse, build_obstacle, build_robot, build_tool
from sequencing.run_files import Run, read_run
from sequencing.timing.cell_file import CellFile, CellRobotEntry
from sequencing.timing.dc_link import LinkParams
from sequencing.timing.trajectory_files import read_trajectories

__all__ = ["Cell", "CellRobot", "load_cell"]

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class CellRobot:
    """One robot of a cell and its trajectories in order.

    `loaded` holds the robot with the payload that it carries on each trajectory; `pause_s` how
    long it stands still after each (welding). All tuples have one entry a trajectory.
    """

    name: str
    robot: Robot
    tool_bodies: tuple[Body, ...]
    trajectories: tuple[JointTrajectory, ...]
    loaded: tuple[Robot, ...]
    labels: tuple[str, ...]
    pause_s: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Cell:
    """A frozen scheduling problem; trajectories are numbered through, robot by robot.

    `handovers` are pairs (from, to) of these numbers; `link_of` names each robot's entry in
    `links`. `base_load_w` is a constant consumption on the grid side.
    """

    name: str
    robots: tuple[CellRobot, ...]
    obstacles: tuple[Body, ...]
    handovers: tuple[tuple[int, int], ...]
    links: tuple[LinkParams, ...]
    link_of: tuple[int, ...]
    base_load_w: float
    clearance_m: float

    @property
    def first(self) -> tuple[int, ...]:
        """Number of each robot's first trajectory, and the number of all at the end."""
        edges = [0]
        for robot in self.robots:
            edges.append(edges[-1] + len(robot.trajectories))
        return tuple(edges)

    @property
    def durations_s(self) -> list[list[float]]:
        """Nominal durations [s], robot by robot."""
        return [[t.duration_s for t in robot.trajectories] for robot in self.robots]

    def owner(self, number: int) -> tuple[int, int]:
        """(robot, its own count) of a trajectory's number."""
        robot = max(r for r, first in enumerate(self.first[:-1]) if first <= number)
        return robot, number - self.first[robot]


def load_cell(path: str | Path) -> Cell:
    """Read cell.yaml and everything it names. Raises `InputError` with all faults at once."""
    file = Path(path)
    if file.is_dir():
        file = file / "cell.yaml"
    tree = read_yaml(file)
    try:
        entry = CellFile.model_validate(tree.data)
    except ValidationError as error:
        raise InputError(faults_of(error, tree, str(file))) from error
    build = _Build(file, tree)
    robots = tuple(
        robot
        for k, item in enumerate(entry.robots)
        if (robot := build.attempt(("robots", k), _robot_maker(build, item, k))) is not None
    )
    obstacles = tuple(
        body
        for k, item in enumerate(entry.obstacles)
        if (
            body := build.attempt(
                ("obstacles", k),
                lambda item=item, k=k: build_obstacle(  # type: ignore[misc]
                    item, build.folder, build.refuse(("obstacles", k))
                ),
            )
        )
        is not None
    )
    names = [item.name for item in entry.robots]
    for k, name in enumerate(names):
        if name in names[:k]:
            build.refuse(("robots", k, "name"))("name-twice", name, "a new name", "rename it")
    link_of, count = _link_groups(entry, names, build)
    links = build.attempt(("link",), lambda: _link(entry))
    if build.faults or links is None:
        raise InputError(build.faults)
    handovers = _handovers(entry, robots, build)
    if build.faults:
        raise InputError(build.faults)
    return Cell(
        entry.name, robots, obstacles, handovers, (links,) * count, link_of,
        entry.base_load_w, entry.clearance_m,
    )  # fmt: skip


class _Build:
    """Collects faults with the place in the file that caused them."""

    def __init__(self, file: Path, tree: YamlTree) -> None:
        self.file, self.tree = file, tree
        self.folder = file.resolve().parent
        self.faults: list[Fault] = []

    def refuse(self, field: FieldPath) -> Refuse:
        def record(code: str, value: str, legal: str, fix: str, *more: str | int) -> None:
            place = (*field, *more)
            self.faults.append(
                Fault(code, file=str(self.file), line=self.tree.line(place),
                      field=field_name(place), value=value[:200], legal=legal, fix=fix)
            )  # fmt: skip

        return record

    def attempt(self, field: FieldPath, make: Callable[[], T]) -> T | None:
        """`make()`, or None with its faults recorded at `field`."""
        try:
            return make()
        except DmocError as error:
            for fault in error.faults:
                where = fault.file or str(self.file)
                line = fault.line if fault.file else self.tree.line(field)
                name = fault.field or field_name(field)
                self.faults.append(
                    Fault(fault.code, where, name, fault.value, fault.legal, fault.fix, line)
                )
            return None


def _robot_maker(build: _Build, entry: CellRobotEntry, k: int) -> Callable[[], CellRobot | None]:
    def make() -> CellRobot | None:
        field: FieldPath = ("robots", k)
        if (entry.trajectories is None) == (entry.run is None):
            value = "both" if entry.run else "neither"
            build.refuse(field)("motions-choice", value, "trajectories or run",
                                "name one folder of motions")  # fmt: skip
            return None
        if entry.run is not None:
            return _robot_from_run(build, entry, k)
        given = RobotEntry(model=entry.model, urdf=entry.urdf, base=entry.base)
        robot = build_robot(given, build.folder, build.refuse(field))
        if robot is None:
            return None
        bodies: tuple[Body, ...] = ()
        if entry.tool is not None:
            made = build_tool(entry.tool, build.folder, build.refuse((*field, "tool")))
            if made is not None:
                bodies, tool = made
                robot = robot.with_tool(tool)
        motions = read_trajectories(build.folder / str(entry.trajectories), robot, entry.payload_kg)
        return CellRobot(
            entry.name, robot, bodies, motions.trajectories, motions.loaded, motions.labels,
            (0.0,) * len(motions.trajectories),
        )  # fmt: skip

    return make


def _robot_from_run(build: _Build, entry: CellRobotEntry, k: int) -> CellRobot | None:
    field: FieldPath = ("robots", k)
    run = read_run(build.folder / str(entry.run))
    if run.robot is None:
        build.refuse((*field, "run"))(
            "run-robot", run.robot_note, "a robot of the package, unchanged", "plan it again"
        )
        return None
    given = RobotEntry(model=run.robot.name, base=entry.base)
    placed = build_robot(given, build.folder, build.refuse(field))
    base = pin.SE3.Identity() if placed is None else placed.base
    robot = run.robot.with_base(base)
    bodies = _run_tool(build, entry, run, field)
    weld_s = {weld.stud: float(weld.time_s) for weld in run.welds}
    motions = [m for m in run.motions if m.motion.trajectory is not None]
    trajectories = tuple(
        JointTrajectory(t.t_s, t.q_rad, t.velocity_rad_s, t.torque_nm, robot)
        for m in motions
        if (t := m.motion.trajectory) is not None
    )
    if not trajectories:
        build.refuse((*field, "run"))("run-empty", "no motion", "at least one motion",
                                      "plan the station again")  # fmt: skip
        return None
    labels = tuple(f"{m.origin} -> {m.target}" for m in motions)
    pauses = tuple(weld_s.get(m.target, 0.0) for m in motions)
    return CellRobot(
        entry.name, robot, bodies, trajectories, (robot,) * len(trajectories), labels, pauses
    )


def _run_tool(build: _Build, entry: CellRobotEntry, run: Run, field: FieldPath) -> tuple[Body, ...]:
    """The tool's solids: given in the cell, else of the packaged station that the run planned.

    A run holds the tool's inertia but not its shape; leaving the gun out of the collision check
    would be a silent wrong answer, so a run of another station must come with `tool`.
    """
    if entry.tool is not None:
        made = build_tool(entry.tool, build.folder, build.refuse((*field, "tool")))
        return () if made is None else made[0]
    if run.name in available_stations():
        station = demo_station(run.name)
        if station.robot.fingerprint == run.result["robot"]["fingerprint"]:
            return station.tool_bodies
    build.refuse(field)(
        "run-tool", "nothing", "tool: {shapes: [...]}, in the flange frame",
        "copy the tool of the run's station into this robot's entry", "tool",
    )  # fmt: skip
    return ()


def _link(entry: CellFile) -> LinkParams:
    given = entry.link.model_dump(exclude={"shared"}, exclude_none=True)
    given.setdefault("chopper_off_v", max(0.5 * (given["chopper_v"] + given["voltage_v"]),
                                          given["chopper_v"] - 20.0))  # fmt: skip
    return LinkParams(**given)


def _link_groups(entry: CellFile, names: list[str], build: _Build) -> tuple[tuple[int, ...], int]:
    shared: Any = entry.link.shared
    if shared is True:
        return (0,) * len(names), 1
    if shared is False:
        return tuple(range(len(names))), len(names)
    flat = [name for group in shared for name in group]
    if sorted(flat) != sorted(names):
        build.refuse(("link", "shared"))("link-groups", str(shared), "every robot in one group",
                                         f"use each of {', '.join(names)} once")  # fmt: skip
        return (0,) * len(names), 1
    group_of = {name: g for g, group in enumerate(shared) for name in group}
    return tuple(group_of[name] for name in names), len(shared)


def _handovers(
    entry: CellFile, robots: tuple[CellRobot, ...], build: _Build
) -> tuple[tuple[int, int], ...]:
    first, at = {}, 0
    size = {robot.name: len(robot.trajectories) for robot in robots}
    for robot in robots:
        first[robot.name] = at
        at += len(robot.trajectories)
    found = []
    for k, item in enumerate(entry.handovers):
        ends = []
        for key, text in (("from", item.from_), ("to", item.to)):
            name, _, number = text.rpartition("/")
            if name in first and number.isdigit() and int(number) < size[name]:
                ends.append(first[name] + int(number))
                continue
            legal = ", ".join(f"{n}/0..{n}/{s - 1}" for n, s in size.items())
            fix = "name a robot and one of its trajectories"
            build.refuse(("handovers", k))("handover", text, legal, fix, key)
        if len(ends) == 2:
            found.append((ends[0], ends[1]))
    return tuple(found)
