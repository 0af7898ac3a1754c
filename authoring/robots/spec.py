"""A robot as numbers, and the URDF text made of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Solid:
    """A box (x, y, z edges) or a cylinder (radius, length) along `axis`, centred at `centre_m`."""

    kind: Literal["box", "cylinder"]
    size_m: tuple[float, ...]
    centre_m: Vector = (0.0, 0.0, 0.0)
    axis: Literal["x", "y", "z"] = "z"
    colour: str = "body"


@dataclass(frozen=True)
class LinkSpec:
    """Inertial values of a link (about its centre of mass, link axes) and its solids."""

    name: str
    mass_kg: float
    com_m: Vector
    inertia_kg_m2: Vector
    solids: tuple[Solid, ...]


@dataclass(frozen=True)
class JointSpec:
    """A revolute joint, its frame parallel to the parent's."""

    name: str
    origin_m: Vector
    axis: Vector
    lower_rad: float
    upper_rad: float
    velocity_rad_s: float
    effort_nm: float


def box_inertia(mass_kg: float, x_m: float, y_m: float, z_m: float) -> Vector:
    """Principal moments of a homogeneous box [kg·m²]: m/12·(y²+z², x²+z², x²+y²)."""
    return (
        mass_kg / 12 * (y_m**2 + z_m**2),
        mass_kg / 12 * (x_m**2 + z_m**2),
        mass_kg / 12 * (x_m**2 + y_m**2),
    )


_COLOURS = {
    "body": "0.93 0.42 0.10 1",
    "dark": "0.22 0.23 0.25 1",
    "light": "0.72 0.74 0.77 1",
}
_TURN = {"x": (0.0, np.pi / 2, 0.0), "y": (np.pi / 2, 0.0, 0.0), "z": (0.0, 0.0, 0.0)}


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value + 0.0:.16g}" for value in values)


def _solid(tag: str, solid: Solid) -> list[str]:
    if solid.kind == "box":
        shape = f'<box size="{_numbers(solid.size_m)}"/>'
    else:
        radius, length = solid.size_m
        shape = f'<cylinder radius="{radius:.12g}" length="{length:.12g}"/>'
    lines = [
        f"    <{tag}>",
        f'      <origin xyz="{_numbers(solid.centre_m)}" rpy="{_numbers(_TURN[solid.axis])}"/>',
        f"      <geometry>{shape}</geometry>",
    ]
    if tag == "visual":
        lines.append(f'      <material name="{solid.colour}"/>')
    return [*lines, f"    </{tag}>"]


def _link(link: LinkSpec) -> list[str]:
    ixx, iyy, izz = link.inertia_kg_m2
    lines = [
        f'  <link name="{link.name}">',
        "    <inertial>",
        f'      <origin xyz="{_numbers(link.com_m)}" rpy="0 0 0"/>',
        f'      <mass value="{link.mass_kg:.12g}"/>',
        f'      <inertia ixx="{ixx:.12g}" ixy="0" ixz="0" iyy="{iyy:.12g}" iyz="0" '
        f'izz="{izz:.12g}"/>',
        "    </inertial>",
    ]
    for tag in ("visual", "collision"):
        for solid in link.solids:
            lines += _solid(tag, solid)
    return [*lines, "  </link>"]


def _joint(joint: JointSpec, parent: str, child: str) -> list[str]:
    return [
        f'  <joint name="{joint.name}" type="revolute">',
        f'    <origin xyz="{_numbers(joint.origin_m)}" rpy="0 0 0"/>',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        f'    <axis xyz="{_numbers(joint.axis)}"/>',
        f'    <limit lower="{joint.lower_rad:.12g}" upper="{joint.upper_rad:.12g}" '
        f'velocity="{joint.velocity_rad_s:.12g}" effort="{joint.effort_nm:.12g}"/>',
        "  </joint>",
    ]


def urdf_text(
    name: str,
    links: tuple[LinkSpec, ...],
    joints: tuple[JointSpec, ...],
    flange_rpy_rad: Vector = (0.0, 0.0, 0.0),
) -> str:
    """The URDF of a serial arm: `links` (n + 1), `joints` (n), and a `flange` frame at the end."""
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Written by authoring.robots.generate: change the numbers there. -->",
        f'<robot name="{name}">',
    ]
    lines += [
        f'  <material name="{colour}"><color rgba="{rgba}"/></material>'
        for colour, rgba in _COLOURS.items()
    ]
    for link in links:
        lines += _link(link)
    for joint, parent, child in zip(joints, links[:-1], links[1:], strict=True):
        lines += _joint(joint, parent.name, child.name)
    lines += [
        '  <link name="flange"/>',
        '  <joint name="flange_fixed" type="fixed">',
        f'    <origin xyz="0 0 0" rpy="{_numbers(flange_rpy_rad)}"/>',
        f'    <parent link="{links[-1].name}"/>',
        '    <child link="flange"/>',
        "  </joint>",
        "</robot>",
        "",
    ]
    return "\n".join(lines)
