"""The numbers in a URDF: origins, axes, limits, inertial values, shapes and their mesh files."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import DmocError, Fault
from dmoc.robot.description import JointNumbers, LinkNumbers, LinkShape, Origin, Three
from dmoc.robot.packages import Packages
from dmoc.robot.xml_file import Element

#: Nothing of an industrial arm is farther than this from the frame it is given in [m].
_FAR_M = 20.0
#: Beyond this a joint limit is surely in degrees [rad].
_MOST_TURN_RAD = 50.0
#: A joint without end turns this far to either side [rad].
_CONTINUOUS_RAD = 2 * np.pi
_MESH_KINDS = (".stl", ".obj", ".dae", ".ply", ".glb")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
#: What may stand where: children that are read (`*`: any number of them) and attributes. A word
#: that is nearly one of these is a slip: what it says would be lost.
_WORDS: dict[str, tuple[str, str]] = {
    "robot": ("link* joint* material* transmission* gazebo*", "name version xmlns"),
    "link": ("inertial visual* collision*", "name type"),
    "inertial": ("origin mass inertia", ""),
    "visual": ("origin geometry material", "name"),
    "collision": ("origin geometry", "name"),
    "geometry": ("box cylinder sphere mesh", ""),
    "joint": (
        "origin parent child axis limit mimic dynamics calibration safety_controller",
        "name type",
    ),
    "origin": ("", "xyz rpy"),
    "axis": ("", "xyz"),
    "mass": ("", "value"),
    "inertia": ("", "ixx ixy ixz iyy iyz izz"),
    "limit": ("", "lower upper velocity effort acceleration jerk"),
    "mimic": ("", "joint multiplier offset"),
    "parent": ("", "link"),
    "child": ("", "link"),
    "box": ("", "size"),
    "sphere": ("", "radius"),
    "cylinder": ("", "radius length"),
    "mesh": ("", "filename scale"),
}


class Faults:
    """Collects the faults of one file."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.found: list[Fault] = []

    def add(
        self, code: str, at: Element, value: str, legal: str, fix: str, field: str = ""
    ) -> None:
        """Record a fault at an element."""
        self.found.append(Fault(code, self.file, field, value[:160], legal, fix, at.line))

    def about(self, links: Sequence[str]) -> bool:
        """Whether a mass of one of these links has been faulted already."""
        names = {f"link {link}.mass" for link in links}
        return any(fault.field in names for fault in self.found)


def check_words(element: Element, faults: Faults) -> None:
    """Single things given twice, and words that are nearly a known one, here and below."""
    children, attributes = (text.split() for text in _WORDS[element.tag])
    single = {name for name in children if not name.endswith("*")}
    known = {name.rstrip("*") for name in children}
    seen: set[str] = set()
    for child in element.children:
        if child.tag in single and child.tag in seen:
            text, fix = f"a second <{child.tag}>", "remove one of the two"
            faults.add("urdf-twice", child, text, f"one <{child.tag}>", fix, element.tag)
        seen.add(child.tag)
        if child.tag not in known and (near := _near(child.tag, known)):
            faults.add("urdf-word", child, f"<{child.tag}>", f"<{near}>", "mend the spelling")
        elif child.tag in known and child.tag in _WORDS:
            check_words(child, faults)
    for name in element.attributes.keys() - set(attributes):
        # Number-bearing elements know all their attributes: another one is a slip.
        near = _near(name, attributes) or ("" if children else " ".join(attributes))
        if near:
            place = f"{name}=... in <{element.tag}>"
            faults.add("urdf-word", element, place, near, "mend the spelling, or remove it")


def _near(word: str, known: Collection[str]) -> str:
    """The known word that this one was probably meant to be, or nothing."""
    return next(iter(get_close_matches(word.lower(), known, 1, 0.75)), "")


def _numbers(
    element: Element | None, name: str, count: int, default: str, field: str, faults: Faults
) -> Array | None:
    """`count` finite numbers of an attribute, or None after recording the fault."""
    text = default if element is None else element.attributes.get(name, default)
    words = re.split(r"[ \t\r\n]+", text.strip(" \t\r\n"))
    plain = len(words) == count and all(_NUMBER.fullmatch(word) for word in words)
    values = np.array([float(word) for word in words]) if plain else np.array([np.nan])
    if np.all(np.isfinite(values)):
        return values
    if element is not None:
        legal = f"{count} finite number(s)"
        fix = "write plain numbers separated by spaces"
        faults.add("urdf-number", element, repr(text), legal, fix, field)
    return None


