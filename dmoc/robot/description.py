"""What the gate read from a robot file, as plain numbers, and the model that is built from them.

The parser behind pinocchio reads URDF by other rules than ours: a number with a trailing blank or
an inertia without products costs a link its mass and its shapes without a word. So it is handed
a URDF that is written here from the numbers, and what it made of them is compared afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import Fault, RobotError

Three = tuple[float, float, float]
ZERO: Three = (0.0, 0.0, 0.0)
#: How far the parser's numbers may lie from ours, relative to their size.
_SAME = 1e-9


@dataclass(frozen=True)
class Origin:
    """Where something stands in its parent: `xyz_m` and roll, pitch, yaw."""

    xyz_m: Three = ZERO
    rpy_rad: Three = ZERO

    @property
    def pose(self) -> pin.SE3:
        """T_parent_child."""
        return pin.SE3(pin.rpy.rpyToMatrix(*self.rpy_rad), np.array(self.xyz_m))


@dataclass(frozen=True)
class LinkShape:
    """One solid of a link: box (edges), sphere (radius), cylinder (radius, length) or mesh.

    A mesh has a file, the factors of its axes and no size; `colour` is red, green, blue in 0–1.
    """

    kind: str
    origin: Origin
    size_m: tuple[float, ...] = ()
    mesh: Path | None = None
    scale: Three = (1.0, 1.0, 1.0)
    colour: Three = (0.6, 0.6, 0.62)


@dataclass(frozen=True)
class LinkNumbers:
    """Mass [kg], inertial frame, inertia in it (ixx, ixy, ixz, iyy, iyz, izz) and the shapes."""

    mass_kg: float = 0.0
    inertial: Origin = Origin()
    inertia_kg_m2: tuple[float, ...] = (0.0,) * 6
    collision: tuple[LinkShape, ...] = ()
    visual: tuple[LinkShape, ...] = ()

    @property
    def body(self) -> pin.Inertia:
        """Inertia in the link's frame."""
        xx, xy, xz, yy, yz, zz = self.inertia_kg_m2
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return self.inertial.pose.act(pin.Inertia(self.mass_kg, np.zeros(3), tensor))


@dataclass(frozen=True)
class JointNumbers:
    """A joint: revolute, prismatic or fixed; limits in rad or m, per second, N·m or N."""

    kind: str
    parent: str
    child: str
    origin: Origin
    axis: Three = (1.0, 0.0, 0.0)
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0


