"""`dmoc init`: a commented station.yaml from a URDF, a part's mesh and a list of studs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from dmoc.errors import DmocError, Fault, InputError
from dmoc.robot.controller import controller_text
from dmoc.robot.packages import copy_file, with_meshes
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
    xacro_arguments: Mapping[str, str] | None = None,
) -> Path:
    """Write `out`/station.yaml with its inputs copied beside it, and return its path.

    `urdf` may be a xacro file, or the name of a robot of the package; its meshes are copied from
    where the packages lie (`package_path` and the usual places). `unit` is the part's mesh unit.
    A xacro file is expanded with `xacro_arguments`. With `total_mass_kg` the dynamics are
    estimated (`station.estimate`) into its robot.yaml.
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
    expand = {"xacro_arguments": dict(xacro_arguments)} if xacro_arguments else {}
    try:
        if total_mass_kg is not None:
            estimate = estimated_settings(Path(urdf), total_mass_kg, package_path, expand)
        robot = load_robot(urdf, package_path, {**expand, **estimate})
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
    copy_file(part, folder / part.name)
    copy_file(studs, folder / "studs.csv")
    copied = robot.urdf if named else copy_robot(robot, folder / "robot", estimate)
    text = _TEMPLATE.format(
        name="".join(c if c.isalnum() or c in "_.-" else "_" for c in folder.resolve().name),
        robot=f"model: {urdf}" if named else f"urdf: robot/{copied.name}",
        part=part.name,
        unit=unit,
        count=robot.num_joints,
        **_tool_places(robot),
        body="part" if part.stem in _links(robot) or not part.stem.isidentifier() else part.stem,
    )
    target = folder / "station.yaml"
    target.write_text(text, encoding="utf-8", newline="\n")
    load_station(target)
    return target


def _tool_places(robot: Robot) -> dict[str, str]:
    """Middle and end of a tool of 0.1 m along the last axis, away from the arm, and its turn.

    Most flanges have their Z there; of some robot files the last link's X points out.
    """
    frame, description = robot.model.frames[robot.flange_id], robot.description
    joint, last = description.joints[description.chain[-1]], robot.model.jointPlacements[-1]
    turn, ahead = frame.placement.rotation.T, np.array([0.0, 0.0, 1.0])
    axis = turn @ np.array(joint.axis)
    along = axis @ turn @ (last.rotation.T @ last.translation + frame.placement.translation)
    if joint.kind == "revolute" and abs(axis[2]) < 0.1 and abs(along) > 1e-6:
        ahead = axis * np.sign(along)
    turned = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), ahead).coeffs()
    rows = {"half": 0.05 * ahead, "end": 0.1 * ahead, "turn": turned}
    return {
        name: "[" + ", ".join(f"{x:.9g}" for x in row.round(12) + 0.0) + "]"
        for name, row in rows.items()
    }


def _links(robot: Robot) -> set[str]:
    return {frame.name for frame in robot.model.frames}


def copy_robot(robot: Robot, folder: Path, estimate: dict[str, Any] | None = None) -> Path:
    """The URDF (a xacro file expanded), its meshes and a robot.yaml that names the flange."""
    description = robot.description
    target = folder / f"{description.file.stem.removesuffix('.urdf')}.urdf"
    folder.mkdir(parents=True, exist_ok=True)
    own = description.text
    text = description.file.read_bytes() if own is None else own.encode()
    text = with_meshes(text, description.meshes, folder)
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
    - name: tool_tip
      cylinder_m: [0.02, 0.1]
      pose: {{position_m: {half}, quaternion_xyzw: {turn}}}
      touches: true
  mass_kg: 0
  com_m: [0, 0, 0]
  inertia_kg_m2: [[0, 0, 0], [0, 0, 0], [0, 0, 0]]
  # The tip's +Z points into the part.
  tip: {{position_m: {end}, quaternion_xyzw: {turn}}}

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
