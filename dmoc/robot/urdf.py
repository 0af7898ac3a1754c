"""What a robot file may contain: every fault is named before any parser sees the file.

Parsers of URDF accept NaN masses, inverted limits, zero axes and meshes anywhere on the disk, and
some crash on long chains. So the text is read and judged here first; all faults come at once. One
chain of joints is the arm; fingers and rods beside it are locked.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from dmoc.errors import DmocError, Fault, RobotError
from dmoc.robot.description import Description, JointNumbers, LinkNumbers, Origin
from dmoc.robot.packages import Packages, expanded
from dmoc.robot.urdf_checks import (
    Faults,
    check_words,
    one_a_cause,
    read_colours,
    read_joint,
    read_link,
)
from dmoc.robot.xml_file import Element, read_xml

_MOST_MOVING = 32
_MOST_LINKS = 500
#: Links that carry a tool by custom, in this order, where several end the arm.
_FLANGES = ("tool0", "flange", "tool_flange", "ee_link")


def read_urdf(
    path: Path,
    settings: Mapping[str, Any],
    package_path: Sequence[str | Path] = (),
    massless: bool = False,
) -> Description:
    """The robot at `path` (URDF, or xacro by the ending .xacro) as numbers.

    `settings` is robot.yaml as read: `flange`, `locked`, `use_visual_shapes`, and which limits it
    gives; its `inertials` count instead of the file's. With `massless` no link needs a mass.
    Errors: `RobotError` with all faults: XML, names, words, tree (one root), numbers, units,
    limits, axes, masses and inertias, shapes, mesh files and their places.
    """
    packages = Packages(path, package_path)
    text = expanded(path, packages) if path.suffix.lower() == ".xacro" else None
    root = read_xml(path, text)
    faults = Faults(str(path))
    if root.tag != "robot":
        faults.add("urdf-root", root, f"<{root.tag}>", "<robot name=...>", "give a URDF file")
        raise RobotError(faults.found)
    links, joints = _named(root, "link", faults), _named(root, "joint", faults)
    if not links:
        faults.add("urdf-empty", root, "no link", "links and joints", "give a complete robot")
    if len(links) > _MOST_LINKS or len(joints) > _MOST_LINKS:
        value = f"{len(links)} links, {len(joints)} joints"
        faults.add("urdf-large", root, value, f"<= {_MOST_LINKS}", "merge fixed links")
        raise RobotError(faults.found)
    check_words(root, faults)
    colours, pictures, bodies = read_colours(root), [], {}
    use = settings.get("use_visual_shapes", False)
    for name, link in links.items():
        own = use is True or (isinstance(use, list) and name in use)
        bodies[name], doubts = read_link(link, f"link {name}", packages, colours, faults, own)
        pictures += doubts
    _give_inertials(bodies, settings.get("inertials"), root, faults)
    tree = _check_tree(root, links, joints, faults)
    chain: list[str] = []
    if tree is not None:
        chain = _chain(tree, joints, settings, root, faults)
    read = {
        name: read_joint(joint, f"joint {name}", faults, name in chain or not chain, settings)
        for name, joint in joints.items()
    }
    groups: dict[str, list[str]] = {name: [] for name in ("", *chain)}
    if tree is not None and chain:
        for name in links:
            groups[tree.arm_joint(name, chain, joints)].append(name)
    light = [n for n in chain if sum(bodies[k].mass_kg for k in groups[n]) <= 0]
    light = [name for name in light if not faults.about(groups[name])]
    if light and not massless:
        value, legal = f"{', '.join(light)} carry 0 kg", "> 0 kg on every moving joint"
        fix = "add the <inertial> of their links, or estimate: dmoc init --total-mass KG"
        faults.add("mass-zero", joints[light[0]], value, legal, fix, f"joint {light[0]}")
    if not chain or faults.found:
        raise RobotError(one_a_cause(faults.found))
    read, locked = _locked(read, joints, chain, settings)
    file = str(path)
    description = Description(
        file=path.resolve(),
        name=root.attributes.get("name", "") or path.stem,
        links=bodies,
        joints=read,
        chain=tuple(chain),
        flange="",
        text=text,
        meshes=_mesh_names(root, packages),
    )
    flange = settings.get("flange") or _flange(groups[chain[-1]], read, locked, root, faults)
    if faults.found:
        raise RobotError(faults.found)
    continuous = [n for n in chain if joints[n].attributes["type"] == "continuous"]
    warnings = [
        *one_a_cause(pictures),
        *_bare(file, bodies, [groups[name] for name in chain]),
        *_unlimited(file, continuous, settings),
        *_still(file, locked, read),
    ]
    return replace(description, flange=str(flange), warnings=tuple(warnings))


@dataclass
class _Tree:
    """Moving joints by the joint that carries them ("" is the base), and who carries a link."""

    below: dict[str, list[str]] = field(default_factory=dict)
    carrier: dict[str, str] = field(default_factory=dict)

    def depth(self, name: str) -> int:
        return 1 + max((self.depth(n) for n in self.below.get(name, ())), default=0)

    def arm_joint(self, link: str, chain: Collection[str], joints: Mapping[str, Element]) -> str:
        """The joint of the chain that carries a link, once all others are fixed."""
        name = self.carrier[link]
        while name and name not in chain:
            name = self.carrier[_ends(joints[name])[0]]
        return name

    def all_below(self, name: str) -> list[str]:
        return [name, *(n for b in self.below.get(name, ()) for n in self.all_below(b))]


def _ends(joint: Element) -> tuple[str, str]:
    """Names of parent and child link ("" if absent)."""
    ends = (joint.first("parent"), joint.first("child"))
    parent, child = ("" if e is None else e.attributes.get("link", "").strip() for e in ends)
    return parent, child


def _check_tree(
    root: Element, links: Mapping[str, Element], joints: Mapping[str, Element], faults: Faults
) -> _Tree | None:
    """The tree of moving joints, or None after recording what is wrong."""
    before = len(faults.found)
    parent_of: dict[str, str] = {}
    for name, joint in joints.items():
        for role, link in zip(("parent", "child"), _ends(joint)):
            if link not in links:
                value, legal, fix = link or "nothing", "the name of a link", f"name the {role} link"
                faults.add("urdf-link-unknown", joint, value, legal, fix, f"joint {name}.{role}")
        child = _ends(joint)[1]
        if child in parent_of:
            value, fix = f"link {child} has two parents", "remove one of the joints"
            faults.add("urdf-tree", joint, value, "one parent a link", fix, f"joint {name}")
        parent_of[child] = name
    if len(faults.found) > before:
        return None
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        value, fix = f"{len(roots)} root links {roots[:5]}", "join the parts, and break loops"
        faults.add("urdf-tree", root, value, "one root link", fix)
        return None
    tree = _Tree(carrier={roots[0]: ""})
    children: dict[str, list[str]] = {}
    for name, joint in joints.items():
        children.setdefault(_ends(joint)[0], []).append(name)
    waiting = [roots[0]]
    while waiting:
        parent = waiting.pop()
        for name in children.get(parent, ()):
            child, carrier = _ends(joints[name])[1], tree.carrier[parent]
            if joints[name].attributes.get("type") != "fixed":
                tree.below.setdefault(carrier, []).append(name)
                carrier = name
            tree.carrier[child] = carrier
            waiting.append(child)
    if len(tree.carrier) != len(links):
        value = f"links {sorted(set(links) - set(tree.carrier))[:5]} are not connected"
        faults.add("urdf-tree", root, value, "one tree", "break the loop")
        return None
    return tree


def _chain(
    tree: _Tree,
    joints: Mapping[str, Element],
    settings: Mapping[str, Any],
    root: Element,
    faults: Faults,
) -> list[str]:
    """The joints of the arm from base to flange.

    Joints that mimic another, or that robot.yaml locks, are not of the arm; neither is a joint
    that others mimic and that ends the chain (the driven finger of a hand). Where the chain
    branches, the flange of robot.yaml decides; sliding ends, and short branches behind the sixth
    joint, are fingers.
    """
    mimics = {n: m for n, j in joints.items() if (m := j.first("mimic")) is not None}
    masters = {m.attributes.get("joint", "") for m in mimics.values()}
    given = settings.get("locked")
    locked = set(given) if isinstance(given, dict) else set()
    flange = tree.carrier.get(str(settings.get("flange", "")))
    chain: list[str] = []

    def slides(name: str) -> bool:
        return all(joints[n].attributes.get("type") == "prismatic" for n in tree.all_below(name))

    def beyond(name: str) -> Iterator[str]:
        for other in tree.below.get(name, ()):
            if other in locked:
                yield from beyond(other)
            elif other not in mimics and (other not in masters or any(beyond(other))):
                yield other

    at = ""
    while True:
        next_ones = list(beyond(at))
        if len(next_ones) > 1:
            towards = [n for n in next_ones if flange in tree.all_below(n)]
            depth = max(tree.depth(n) for n in next_ones)
            if towards or flange == at:
                next_ones = towards
            elif all(slides(n) for n in next_ones) or (len(chain) >= 6 and depth <= 3):
                next_ones = []  # a hand
            else:
                value, legal = f"{', '.join(next_ones)} branch", "one serial chain of moving joints"
                fix = "name the arm's flange in robot.yaml, or lock the others: locked: {JOINT: 0}"
                at_joint = joints[next_ones[1]]
                faults.add("urdf-serial", at_joint, value, legal, fix, f"joint {next_ones[1]}")
                return []
        if not next_ones:
            break
        at = next_ones[0]
        chain.append(at)
    for name in chain[1:]:
        if joints[name].attributes.get("type") == "prismatic":
            value, legal = "a sliding axis in the arm", "turning joints; the first one may slide"
            fix = "fix it, or lock it: locked: {JOINT: m}"
            faults.add("joint-type", joints[name], value, legal, fix, f"joint {name}")
    if not 1 <= len(chain) <= _MOST_MOVING:
        value, legal = f"{len(chain)} moving joints", f"1 to {_MOST_MOVING}"
        faults.add("urdf-joints", root, value, legal, "give one serial arm")
        return []
    return chain


def _locked(
    read: Mapping[str, JointNumbers],
    joints: Mapping[str, Element],
    chain: Collection[str],
    settings: Mapping[str, Any],
) -> tuple[dict[str, JointNumbers], dict[str, float]]:
    """All joints with those beside the chain fixed where they stand, and where that is."""
    given = settings.get("locked")
    places: dict[str, float] = {}
    joined = dict(read)
    for name, joint in read.items():
        if joint.kind == "fixed" or name in chain:
            continue
        place = given.get(name) if isinstance(given, dict) else None
        if not isinstance(place, (int, float)) or isinstance(place, bool):
            low, high = joint.lower, joint.upper
            place = float(np.clip(0.0, low, high)) if low < high else 0.0
        places[name] = float(place)
        turn = np.array(joint.axis) * places[name]
        moved = pin.SE3(np.eye(3), turn)
        if joint.kind == "revolute":
            moved = pin.SE3(pin.exp3(turn), np.zeros(3))
        pose = joint.origin.pose * moved
        angles = pin.rpy.matrixToRpy(pose.rotation)
        fixed = Origin(tuple(pose.translation.tolist()), tuple(angles.tolist()))
        joined[name] = JointNumbers("fixed", joint.parent, joint.child, fixed)
    return joined, places


def _give_inertials(
    bodies: dict[str, LinkNumbers], given: Any, root: Element, faults: Faults
) -> None:
    """Masses of robot.yaml in place of the file's."""
    for name, entry in given.items() if isinstance(given, dict) else ():
        try:
            mass, com, six = (entry[key] for key in ("mass_kg", "com_m", "inertia_kg_m2"))
            values = np.array([mass, *com, *six], dtype=float)
            xx, xy, xz, yy, yz, zz = values[4:]
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            slack = 1e-4 * moments[2]
            right = values[0] > 0 and moments[0] >= 0
            right &= bool(moments[2] <= moments[0] + moments[1] + slack) and name in bodies
        except (TypeError, KeyError, ValueError, np.linalg.LinAlgError):
            right = False
        if not right:
            legal = "a link with mass_kg > 0, com_m (3) and a possible inertia_kg_m2 (6)"
            fix = "mend it in robot.yaml"
            faults.add("robot-value", root, str(entry), legal, fix, f"inertials.{name}")
            continue
        com_m = (float(values[1]), float(values[2]), float(values[3]))
        bodies[name] = replace(
            bodies[name],
            mass_kg=float(values[0]),
            inertial=Origin(com_m),
            inertia_kg_m2=tuple(values[4:].tolist()),
        )