@dataclass(frozen=True)
class Description:
    """A robot file: links and joints by name, the chain of moving joints, and its flange.

    `text` is what a xacro file expanded to (else None), `meshes` maps the names that stand in the
    file to files, `warnings` is what is legal but hardly meant.
    """

    file: Path
    name: str
    links: Mapping[str, LinkNumbers]
    joints: Mapping[str, JointNumbers]
    chain: tuple[str, ...]
    flange: str
    text: str | None
    meshes: Mapping[str, Path]
    warnings: tuple[Fault, ...] = ()

    def carried(self) -> Iterator[tuple[str, int, pin.SE3]]:
        """Every link with the number of the joint that carries it (0: none) and its pose there."""
        below: dict[str, list[str]] = {}
        for name, joint in self.joints.items():
            below.setdefault(joint.parent, []).append(name)
        children = {joint.child for joint in self.joints.values()}
        waiting = [(link, 0, pin.SE3.Identity()) for link in self.links if link not in children]
        while waiting:
            link, number, pose = waiting.pop()
            yield link, number, pose
            for name in below.get(link, ()):
                joint = self.joints[name]
                if joint.kind == "fixed":
                    waiting.append((joint.child, number, pose * joint.origin.pose))
                else:
                    place = self.chain.index(name) + 1
                    waiting.append((joint.child, place, pin.SE3.Identity()))

    @property
    def slides(self) -> npt.NDArray[np.bool_]:
        """Which joints of the chain (n,) slide."""
        return np.array([self.joints[name].kind == "prismatic" for name in self.chain])

    def on_joint(self, number: int) -> tuple[str, ...]:
        """Links that a joint of the chain carries rigidly."""
        return tuple(link for link, joint, _ in self.carried() if joint == number)

    def build_model(self) -> pin.Model:
        """The model of the normalised file. Errors: `RobotError` where it is not what was read."""
        try:
            model = pin.buildModelFromXML(self._xml())
        except (ValueError, RuntimeError) as error:
            raise RobotError(self._fault("urdf-syntax", "file", str(error)[:200])) from error
        self._compare(model)
        return model

    def _fault(self, code: str, field: str, value: str) -> Fault:
        legal, fix = "a robot that the parser reads as the gate does", "simplify this element"
        return Fault(code, str(self.file), field, value, legal, fix)

    def _xml(self) -> str:
        rows = [f"<robot name={quoteattr(self.name)}>"]
        for name, link in self.links.items():
            rows.append(f"<link name={quoteattr(name)}>")
            if link.mass_kg > 0:
                tensor = " ".join(
                    f'i{axes}="{value!r}"'
                    for axes, value in zip(("xx", "xy", "xz", "yy", "yz", "zz"), link.inertia_kg_m2)
                )
                mass = f'<mass value="{link.mass_kg!r}"/><inertia {tensor}/>'
                rows.append(f"<inertial>{_origin(link.inertial)}{mass}</inertial>")
            rows.append("</link>")
        for name, joint in self.joints.items():
            rows.append(f'<joint name={quoteattr(name)} type="{joint.kind}">')
            ends = f"<parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>"
            rows.append(ends + _origin(joint.origin))
            if joint.kind != "fixed":
                limits = ("lower", "upper", "velocity", "effort")
                limit = " ".join(f'{key}="{getattr(joint, key)!r}"' for key in limits)
                rows.append(f'<axis xyz="{_words(joint.axis)}"/><limit {limit}/>')
            rows.append("</joint>")
        return "\n".join([*rows, "</robot>"])

    def _compare(self, model: pin.Model) -> None:
        """Every link and joint of the model against the numbers that were read."""
        faults = []

        def same(field: str, ours: Array, theirs: Array) -> None:
            size = max(1.0, float(np.abs(ours).max()))
            if not np.allclose(ours, theirs, rtol=0.0, atol=_SAME * size):
                value = f"read {np.round(ours, 6).tolist()}, loaded {np.round(theirs, 6).tolist()}"
                faults.append(self._fault("urdf-mismatch", field, value))

        if list(model.names)[1:] != list(self.chain) or model.nv != len(self.chain):
            names = f"read joints {list(self.chain)}, loaded {list(model.names)[1:]}"
            raise RobotError(self._fault("urdf-mismatch", "joints", names))
        bodies = [pin.Inertia.Zero() for _ in range(model.njoints)]
        pose_of = {}
        for link, number, pose in self.carried():
            pose_of[link] = (number, pose)
            bodies[number] += pose.act(self.links[link].body)
            index = model.getFrameId(link, pin.FrameType.BODY)
            if index == len(model.frames) or model.frames[index].parentJoint != number:
                faults.append(self._fault("urdf-mismatch", f"link {link}", "on another joint"))
                continue
            theirs = model.frames[index].placement.homogeneous
            same(f"link {link}.origin", pose.homogeneous, theirs)
        limits = (model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit)
        for number, name in enumerate(self.chain, start=1):
            joint, field = self.joints[name], f"joint {name}"
            parent, pose = pose_of[joint.parent]
            placed = (pose * joint.origin.pose).homogeneous
            same(f"{field}.origin", placed, model.jointPlacements[number].homogeneous)
            if model.parents[number] != parent:
                faults.append(self._fault("urdf-mismatch", field, "on another joint"))
            axis = np.array(model.joints[number].createData().S).reshape(6)
            ours = np.concatenate([np.zeros(3), joint.axis])
            same(f"{field}.axis", ours if joint.kind == "revolute" else np.roll(ours, 3), axis)
            given = np.array([joint.lower, joint.upper, joint.velocity, joint.effort])
            loaded = [*(v[number - 1] for v in limits), model.effortLimit[number - 1]]
            same(f"{field}.limit", given, np.array(loaded))
            body, other = bodies[number], model.inertias[number]
            same(f"{field} mass", np.array(body.mass), np.array(other.mass))
            same(f"{field} centre of mass", body.lever, other.lever)
            same(f"{field} inertia", body.inertia, other.inertia)
        if faults:
            raise RobotError(faults)


def _words(values: Three) -> str:
    return " ".join(repr(float(value)) for value in values)


def _origin(origin: Origin) -> str:
    return f'<origin xyz="{_words(origin.xyz_m)}" rpy="{_words(origin.rpy_rad)}"/>'