def _three(values: Array) -> Three:
    return (float(values[0]), float(values[1]), float(values[2]))


def _origin(parent: Element, field: str, faults: Faults) -> Origin:
    origin = parent.first("origin")
    position = _numbers(origin, "xyz", 3, "0 0 0", f"{field}.origin.xyz", faults)
    turn = _numbers(origin, "rpy", 3, "0 0 0", f"{field}.origin.rpy", faults)
    if origin is None or position is None or turn is None:
        return Origin()
    if np.any(np.abs(position) > _FAR_M):
        legal, fix = f"metres, at most {_FAR_M:g}", "divide millimetres by 1000"
        faults.add("urdf-unit", origin, str(position), legal, fix, f"{field}.origin.xyz")
    if np.any(np.abs(turn) > 4 * np.pi):
        fix = "convert degrees to radians"
        faults.add("urdf-unit", origin, str(turn), "radians", fix, f"{field}.origin.rpy")
    return Origin(_three(position), _three(turn))


def read_link(
    link: Element,
    field: str,
    packages: Packages,
    colours: dict[str, Three],
    faults: Faults,
    by_visual: bool,
) -> tuple[LinkNumbers, list[Fault]]:
    """A link's numbers, and the doubts about its pictures (a picture never costs the robot).

    `by_visual`: a link without collision shapes takes its visual ones.
    """
    by_visual = by_visual and not link.all("collision")
    mass, inertial, inertia = _inertial(link, field, faults)
    shapes: dict[str, tuple[LinkShape, ...]] = {}
    pictures = Faults(faults.file)
    for kind in ("collision", "visual"):
        found = []
        for index, element in enumerate(link.all(kind)):
            place = f"{field}.{kind}[{index}]"
            strict = faults if kind == "collision" or by_visual else pictures
            shape = _shape(element, place, packages, colours, faults, strict)
            found += [] if shape is None else [shape]
        shapes[kind] = tuple(found)
    faults.found += [fault for fault in pictures.found if fault.code == "path-outside"]
    solid = shapes["visual" if by_visual else "collision"]
    return LinkNumbers(mass, inertial, inertia, solid, shapes["visual"]), pictures.found


def _inertial(link: Element, field: str, faults: Faults) -> tuple[float, Origin, tuple[float, ...]]:
    """Mass, inertial frame, inertia; zeros where there is none or where it is faulted."""
    nothing = 0.0, Origin(), (0.0,) * 6
    inertial = link.first("inertial")
    if inertial is None:
        return nothing
    origin = _origin(inertial, f"{field}.inertial", faults)
    element, tensor = inertial.first("mass"), inertial.first("inertia")
    if element is None:
        legal, fix = "<mass value=.../>", "add the mass"
        faults.add("mass-missing", inertial, "no <mass>", legal, fix, f"{field}.mass")
        return nothing
    value = _numbers(element, "value", 1, "", f"{field}.mass", faults)
    if value is None:
        return nothing
    mass = float(value[0])
    if mass < 0 or mass > 1e5:
        legal = "0 to 100000 kg"
        faults.add("mass-range", element, f"{mass:g}", legal, "mend the mass", f"{field}.mass")
        return nothing
    if tensor is None:
        legal, fix = "<inertia ixx=... />", "add the inertia about the centre of mass"
        faults.add("inertia-missing", inertial, "no <inertia>", legal, fix, f"{field}.inertia")
        return mass, origin, (0.0,) * 6
    return mass, origin, _inertia(tensor, mass, f"{field}.inertia", faults)


def _inertia(tensor: Element, mass: float, field: str, faults: Faults) -> tuple[float, ...]:
    parts = []
    for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        default = "" if name[1] == name[2] else "0"
        value = _numbers(tensor, name, 1, default, f"{field}.{name}", faults)
        if value is None:
            return (0.0,) * 6
        parts.append(float(value[0]))
    xx, xy, xz, yy, yz, zz = parts
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = 1e-6 * max(float(moments[2]), 1e-9)
    if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
        legal = "principal moments >= 0, the largest at most the sum of the other two"
        fix = "give the inertia about the centre of mass, in kg m²"
        value_text = f"principal moments {moments}"
        faults.add("inertia-impossible", tensor, value_text, legal, fix, field)
    elif mass > 0 and moments[2] > mass * _FAR_M**2:
        text = f"{moments[2]:g} kg m² for {mass:g} kg"
        legal = f"a radius of gyration of at most {_FAR_M:g} m"
        faults.add("urdf-unit", tensor, text, legal, "divide kg mm² by 1e6", field)
    elif mass == 0 and moments[2] > 0:
        text, fix = "inertia without mass", "add the mass"
        faults.add("inertia-impossible", tensor, text, "a mass > 0", fix, field)
    return tuple(parts)


