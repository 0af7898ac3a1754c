"""What a robot file may contain: every fault is named before any parser sees the file.

Parsers of URDF accept NaN masses, inverted limits, zero axes and meshes anywhere on the disk, and
some crash on long chains. So the text is read and judged here first; all faults come at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from dmoc.errors import RobotError
from dmoc.robot.urdf_checks import Faults, check_inertial, check_joint, check_shapes
from dmoc.robot.xml_file import Element, read_xml

_MOST_MOVING = 32


def _ends(joint: Element) -> tuple[str, str]:
    """Names of parent and child link ("" if absent)."""
    parent, child = joint.first("parent"), joint.first("child")
    return (
        "" if parent is None else parent.attributes.get("link", ""),
        "" if child is None else child.attributes.get("link", ""),
    )


def _moves(joint: Element) -> bool:
    return joint.attributes.get("type") != "fixed"


def check_tree(
    root: Element, links: Mapping[str, Element], joints: Mapping[str, Element], faults: Faults
) -> bool:
    """Record what is wrong with the tree; True if nothing is."""
    before = len(faults.found)
    parent_of: dict[str, str] = {}
    for name, joint in joints.items():
        parent, child = _ends(joint)
        for role, link in (("parent", parent), ("child", child)):
            if link not in links:
                faults.add(
                    "urdf-link-unknown",
                    joint,
                    link or "nothing",
                    "the name of a link",
                    f"name the {role} link",
                    f"joint {name}.{role}",
                )
        if child in parent_of:
            faults.add(
                "urdf-tree",
                joint,
                f"link {child} has two parents",
                "one parent a link",
                "remove one of the joints",
                f"joint {name}",
            )
        parent_of[child] = parent
    if len(faults.found) > before:
        return False
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        faults.add(
            "urdf-tree",
            root,
            f"{len(roots)} root links {roots[:5]}",
            "one root link",
            "join the parts, and break loops",
        )
        return False
    reached = {roots[0]}
    children: dict[str, list[str]] = {}
    for child, parent in parent_of.items():
        children.setdefault(parent, []).append(child)
    waiting = [roots[0]]
    while waiting:
        for child in children.get(waiting.pop(), []):
            reached.add(child)
            waiting.append(child)
    if len(reached) != len(links):
        lost = sorted(set(links) - reached)
        faults.add(
            "urdf-tree", root, f"links {lost[:5]} are not connected", "one tree", "break the loop"
        )
        return False
    _check_serial(joints, root, faults)
    return len(faults.found) == before


def moving_groups(joints: Mapping[str, Element]) -> Iterator[tuple[str, list[str]]]:
    """Per moving joint the links that it carries rigidly (up to the next moving joint)."""
    fixed: dict[str, list[str]] = {}
    for joint in joints.values():
        parent, child = _ends(joint)
        if not _moves(joint):
            fixed.setdefault(parent, []).append(child)
    for name, joint in joints.items():
        if _moves(joint):
            group, waiting = [], [_ends(joint)[1]]
            while waiting:
                link = waiting.pop()
                group.append(link)
                waiting += fixed.get(link, [])
            yield name, group


def _check_serial(joints: Mapping[str, Element], root: Element, faults: Faults) -> None:
    moving = [name for name, joint in joints.items() if _moves(joint)]
    if not 1 <= len(moving) <= _MOST_MOVING:
        faults.add(
            "urdf-joints",
            root,
            f"{len(moving)} moving joints",
            f"1 to {_MOST_MOVING}",
            "give one serial arm",
        )
        return
    carrier = {link: name for name, group in moving_groups(joints) for link in group}
    below: dict[str, list[str]] = {}
    for name in moving:
        parent = _ends(joints[name])[0]
        below.setdefault(carrier.get(parent, ""), []).append(name)
    for names in below.values():
        if len(names) > 1:
            faults.add(
                "urdf-serial",
                joints[names[1]],
                f"{', '.join(names)} branch",
                "one serial chain of moving joints",
                "fix the joints of the branch that is no arm (a gripper's fingers)",
                f"joint {names[1]}",
            )


_MOST_LINKS = 500


def check_urdf(path: Path, torque_limits_given: bool = False) -> None:
    """Raise `RobotError` with all faults of the URDF at `path`.

    Judged: XML (no entities, no xacro), names, tree (one root, one serial chain of revolute
    joints), numbers, units, limits, axes, masses and inertias, shapes, mesh files and their
    place. With `torque_limits_given` (robot.yaml has them) an effort of 0 is accepted.
    """
    root = read_xml(path)
    faults = Faults(str(path))
    if root.tag != "robot":
        faults.add("urdf-root", root, f"<{root.tag}>", "<robot name=...>", "give a URDF file")
        raise RobotError(faults.found)
    links, joints = _named(root, "link", faults), _named(root, "joint", faults)
    if not links:
        faults.add("urdf-empty", root, "no link", "links and joints", "give a complete robot")
    if len(links) > _MOST_LINKS or len(joints) > _MOST_LINKS:
        faults.add(
            "urdf-large",
            root,
            f"{len(links)} links, {len(joints)} joints",
            f"<= {_MOST_LINKS}",
            "merge fixed links",
        )
        raise RobotError(faults.found)
    masses = {name: check_inertial(link, f"link {name}", faults) for name, link in links.items()}
    for name, link in links.items():
        check_shapes(link, f"link {name}", path.parent, faults)
    for name, joint in joints.items():
        check_joint(joint, f"joint {name}", faults, torque_limits_given)
    if check_tree(root, links, joints, faults):
        for joint_name, group in moving_groups(joints):
            if sum(masses.get(link, 0.0) for link in group) <= 0 and not faults.about(group):
                faults.add(
                    "mass-zero",
                    joints[joint_name],
                    f"links {', '.join(group)} weigh 0 kg",
                    "> 0 kg on every moving joint",
                    "add the <inertial> of the link",
                    f"joint {joint_name}",
                )
    if faults.found:
        raise RobotError(faults.found)


def _named(root: Element, tag: str, faults: Faults) -> dict[str, Element]:
    """Children by name; missing and repeated names are faults."""
    named: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.attributes.get("name", "").strip()
        if not name:
            faults.add("urdf-name", element, "no name", "a name", f"name this {tag}", tag)
        elif name in named:
            faults.add(
                "urdf-duplicate",
                element,
                name,
                f"names used once (also on line {named[name].line})",
                "rename it",
                f"{tag} {name}",
            )
        else:
            named[name] = element
    return named