def _flange(
    last: Sequence[str],
    joints: Mapping[str, JointNumbers],
    locked: Collection[str],
    root: Element,
    faults: Faults,
) -> str:
    """The link on the last moving joint that carries the tool: the only end, or by its name."""
    parents = {joint.parent for joint in joints.values() if joint.child in last}
    leaves = [link for link in last if link not in parents]
    for name in _FLANGES:
        ends = [link for link in leaves if link == name or link.endswith(f"_{name}")]
        if len(ends) == 1:
            return ends[0]
    behind = {joints[name].child for name in locked}
    for _ in last:  # links on locked joints (fingers), and what hangs on them
        behind |= {j.child for j in joints.values() if j.kind == "fixed" and j.parent in behind}
    kept = [link for link in last if link not in behind]
    parents = {joint.parent for joint in joints.values() if joint.child in kept}
    leaves = [link for link in kept if link not in parents]
    if len(leaves) != 1:
        value, fix = f"{len(leaves)} links end the arm", "write flange: LINK in robot.yaml"
        faults.add("robot-flange", root, value, ", ".join(leaves), fix, "flange")
        return ""
    return leaves[0]


def _bare(
    file: str, bodies: Mapping[str, LinkNumbers], groups: Sequence[Sequence[str]]
) -> list[Fault]:
    """Links that are never seen to collide: with a picture only, or a whole moving body."""
    bare = [name for name, body in bodies.items() if body.visual and not body.collision]
    for group in groups:
        if not any(bodies[link].collision for link in group):
            bare += [link for link in group if bodies[link].mass_kg > 0 and link not in bare]
    if not bare:
        return []
    fix = "add <collision> shapes to the URDF"
    if any(bodies[link].visual for link in bare):
        fix += ", or write use_visual_shapes: true in robot.yaml: their pictures then collide"
    value = f"{', '.join(bare)}: never seen to collide"
    return [Fault("link-bare", file, "collision", value, "a collision shape a link", fix)]