def read_joint(
    joint: Element, field: str, faults: Faults, arm: bool, given: Collection[str]
) -> JointNumbers:
    """Type, origin, axis and, for a joint of the `arm`, limits.

    `given` are the keys of robot.yaml: what it says need not stand here. A joint that is not of
    the arm is locked and needs no limits.
    """
    kind = joint.attributes.get("type", "")
    ends = [joint.first(role) for role in ("parent", "child")]
    parent, child = ("" if e is None else e.attributes.get("link", "").strip() for e in ends)
    origin = _origin(joint, field, faults)
    plain = JointNumbers("fixed", parent, child, origin)
    if kind not in ("revolute", "continuous", "prismatic", "fixed"):
        legal, fix = "revolute, continuous, prismatic or fixed", "fix the joint, or leave it out"
        faults.add("joint-type", joint, kind or "no type", legal, fix, field)
        return plain
    if kind == "fixed":
        return plain
    axis = _numbers(joint.first("axis"), "xyz", 3, "1 0 0", f"{field}.axis", faults)
    if axis is None:
        return plain
    size = float(np.linalg.norm(axis))
    if size < 1e-6:
        fix = "give the direction of the joint axis"
        at = joint.first("axis") or joint
        faults.add("axis-zero", at, str(axis), "a vector that is not 0", fix, f"{field}.axis")
        return plain
    limits = _limits(joint, kind, f"{field}.limit", faults if arm else Faults(""), given)
    kind = "prismatic" if kind == "prismatic" else "revolute"
    return JointNumbers(kind, parent, child, origin, _three(axis / size), *limits)


def _limits(
    joint: Element, kind: str, field: str, faults: Faults, given: Collection[str]
) -> tuple[float, float, float, float]:
    """Lower, upper, velocity, effort; an effort of 0, or none, is one that nobody gave."""
    limit = joint.first("limit")
    if limit is None:
        legal = "<limit lower upper velocity effort>"
        faults.add("limit-missing", joint, "no <limit>", legal, "add the limits", field)
        return 0.0, 0.0, 0.0, 0.0
    unit, most = ("metres", _FAR_M) if kind == "prismatic" else ("radians", _MOST_TURN_RAD)
    values: dict[str, float] = {}
    for name in ("lower", "upper", "velocity", "effort"):
        key = {"velocity": "velocity_limit_rad_s", "effort": "torque_limit_nm"}.get(name)
        ends = {"lower": -_CONTINUOUS_RAD, "upper": _CONTINUOUS_RAD}
        if kind == "continuous" and name in ends:
            values[name] = ends[name]
            continue
        default = "0" if key in given or name == "effort" else ""
        value = _numbers(limit, name, 1, default, f"{field}.{name}", faults)
        values[name] = np.nan if value is None else float(value[0])
    lower, upper = values["lower"], values["upper"]
    if lower >= upper:
        text = f"{lower:g} to {upper:g}"
        faults.add("limit-inverted", limit, text, "lower < upper", "swap the limits", field)
    elif max(abs(lower), abs(upper)) > most:
        text, fix = f"{lower:g} to {upper:g}", "convert degrees to radians, millimetres to metres"
        faults.add("urdf-unit", limit, text, f"{unit}, at most {most:g}", fix, field)
    for most_of, key, largest, fix in (
        ("velocity", "velocity_limit_rad_s", 100.0, "give the joint's speed in rad/s (m/s)"),
        ("effort", "torque_limit_nm", 1e6, "give the torque limit in N·m (force in N)"),
    ):
        size = values[most_of]
        unsaid = size == 0 and (key in given or most_of == "effort")
        if not (0 < size <= largest or unsaid or np.isnan(size)):
            legal, fix = f"> 0, at most {largest:g}", f"{fix}, or {key} in robot.yaml"
            faults.add(f"limit-{most_of}", limit, f"{size:g}", legal, fix, f"{field}.{most_of}")
    return lower, upper, values["velocity"], values["effort"]


