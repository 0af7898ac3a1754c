"""The numbers in a URDF: origins, axes, limits, inertial values, shapes and their mesh files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import DmocError, Fault
from dmoc.input_file import confined
from dmoc.robot.xml_file import Element

#: Nothing of an industrial arm is farther than this from the frame it is given in [m].
_FAR_M = 20.0
#: Beyond this a joint limit is surely in degrees [rad].
_MOST_TURN_RAD = 50.0
_MESH_KINDS = (".stl", ".obj", ".dae", ".ply", ".glb")


class Faults:
    """Collects the faults of one file."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.found: list[Fault] = []

    def add(
        self, code: str, at: Element, value: str, legal: str, fix: str, field: str = ""
    ) -> None:
        """Record a fault at an element."""
        self.found.append(
            Fault(
                code,
                file=self.file,
                line=at.line,
                field=field,
                value=value[:120],
                legal=legal,
                fix=fix,
            )
        )

    def about(self, links: Sequence[str]) -> bool:
        """Whether a mass of one of these links has been faulted already."""
        names = {f"link {link}.mass" for link in links}
        return any(fault.field in names for fault in self.found)


def _numbers(
    element: Element | None, name: str, count: int, default: str, field: str, faults: Faults
) -> Array | None:
    """`count` finite numbers of an attribute, or None after recording the fault."""
    if element is None:
        return np.array([float(word) for word in default.split()])
    text = element.attributes.get(name, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        faults.add(
            "urdf-number",
            element,
            repr(text),
            f"{count} finite number(s)",
            "write plain numbers separated by spaces",
            field,
        )
        return None
    return values


def _check_origin(parent: Element, field: str, faults: Faults) -> None:
    origin = parent.first("origin")
    position = _numbers(origin, "xyz", 3, "0 0 0", f"{field}.origin.xyz", faults)
    turn = _numbers(origin, "rpy", 3, "0 0 0", f"{field}.origin.rpy", faults)
    if origin is None:
        return
    if position is not None and np.any(np.abs(position) > _FAR_M):
        faults.add(
            "urdf-unit",
            origin,
            str(position),
            f"metres, at most {_FAR_M:g}",
            "divide millimetres by 1000",
            f"{field}.origin.xyz",
        )
    if turn is not None and np.any(np.abs(turn) > 4 * np.pi):
        faults.add(
            "urdf-unit",
            origin,
            str(turn),
            "radians",
            "convert degrees to radians",
            f"{field}.origin.rpy",
        )


def check_inertial(link: Element, field: str, faults: Faults) -> float:
    """Mass, centre of mass and inertia of a link; returns the mass (0 if there is none)."""
    inertial = link.first("inertial")
    if inertial is None:
        return 0.0
    _check_origin(inertial, f"{field}.inertial", faults)
    element = inertial.first("mass")
    if element is None:
        faults.add(
            "mass-missing",
            inertial,
            "no <mass>",
            "<mass value=.../>",
            "add the mass",
            f"{field}.mass",
        )
        return 0.0
    value = _numbers(element, "value", 1, "", f"{field}.mass", faults)
    if value is None:
        return 0.0
    mass = float(value[0])
    if mass < 0 or mass > 1e5:
        faults.add(
            "mass-range", element, f"{mass:g}", "0 to 100000 kg", "mend the mass", f"{field}.mass"
        )
    tensor = inertial.first("inertia")
    if tensor is None:
        faults.add(
            "inertia-missing",
            inertial,
            "no <inertia>",
            "<inertia ixx=... />",
            "add the inertia about the centre of mass",
            f"{field}.inertia",
        )
        return max(mass, 0.0)
    _check_inertia(tensor, mass, field, faults)
    return max(mass, 0.0)


def _check_inertia(tensor: Element, mass: float, field: str, faults: Faults) -> None:
    parts = {}
    for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
        default = "0" if name in ("ixy", "ixz", "iyz") else ""
        value = _numbers(tensor, name, 1, default, f"{field}.inertia.{name}", faults)
        if value is None:
            return
        parts[name] = float(value[0])
    matrix = np.array(
        [
            [parts["ixx"], parts["ixy"], parts["ixz"]],
            [parts["ixy"], parts["iyy"], parts["iyz"]],
            [parts["ixz"], parts["iyz"], parts["izz"]],
        ]
    )
    moments = np.linalg.eigvalsh(matrix)
    slack = 1e-6 * max(float(moments[2]), 1e-9)
    legal = "principal moments >= 0, the largest at most the sum of the other two"
    if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
        faults.add(
            "inertia-impossible",
            tensor,
            f"principal moments {moments}",
            legal,
            "give the inertia about the centre of mass, in kg m²",
            f"{field}.inertia",
        )
    elif mass > 0 and moments[2] > mass * _FAR_M**2:
        faults.add(
            "urdf-unit",
            tensor,
            f"{moments[2]:g} kg m² for {mass:g} kg",
            f"a radius of gyration of at most {_FAR_M:g} m",
            "divide kg mm² by 1e6",
            f"{field}.inertia",
        )
    elif mass == 0 and moments[2] > 0:
        faults.add(
            "inertia-impossible",
            tensor,
            "inertia without mass",
            "a mass > 0",
            "add the mass",
            f"{field}.inertia",
        )


def check_joint(joint: Element, field: str, faults: Faults, torque_limits_given: bool) -> None:
    """Type, origin, axis and limits of a joint."""
    kind = joint.attributes.get("type", "")
    if kind not in ("revolute", "fixed"):
        fix = (
            "write revolute with the limits of its cables"
            if kind == "continuous"
            else "fix the joint, or leave its branch out"
        )
        faults.add("joint-type", joint, kind or "no type", "revolute or fixed", fix, field)
    _check_origin(joint, field, faults)
    if joint.first("mimic") is not None:
        faults.add(
            "joint-mimic",
            joint,
            "<mimic>",
            "independent joints",
            "fix the joint, or leave it out",
            field,
        )
    if kind != "revolute":
        return
    axis = _numbers(joint.first("axis"), "xyz", 3, "1 0 0", f"{field}.axis", faults)
    if axis is not None and np.linalg.norm(axis) < 1e-6:
        faults.add(
            "axis-zero",
            joint.first("axis") or joint,
            str(axis),
            "a vector that is not 0",
            "give the direction of the joint axis",
            f"{field}.axis",
        )
    limit = joint.first("limit")
    if limit is None:
        faults.add(
            "limit-missing",
            joint,
            "no <limit>",
            "<limit lower upper velocity effort>",
            "add the limits",
            f"{field}.limit",
        )
        return
    values = {
        name: _numbers(limit, name, 1, "", f"{field}.limit.{name}", faults)
        for name in ("lower", "upper", "velocity", "effort")
    }
    lower, upper = values["lower"], values["upper"]
    if lower is not None and upper is not None:
        if lower[0] >= upper[0]:
            faults.add(
                "limit-inverted",
                limit,
                f"{lower[0]:g} to {upper[0]:g}",
                "lower < upper",
                "swap the limits",
                f"{field}.limit",
            )
        elif max(abs(lower[0]), abs(upper[0])) > _MOST_TURN_RAD:
            faults.add(
                "urdf-unit",
                limit,
                f"{lower[0]:g} to {upper[0]:g}",
                f"radians, at most {_MOST_TURN_RAD:g}",
                "convert degrees to radians",
                f"{field}.limit",
            )
    for name, most, fix in (
        ("velocity", 100.0, "give the joint's speed in rad/s"),
        ("effort", 1e6, "give the torque limit in N m (or torque_limit_nm in robot.yaml)"),
    ):
        value = values[name]
        optional = name == "effort" and torque_limits_given
        if value is not None and not (0 < value[0] <= most) and not (optional and value[0] == 0):
            faults.add(
                f"limit-{name}",
                limit,
                f"{value[0]:g}",
                f"> 0, at most {most:g}",
                fix,
                f"{field}.limit.{name}",
            )


def check_shapes(link: Element, field: str, folder: Path, faults: Faults) -> None:
    """Collision and visual shapes of a link."""
    for kind in ("collision", "visual"):
        for index, element in enumerate(link.all(kind)):
            name = f"{field}.{kind}[{index}]"
            _check_origin(element, name, faults)
            geometry = element.first("geometry")
            shapes = [] if geometry is None else geometry.children
            if len(shapes) != 1:
                faults.add(
                    "shape-choice",
                    element,
                    f"{len(shapes)} shapes",
                    "one shape in <geometry>",
                    "give one box, cylinder, sphere or mesh",
                    name,
                )
                continue
            _check_shape(shapes[0], name, folder, faults)


def _check_shape(shape: Element, field: str, folder: Path, faults: Faults) -> None:
    sizes = {
        "box": (("size", 3),),
        "sphere": (("radius", 1),),
        "cylinder": (("radius", 1), ("length", 1)),
    }
    if shape.tag == "mesh":
        _check_mesh(shape, field, folder, faults)
        return
    if shape.tag not in sizes:
        faults.add(
            "shape-kind",
            shape,
            f"<{shape.tag}>",
            "box, cylinder, sphere or mesh",
            "replace the shape",
            field,
        )
        return
    for name, count in sizes[shape.tag]:
        values = _numbers(shape, name, count, "", f"{field}.{name}", faults)
        if values is not None and not np.all((values > 0) & (values <= _FAR_M)):
            faults.add(
                "shape-size",
                shape,
                str(values),
                f"> 0, at most {_FAR_M:g} m",
                "give the size in metres",
                f"{field}.{name}",
            )


def _check_mesh(shape: Element, field: str, folder: Path, faults: Faults) -> None:
    scale = _numbers(shape, "scale", 3, "1 1 1", f"{field}.scale", faults)
    if scale is not None and np.any(scale == 0):
        faults.add("mesh-scale", shape, str(scale), "not 0", "remove the scale", field)
    name = shape.attributes.get("filename", "")
    try:
        path = confined(name.removeprefix("package://"), folder, faults.file, field)
    except DmocError as error:
        for fault in error.faults:
            faults.add(fault.code, shape, fault.value, fault.legal, fault.fix, field)
        return
    if not path.is_file():
        faults.add(
            "mesh-missing",
            shape,
            name,
            "a file in the robot's folder",
            "put the mesh beside the URDF and name it there",
            field,
        )
    elif path.suffix.lower() not in _MESH_KINDS:
        faults.add(
            "mesh-kind", shape, path.suffix, ", ".join(_MESH_KINDS), "export it as STL", field
        )
    elif path.suffix.lower() == ".stl" and (problem := _stl_problem(path)):
        faults.add(
            "mesh-broken",
            shape,
            f"{name}: {problem}",
            "a complete mesh of finite numbers",
            "export the mesh again",
            field,
        )
    elif path.stat().st_size == 0:
        faults.add(
            "mesh-broken",
            shape,
            f"{name}: 0 bytes",
            "a complete mesh",
            "export the mesh again",
            field,
        )


def _stl_problem(path: Path) -> str:
    """What is wrong with a binary STL (text STL: only that it ends), or an empty string."""
    content = path.read_bytes()
    if content[:5].lower() == b"solid" and b"facet" in content[:4096]:
        return "" if b"endsolid" in content[-400:] else "text STL without endsolid"
    if len(content) < 84:
        return f"{len(content)} bytes"
    count = int.from_bytes(content[80:84], "little")
    if count == 0 or len(content) != 84 + 50 * count:
        return f"header promises {count} triangles, file has {len(content)} bytes"
    records = np.frombuffer(content, dtype=np.uint8, offset=84).reshape(count, 50)
    corners = np.ascontiguousarray(records[:, 12:48]).view("<f4")
    return "" if np.all(np.isfinite(corners)) else "NaN or infinite vertices"