def _unlimited(file: str, names: Sequence[str], settings: Mapping[str, Any]) -> list[Fault]:
    if not names or "q_lower_rad" in settings:
        return []
    value = f"{', '.join(names)} turn without end"
    fix = "give q_lower_rad and q_upper_rad in robot.yaml where cables end them"
    return [Fault("joint-continuous", file, "joints", value, "taken as -2 pi to 2 pi", fix)]


def _still(file: str, locked: Mapping[str, float], read: Mapping[str, JointNumbers]) -> list[Fault]:
    if not locked:
        return []
    value = ", ".join(f"{name} at {place:g}" for name, place in locked.items())
    fix = "write locked: {JOINT: rad or m} in robot.yaml where they stand otherwise"
    return [Fault("joint-locked", file, "joints", value, "joints of the arm only", fix)]


def _mesh_names(root: Element, packages: Packages) -> dict[str, Path]:
    """Every mesh name of the file that leads to one."""
    found = {}
    elements: list[Element] = [root]
    while elements:
        element = elements.pop()
        elements += element.children
        if element.tag == "mesh" and (name := element.attributes.get("filename")):
            try:
                path = packages.mesh(name, "", "")
            except DmocError:
                continue
            if path.is_file():
                found[name] = path
    return found


def _named(root: Element, tag: str, faults: Faults) -> dict[str, Element]:
    """Children by name; missing and repeated names are faults."""
    named: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.attributes.get("name", "").strip()
        if not name:
            faults.add("urdf-name", element, "no name", "a name", f"name this {tag}", tag)
        elif name in named:
            legal = f"names used once (also on line {named[name].line})"
            faults.add("urdf-duplicate", element, name, legal, "rename it", f"{tag} {name}")
        else:
            named[name] = element
    return named