def _shape(
    element: Element,
    field: str,
    packages: Packages,
    colours: dict[str, Three],
    faults: Faults,
    files: Faults,
) -> LinkShape | None:
    """One collision or visual element; what is wrong with a mesh's file goes to `files`."""
    origin = _origin(element, field, faults)
    geometry = element.first("geometry")
    shapes = [] if geometry is None else geometry.children
    if len(shapes) != 1:
        legal, fix = "one shape in <geometry>", "give one box, cylinder, sphere or mesh"
        faults.add("shape-choice", element, f"{len(shapes)} shapes", legal, fix, field)
        return None
    shape, material = shapes[0], element.first("material")
    colour = LinkShape.colour if material is None else _colour(material, colours)
    if shape.tag == "mesh":
        scale = _numbers(shape, "scale", 3, "1 1 1", f"{field}.scale", faults)
        if scale is None:
            return None
        if np.any(scale == 0):
            faults.add("mesh-scale", shape, str(scale), "not 0", "remove the scale", field)
        path = _mesh(shape, field, packages, files)
        if path is None:
            return None
        return LinkShape("mesh", origin, (), path, _three(scale), colour)
    sizes: dict[str, tuple[tuple[str, int], ...]] = {
        "box": (("size", 3),),
        "sphere": (("radius", 1),),
        "cylinder": (("radius", 1), ("length", 1)),
    }
    if shape.tag not in sizes:
        legal = "box, cylinder, sphere or mesh"
        faults.add("shape-kind", shape, f"<{shape.tag}>", legal, "replace the shape", field)
        return None
    size: list[float] = []
    for name, count in sizes[shape.tag]:
        values = _numbers(shape, name, count, "", f"{field}.{name}", faults)
        if values is None:
            return None
        if not np.all((values > 0) & (values <= _FAR_M)):
            legal, fix = f"> 0, at most {_FAR_M:g} m", "give the size in metres"
            faults.add("shape-size", shape, str(values), legal, fix, f"{field}.{name}")
            return None
        size += values.tolist()
    return LinkShape(shape.tag, origin, tuple(size), colour=colour)


def _colour(material: Element, colours: dict[str, Three]) -> Three:
    """The colour of a material, by itself or by its name; a picture's, so never a fault."""
    own = material.first("color")
    value = _numbers(own, "rgba", 4, "", "", Faults(""))
    if value is not None:
        return _three(np.clip(value, 0.0, 1.0))
    return colours.get(material.attributes.get("name", ""), LinkShape.colour)


def read_colours(root: Element) -> dict[str, Three]:
    """Materials of the robot by name."""
    return {m.attributes.get("name", ""): _colour(m, {}) for m in root.all("material")}


def _mesh(shape: Element, field: str, packages: Packages, faults: Faults) -> Path | None:
    """The mesh's file, if it is there and of a kind that is read."""
    name = shape.attributes.get("filename", "")
    try:
        path = packages.mesh(name, faults.file, field)
    except DmocError as error:
        for fault in error.faults:
            faults.add(fault.code, shape, fault.value, fault.legal, fault.fix, field)
        return None
    if not path.is_file():
        legal, fix = "a file beside the URDF or in its package", "mend the name, or add the file"
        faults.add("mesh-missing", shape, name, legal, fix, field)
    elif path.suffix.lower() not in _MESH_KINDS:
        legal, fix = ", ".join(_MESH_KINDS), "export it as STL"
        faults.add("mesh-kind", shape, path.suffix, legal, fix, field)
    elif path.stat().st_size == 0:
        fix = "export the mesh again"
        faults.add("mesh-broken", shape, f"{name}: 0 bytes", "a complete mesh", fix, field)
    else:
        return path
    return None


#: Faults that one cause brings to many places.
_ALIKE = ("package-missing", "mesh-missing", "limit-effort", "limit-velocity", "limit-missing")


def one_a_cause(faults: Sequence[Fault]) -> list[Fault]:
    """The faults, those of one cause as one that names the places."""
    groups: dict[tuple[str, ...], list[Fault]] = {}
    for number, fault in enumerate(faults):
        key = (fault.code, fault.legal, "" if fault.code == "mesh-missing" else fault.value)
        groups.setdefault(key if fault.code in _ALIKE else (str(number),), []).append(fault)
    one = []
    for same in groups.values():
        first, count = same[0], len(same)
        if count > 1:
            places = ", ".join(fault.field for fault in same[:6]) + (", …" if count > 6 else "")
            value = f"{first.value} ({count} times: {places})"
            first = replace(first, field="", value=value)
        one.append(first)
    return one
