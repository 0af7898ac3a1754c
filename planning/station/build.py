"""From station.yaml to a `Station`: every section is built, every fault collected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from pydantic import TypeAdapter, ValidationError

from dmoc.arrays import Array, readonly
from dmoc.errors import InputError
from dmoc.input_file import FieldPath, InputFaults, confined, read_yaml
from dmoc.motion.cost import Cost
from dmoc.order_graph import circle_of
from dmoc.robot.robot import Robot
from planning.geometry.nearest import body_distance_m
from planning.geometry.shapes import Body
from planning.station.parts import build_obstacle, build_robot, build_tool
from planning.station.schema import ObstacleEntry, RobotEntry, StationFile, ToolEntry, faults_of
from planning.station.srdf import read_srdf
from planning.station.station import Station
from planning.station.studs import DepartureDefault, Stud, read_studs

#: A stud nearer than this to an obstacle sits on it [m].
ON_PART_M = 0.05
T = TypeVar("T")


def build_station(path: Path, robot_file: Path | None = None) -> Station:
    """Read, validate and build; raises `InputError` with the faults of all sections at once."""
    tree = read_yaml(path)
    if not isinstance(tree.data, dict):
        raise InputError.of(
            "yaml-mapping",
            file=str(path),
            line=1,
            value=type(tree.data).__name__,
            legal="a mapping with the fields of the schema",
            fix="see docs/station-file.md",
        )
    sections = _Sections(path, tree)
    sections.robot_file = robot_file
    faults = sections.faults
    entry: StationFile | None = None
    try:
        entry = StationFile.model_validate(tree.data)
    except ValidationError as error:
        faults += faults_of(error, tree, str(path))
    robot = sections.robot()
    tool = sections.tool()
    obstacles = sections.obstacles()
    studs = sections.studs({body.name: body.pose for body in obstacles})
    if entry is None or robot is None or tool is None or faults:
        raise InputError(faults)
    bodies, inertial = tool
    robot = robot.with_tool(inertial).with_payload(entry.payload_kg)
    studs = tuple(_placed(stud, obstacles, sections) for stud in studs)
    home = _home(entry, robot, sections)
    if entry.cost.time == entry.cost.effort == 0:
        sections.refuse(("cost",))(
            "cost-zero",
            f"time 0, effort 0, velocity {entry.cost.velocity:g}",
            "time > 0 or effort > 0",
            "give a weight: without one the slowest motion is cheapest",
        )
    names = _names(robot, bodies, obstacles, sections)
    _check_pairs(entry, names, {stud.id for stud in studs}, sections)
    semantic = sections.srdf(entry, names, names - {body.name for body in obstacles})
    if faults:
        raise InputError(faults)
    allowed = _allowed(robot, bodies, obstacles, (*entry.allowed_collisions, *semantic))
    cost = Cost(time=entry.cost.time, effort=entry.cost.effort, velocity=entry.cost.velocity)
    station = Station(
        name=entry.name,
        robot=robot,
        tool_bodies=bodies,
        obstacles=obstacles,
        studs=studs,
        spin_steps=entry.spin_steps,
        home_rad=home,
        clearance_m=entry.clearance_m,
        cost=cost,
        precedence=tuple((first, second) for first, second in entry.precedence),
        allowed_collisions=allowed,
        source=path.resolve(),
        fingerprint="",
        stray_m=entry.departure.stray_m,
        engine=entry.engine,
    )
    return station.replace()


class _Sections(InputFaults):
    """Builds each section that is valid by itself, so that one bad field hides no other."""

    robot_file: Path | None = None

    def _valid(self, kind: type[T], value: Any) -> T | None:
        try:
            return TypeAdapter(kind).validate_python(value)
        except ValidationError:
            return None  # already reported with the whole file

    def robot(self) -> Robot | None:
        entry = self._valid(RobotEntry, self.tree.data.get("robot"))
        if entry is None:
            return None
        field: FieldPath = ("robot",)
        return self.attempt(
            field, lambda: build_robot(entry, self.folder, self.refuse(field), self.robot_file)
        )

    def tool(self) -> tuple[tuple[Body, ...], Any] | None:
        entry = self._valid(ToolEntry, self.tree.data.get("tool"))
        if entry is None:
            return None
        field: FieldPath = ("tool",)
        return self.attempt(field, lambda: build_tool(entry, self.folder, self.refuse(field)))

    def obstacles(self) -> tuple[Body, ...]:
        values = self.tree.data.get("obstacles", [])
        bodies = []
        for index, value in enumerate(values if isinstance(values, list) else []):
            entry = self._valid(ObstacleEntry, value)
            if entry is None:
                continue
            bodies.append(self._obstacle(entry, ("obstacles", index)))
        return tuple(body for body in bodies if body is not None)

    def _obstacle(self, entry: ObstacleEntry, field: FieldPath) -> Body | None:
        return self.attempt(field, lambda: build_obstacle(entry, self.folder, self.refuse(field)))

    def studs(self, frames: Mapping[str, Array]) -> tuple[Stud, ...]:
        name = self.tree.data.get("studs")
        if not isinstance(name, str):
            return ()
        file = self.attempt(
            ("studs",), lambda: confined(name, self.folder, str(self.file), "studs")
        )
        if file is None:
            return ()
        departure = self._departure()
        return self.attempt(("studs",), lambda: read_studs(file, departure, frames)) or ()

    def srdf(
        self, entry: StationFile, known: set[str], links: set[str]
    ) -> tuple[tuple[str, str], ...]:
        """The pairs that the SRDF file exempts; none without a file."""
        name, field = entry.srdf, ("srdf",)
        if name is None:
            return ()
        file = self.attempt(field, lambda: confined(name, self.folder, str(self.file), "srdf"))
        if file is None:
            return ()
        return self.attempt(field, lambda: read_srdf(file, known, links)) or ()

    def _departure(self) -> DepartureDefault:
        from planning.station.schema import DepartureEntry

        entry = self._valid(DepartureEntry, self.tree.data.get("departure", {}))
        if entry is None or entry.direction == "normal":
            return DepartureDefault(None, 0.03 if entry is None else entry.length_m)
        direction = np.array(entry.direction, dtype=float)
        if np.linalg.norm(direction) < 1e-6:
            self.refuse(("departure", "direction"))(
                "vector-zero",
                str(entry.direction),
                "a vector that is not zero",
                "give a direction, or normal",
            )
            return DepartureDefault(None, entry.length_m)
        return DepartureDefault(readonly(direction, "departure", 1), entry.length_m)


def _placed(stud: Stud, obstacles: Sequence[Body], sections: _Sections) -> Stud:
    """The stud with `on` resolved: the obstacle named in the CSV, else the nearest one."""
    names = [body.name for body in obstacles]
    on = stud.on
    if on and on not in names:
        sections.refuse(("studs",))(
            "stud-on", f"stud {stud.id}: on = {on}", ", ".join(names), "name an obstacle"
        )
    if not on and obstacles:
        distance = [body_distance_m(body, stud.position_m) for body in obstacles]
        nearest = int(np.argmin(distance))
        on = names[nearest] if distance[nearest] < ON_PART_M else ""
    return replace(stud, on=on)


def _home(entry: StationFile, robot: Robot, sections: _Sections) -> Array | None:
    if entry.home_rad is None:
        return None
    refuse, n = sections.refuse(("home_rad",)), robot.num_joints
    if len(entry.home_rad) != n:
        refuse("home", f"{len(entry.home_rad)} numbers", f"{n} numbers", "one angle per joint")
        return None
    home = np.array(entry.home_rad, dtype=float)
    for i, angle in enumerate(home):
        if not robot.q_lower_rad[i] <= angle <= robot.q_upper_rad[i]:
            refuse(
                "home-limit",
                f"{angle:g}",
                f"{robot.q_lower_rad[i]:.4f} to {robot.q_upper_rad[i]:.4f} rad (joint {i + 1})",
                "angles are radians, inside the joint limits",
                i,
            )
    return readonly(home, "home_rad", 1)


def _names(
    robot: Robot, bodies: Sequence[Body], obstacles: Sequence[Body], sections: _Sections
) -> set[str]:
    """All body names; a name used twice is a fault."""
    names = {f.name for f in robot.model.frames if f.type == pin.FrameType.BODY}
    fields: list[FieldPath] = [("tool", "shapes", i) for i in range(len(bodies))]
    fields += [("obstacles", i, "name") for i in range(len(obstacles))]
    for body, field in zip((*bodies, *obstacles), fields, strict=True):
        if body.name in names:
            sections.refuse(field)(
                "name-duplicate",
                body.name,
                "names that no link, tool shape or obstacle shares",
                "rename it",
            )
        names.add(body.name)
    return names


def _check_pairs(entry: StationFile, names: set[str], studs: set[str], sections: _Sections) -> None:
    for section, pairs, legal in (
        ("allowed_collisions", entry.allowed_collisions, names),
        ("precedence", entry.precedence, studs),
    ):
        for index, pair in enumerate(pairs):
            refuse = sections.refuse((section, index))
            for name in pair:
                if name not in legal:
                    refuse("name-unknown", name, ", ".join(sorted(legal))[:300], "mend the name")
            if pair[0] == pair[1]:
                refuse("pair", str(pair), "two different names", "remove the pair")
    circle = circle_of((first, second) for first, second in entry.precedence)
    if circle:
        sections.refuse(("precedence",))(
            "precedence-cycle",
            " -> ".join(circle),
            "an order without a circle",
            "remove one of these precedences",
        )


def _allowed(
    robot: Robot,
    bodies: Sequence[Body],
    obstacles: Sequence[Body],
    named: Sequence[Sequence[str]],
) -> tuple[tuple[str, str], ...]:
    model = robot.model
    links = list({item.link: item.joint for item in robot.link_shapes()}.items())
    carrier = model.frames[robot.flange_id].parentJoint
    links += [(body.name, carrier) for body in bodies]
    tools = {body.name for body in bodies}
    pairs = {tuple(sorted(pair)) for pair in (*robot.allowed_collisions, *named)}
    for i, (first, joint) in enumerate(links):
        for second, other in links[i + 1 :]:
            # Neighbours overlap at their joint; a tool, though, can hit the link behind its own.
            neighbours = model.parents[other] == joint or model.parents[joint] == other
            if joint == other or (neighbours and not {first, second} & tools):
                pairs.add(tuple(sorted((first, second))))
        if joint == 0:
            pairs |= {tuple(sorted((first, body.name))) for body in obstacles}
    known = {name for name, _ in links} | {body.name for body in obstacles}
    # Links without a shape (frames, flange) can be named but have nothing to check.
    return tuple(sorted((first, second) for first, second in pairs if {first, second} <= known))


def load_station(path: str | Path, robot_file: Path | None = None) -> Station:
    """The station of a station.yaml (or of the folder that holds one).

    `robot_file` is read in place of the robot that the station names.

    Errors: `InputError` with every fault found, each with code, file, line, field, value, legal
    range and fix.
    """
    from planning.station.build import build_station

    target = Path(path)
    if target.is_dir():
        target = target / "station.yaml"
    return build_station(target, robot_file)


def _stations_root() -> Path:
    return Path(str(resources.files("planning"))) / "stations"


def available_stations() -> tuple[str, ...]:
    """Names that `demo_station` knows."""
    names = []
    for path in _stations_root().glob("*/station*.yaml"):
        names.append(path.parent.name + path.stem.removeprefix("station"))
    return tuple(sorted(names))


def demo_station(name: str) -> Station:
    """A station of the package: `stud_welding_a`, its 8-stud subset `stud_welding_a_8`, …"""
    for path in sorted(_stations_root().glob("*/station*.yaml")):
        if path.parent.name + path.stem.removeprefix("station") == name:
            return load_station(path)
    raise InputError.of(
        "station-unknown",
        field="station",
        value=name,
        legal=", ".join(available_stations()),
        fix="use one of these names",
    )
