"""`dmoc init`: a commented station.yaml from a URDF, a part's mesh and a list of studs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from dmoc.errors import DmocError, Fault, InputError
from dmoc.robot.controller import controller_text
from dmoc.robot.robot import Robot, available_robots, load_robot
from planning.geometry.mesh import UNITS, load_mesh
from planning.station.build import load_station
from planning.station.estimate import estimated_settings, settings_text
from planning.station.parts import check_link_meshes
from planning.station.studs import read_studs


def init_station(
    urdf: str | Path,
    part: str | Path,
    studs: str | Path,
    out: str | Path,
    unit: str = "m",
    package_path: Sequence[str | Path] = (),
    total_mass_kg: float | None = None,
) -> Path:
    """Write `out`/station.yaml with its inputs copied beside it, and return its path.

    `urdf` may be a xacro file, or the name of a robot of the package; its meshes are copied from
    where the packages lie (`package_path` and the usual places). `unit` is the part's mesh unit.
    With `total_mass_kg` the dynamics are estimated (`station.estimate`) into its robot.yaml.
    Errors: `InputError`, `RobotError`, `MeshError` for inputs that cannot be used; nothing is
    written then. An existing station.yaml is never overwritten.
    """
    part, studs, folder = Path(part), Path(studs), Path(out)
    faults: list[Fault] = []
    if unit not in UNITS:
        faults.append(
            Fault("unit", field="unit", value=unit, legal=", ".join(UNITS), fix="use m or mm")
        )
    if (folder / "station.yaml").exists():
        faults.append(
            Fault(
                "init-exists",
                file=str(folder / "station.yaml"),
                value="the file is there",
                legal="a folder without station.yaml",
                fix="choose another folder",
            )
        )
    robot: Robot | None = None
    estimate: dict[str, Any] = {}
    try:
        if total_mass_kg is not None:
            estimate = estimated_settings(Path(urdf), total_mass_kg, package_path)
        robot = load_robot(urdf, package_path, estimate)
        check_link_meshes(robot)
    except DmocError as error:
        faults += error.faults
    for check in (
        lambda: load_mesh(part.name, part.parent, "mm" if unit == "mm" else "m", str(part)),
        lambda: read_studs(studs),
    ):
        try:
            check()
        except DmocError as error:
            faults += error.faults
    if faults or robot is None:
        raise InputError(faults)
    named = str(urdf) in available_robots()
    folder.mkdir(parents=True, exist_ok=True)
    _copy(part, folder / part.name)
    _copy(studs, folder / "studs.csv")
    copied = robot.urdf if named else copy_robot(robot, folder / "robot", estimate)
    text = _TEMPLATE.format(
        name="".join(c if c.isalnum() or c in "_.-" else "_" for c in folder.resolve().name),
        robot=f"model: {urdf}" if named else f"urdf: robot/{copied.name}",
        part=part.name,
        unit=unit,
        count=robot.num_joints,
        body="part" if part.stem in _links(robot) or not part.stem.isidentifier() else part.stem,
    )
    target = folder / "station.yaml"
    target.write_text(text, encoding="utf-8", newline="\n")
    load_station(target)
    return target


def _links(robot: Robot) -> set[str]:
    return {frame.name for frame in robot.model.frames}


def _copy(source: Path, target: Path) -> None:
    if source.resolve() != target.resolve():
        shutil.copyfile(source, target)


def copy_robot(robot: Robot, folder: Path, estimate: dict[str, Any] | None = None) -> Path:
    """The URDF (a xacro file expanded), its meshes and a robot.yaml that names the flange."""
    description = robot.description
    target = folder / f"{description.file.stem.removesuffix('.urdf')}.urdf"
    folder.mkdir(parents=True, exist_ok=True)
    if description.text is None:
        text = description.file.read_bytes()
    else:
        text = description.text.encode()
    for name, path in description.meshes.items():
        inner = name.split("://", 1)[-1]
        if name.startswith("file://") or Path(inner).is_absolute() or ".." in Path(inner).parts:
            number = sum(p.name == path.name for p in folder.rglob(path.name))
            inner = f"meshes/{number}_{path.name}" if number else f"meshes/{path.name}"
            for quote in "\"'":
                text = text.replace(f"{quote}{name}{quote}".encode(), f'"{inner}"'.encode())
        (folder / inner).parent.mkdir(parents=True, exist_ok=True)
        _copy(path, folder / inner)
    if not (target.exists() and target.samefile(description.file)):
        target.write_bytes(text)
    settings, beside = folder / "robot.yaml", robot.urdf.with_name("robot.yaml")
    given = beside.read_text(encoding="utf-8") if beside.is_file() else "schema_version: 1\n"
    if "flange" not in (yaml.safe_load(given) or {}):
        given += f"# The link that carries the tool.\nflange: {json.dumps(robot.flange)}\n"
    given += settings_text(estimate) if estimate else ""
    if robot.controller is None and "# controller:" not in given:
        given += controller_text(robot.num_joints)
    settings.write_text(given, encoding="utf-8", newline="\n")
    return target


_TEMPLATE = """\
# A station: one robot, its tool, what stands around it, and the welds. Metres, radians, kilograms.
# Every path is relative to this file and inside its folder. Check it with: dmoc check station.yaml
schema_version: 1
name: {name}

robot:
  {robot}
  # Where the robot stands (T_world_base); quaternions are x, y, z, w.
  base: {{position_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}

tool:
  # The tool in the flange frame: shapes, or mesh: FILE with unit: m|mm. The body that meets the
  # part at a weld says touches: true. Inertia is about the centre of mass.
  shapes:
    - {{name: tool_tip, cylinder_m: [0.02, 0.1], pose: {{position_m: [0, 0, 0.05]}}, touches: true}}
  mass_kg: 0
  com_m: [0, 0, 0]
  inertia_kg_m2: [[0, 0, 0], [0, 0, 0], [0, 0, 0]]
  # The tip's +Z points into the part.
  tip: {{position_m: [0, 0, 0.1], quaternion_xyzw: [0, 0, 0, 1]}}

payload_kg: 0

obstacles:
  # Meshes need their unit; primitives are box_m: [x, y, z], cylinder_m: [radius, length] or
  # sphere_m: radius.
  - {{name: {body}, mesh: {part}, unit: {unit}, pose: {{position_m: [0, 0, 0]}}}}

# Columns id, x_m, y_m, z_m, nx, ny, nz, weld_time_s; optional spin_free, group, depart_x,
# depart_y, depart_z, depart_m, on (the obstacle that the stud sits on). Normals point outwards.
studs: studs.csv
# Turns of the tool about a stud's axis that are tried.
spin_steps: 12
# How the tool leaves a weld unless studs.csv says otherwise: along the normal, or [x, y, z].
departure: {{direction: normal, length_m: 0.03}}
# {count} joint angles, or null for a closed cycle without a home pose.
home_rad: null
# Weld poses keep this distance and motions are optimised to keep it; the certificate proves that
# nothing touches, with 2 mm to spare for the controller.
clearance_m: 0.02
# J = integral of time + effort * torque^2 + velocity * speed^2.
cost: {{time: 1.0, effort: 1.0e-6, velocity: 1.0}}
# Pairs of studs [before, after], and pairs of bodies that may touch.
precedence: []
allowed_collisions: []
"""
