"""Dynamics for a robot file that has none: stated rules, every value tagged assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from dmoc.errors import RobotError
from dmoc.robot.robot import Robot, estimated_torque_nm, load_robot
from dmoc.robot.settings import RAMP_S, read_settings
from dmoc.robot.urdf import read_urdf
from planning.geometry.mesh import load_link_mesh

#: Full speed of a motor [rad/s], and inertia of its rotor for each N·m that it gives [s²].
MOTOR_RAD_S, ROTOR_S2 = 314.0, 1e-4


def estimated_settings(
    urdf: Path, total_mass_kg: float, package_path: Sequence[str | Path] = ()
) -> dict[str, Any]:
    """Entries for robot.yaml that the robot file itself does not give.

    Masses: `total_mass_kg` over the hulls of the links' shapes, one density. Torque limits:
    `estimated_torque_nm`. Rotor inertia at the joint: motors of 314 rad/s, 1e-4 kg·m² for each N·m.
    Errors: `RobotError`.
    """
    if not 0.1 <= total_mass_kg <= 10_000:
        legal, fix = "0.1 to 10000 kg", "give the arm's mass of its data sheet"
        raise RobotError.of("total-mass", "", "total_mass", f"{total_mass_kg:g}", legal, fix)
    given = read_settings(urdf).data
    own = {"inertials", "torque_limit_nm", "acceleration_limit_rad_s2", "armature_kg_m2"}
    if twice := ", ".join(sorted((own | {"provenance"}) & given.keys())):
        file, fix = str(urdf.with_name("robot.yaml")), "take it out, or leave --total-mass out"
        raise RobotError.of("estimate-given", file, twice, "given", "not given", fix)
    given = {"torque_limit_nm": 1.0, **given}
    links = read_urdf(urdf, given, package_path, massless=True).links
    hulls = {name: hull for name, link in links.items() if (hull := _hull(link, str(urdf)))}
    density = total_mass_kg / sum((hull.volume for hull in hulls.values()), 1e-12)
    inertials = {}
    for name, hull in hulls.items():
        tensor = density * np.array(hull.moment_inertia)
        inertials[name] = {
            "mass_kg": float(density * hull.volume),
            "com_m": np.array(hull.center_mass).tolist(),
            "inertia_kg_m2": tensor[np.triu_indices(3)].tolist(),
        }
    robot = load_robot(urdf, package_path, {**given, "inertials": inertials})
    return {"inertials": inertials, **_drives(robot)}


def _hull(link: Any, file: str) -> trimesh.Trimesh | None:
    """The convex hull of a link's collision shapes (else of its pictures) in its frame."""
    points = []
    for shape in link.collision or link.visual:
        if shape.kind == "mesh":
            corners = load_link_mesh(shape, file, "mesh").vertices_m
        else:
            size = shape.size_m
            box = {"box": size, "sphere": (2 * size[0],) * 3}.get(shape.kind)
            box = box or (2 * size[0], 2 * size[0], size[1])
            corners = np.array(box) * np.array(trimesh.creation.box().vertices)
        pose = shape.origin.pose.homogeneous
        points.append(corners @ pose[:3, :3].T + pose[:3, 3])
    return trimesh.convex.convex_hull(np.concatenate(points)) if points else None


def _drives(robot: Robot) -> dict[str, Any]:
    acceleration, torque = robot.velocity_limit_rad_s / RAMP_S, estimated_torque_nm(robot)
    rotor = ROTOR_S2 * torque * MOTOR_RAD_S / robot.velocity_limit_rad_s
    return {
        "torque_limit_nm": torque.tolist(),
        "acceleration_limit_rad_s2": acceleration.tolist(),
        "armature_kg_m2": rotor.tolist(),
    }


def settings_text(entries: Mapping[str, Any]) -> str:
    """The entries as commented lines of a robot.yaml, tagged assumed."""
    lines = [
        "# Estimated by dmoc init: replace what the data sheet or an identification tells.",
        "# Per link: mass_kg > 0, com_m in the link's frame, inertia_kg_m2 about it in the link's",
        "# axes (ixx, ixy, ixz, iyy, iyz, izz); the file's own <inertial> does not count then.",
        "inertials:",
    ]
    for name, entry in entries["inertials"].items():
        parts = ", ".join(f"{key}: {_short(value)}" for key, value in entry.items())
        lines.append(f'  "{name}": {{{parts}}}')
    for key, comment in (
        ("torque_limit_nm", "At the joint [N·m], > 0."),
        ("acceleration_limit_rad_s2", "Of point-to-point moves [rad/s²], > 0."),
        ("armature_kg_m2", "Rotor inertia times gear ratio squared [kg·m²], >= 0."),
    ):
        lines += [f"# {comment}", f"{key}: {_short(entries[key])}"]
    lines += [
        "# Losses of the drives: class ur or heavy, or gear_ratio, torque_constant_nm_a [N·m/A],",
        "# copper_ohm [ohm] (> 0), and coulomb_nm, viscous_nm_s, idle_w, base_power_w [W] (>= 0).",
        "# drive: {class: heavy}",
        "provenance:",
        *(f"  {key}: assumed" for key in entries),
    ]
    return "\n".join(lines) + "\n"


def _short(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(f"{number:.6g}" for number in value) + "]"
    return f"{value:.6g}"
