"""Reading cell.yaml: a frozen cell, or all faults of the file and of what it names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dmoc.errors import InputError
from dmoc.input_file import FieldPath, InputFaults, read_yaml
from planning.geometry.shapes import Body
from planning.station.parts import build_obstacle, build_robot, build_tool
from planning.station.schema import RobotEntry, faults_of
from sequencing.timing.cell.from_run import robot_from_run
from sequencing.timing.cell.schema import CellFile, CellRobotEntry
from sequencing.timing.cell.trajectories import read_trajectories, with_loads
from sequencing.timing.cell.types import Cell, CellRobot, predecessors, waiting_order
from sequencing.timing.power.dc_link import LinkParams


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
    build = InputFaults(file, tree)
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
    sizes = [len(robot.trajectories) for robot in robots]
    numbered = [f"{name}/{k}" for name, size in zip(names, sizes) for k in range(size)]
    build.attempt(("handovers",), lambda: waiting_order(predecessors(sizes, handovers), numbered))
    if build.faults:
        raise InputError(build.faults)
    return Cell(
        entry.name,
        robots,
        obstacles,
        handovers,
        (links,) * count,
        link_of,
        entry.base_load_w,
        entry.clearance_m,
    )


def _robot_maker(
    build: InputFaults, entry: CellRobotEntry, k: int
) -> Callable[[], CellRobot | None]:
    def make() -> CellRobot | None:
        field: FieldPath = ("robots", k)
        if (entry.trajectories is None) == (entry.run is None):
            value = "both" if entry.run else "neither"
            build.refuse(field)(
                "motions-choice", value, "trajectories or run", "name one folder of motions"
            )
            return None
        if entry.run is not None:
            from_run = robot_from_run(build, entry, k)
            return from_run and with_loads(from_run, entry.loads, build.refuse(field))
        given = RobotEntry(model=entry.model, urdf=entry.urdf, base=entry.base)
        robot = build_robot(given, build.folder, build.refuse(field))
        if robot is None:
            return None
        bodies: tuple[Body, ...] = ()
        if entry.tool is not None:
            before = len(build.faults)
            tooled = build_tool(entry.tool, build.folder, build.refuse((*field, "tool")))
            if len(build.faults) > before:
                return None
            if tooled is not None:
                bodies, tool = tooled
                robot = robot.with_tool(tool)
        motions = read_trajectories(build.folder / str(entry.trajectories), robot, entry.payload_kg)
        made = CellRobot(
            entry.name,
            robot,
            bodies,
            motions.trajectories,
            motions.loaded,
            motions.labels,
            (0.0,) * len(motions.trajectories),
            free_order=entry.order == "free",
        )
        return with_loads(made, entry.loads, build.refuse(field))

    return make


def _link(entry: CellFile) -> LinkParams:
    given = entry.link.model_dump(exclude={"shared"}, exclude_none=True)
    given.setdefault(
        "chopper_off_v",
        max(0.5 * (given["chopper_v"] + given["voltage_v"]), given["chopper_v"] - 20.0),
    )
    return LinkParams(**given)


def _link_groups(
    entry: CellFile, names: list[str], build: InputFaults
) -> tuple[tuple[int, ...], int]:
    shared: Any = entry.link.shared
    if shared is True:
        return (0,) * len(names), 1
    if shared is False:
        return tuple(range(len(names))), len(names)
    flat = [name for group in shared for name in group]
    if sorted(flat) != sorted(names):
        build.refuse(("link", "shared"))(
            "link-groups",
            str(shared),
            "every robot in one group",
            f"use each of {', '.join(names)} once",
        )
        return (0,) * len(names), 1
    group_of = {name: g for g, group in enumerate(shared) for name in group}
    return tuple(group_of[name] for name in names), len(shared)


def _handovers(
    entry: CellFile, robots: tuple[CellRobot, ...], build: InputFaults
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
            if name in first and _is_count(number) and int(number) < size[name]:
                ends.append(first[name] + int(number))
                continue
            legal = ", ".join(f"{n}/0..{n}/{s - 1}" for n, s in size.items())
            fix = "name a robot and one of its trajectories"
            build.refuse(("handovers", k))("handover", text, legal, fix, key)
        if len(ends) == 2:
            found.append((ends[0], ends[1]))
    return tuple(found)


def _is_count(text: str) -> bool:
    """Plain digits; `str.isdigit` alone would let superscripts through."""
    return text.isascii() and text.isdigit() and len(text) < 9
