"""What a robot file may contain: every fault is named before any parser sees the file.

Parsers of URDF accept NaN masses, inverted limits, zero axes and meshes anywhere on the disk, and
some crash on long chains. So the text is read and judged here first; all faults come at once.
"""

from __future__ import annotations

from pathlib import Path

from dmoc.errors import RobotError
from dmoc.urdf_checks import Faults, check_inertial, check_joint, check_shapes
from dmoc.urdf_tree import check_tree, moving_groups
from dmoc.urdf_xml import Element, read_xml

__all__ = ["check_urdf"]

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
        faults.add("urdf-large", root, f"{len(links)} links, {len(joints)} joints",
                   f"<= {_MOST_LINKS}", "merge fixed links")  # fmt: skip
        raise RobotError(faults.found)
    masses = {name: check_inertial(link, f"link {name}", faults) for name, link in links.items()}
    for name, link in links.items():
        check_shapes(link, f"link {name}", path.parent, faults)
    for name, joint in joints.items():
        check_joint(joint, f"joint {name}", faults, torque_limits_given)
    if check_tree(root, links, joints, faults):
        for joint_name, group in moving_groups(joints):
            if sum(masses.get(link, 0.0) for link in group) <= 0 and not faults.about(group):
                faults.add("mass-zero", joints[joint_name], f"links {', '.join(group)} weigh 0 kg",
                           "> 0 kg on every moving joint", "add the <inertial> of the link",
                           f"joint {joint_name}")  # fmt: skip
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
            faults.add("urdf-duplicate", element, name,
                       f"names used once (also on line {named[name].line})", "rename it",
                       f"{tag} {name}")  # fmt: skip
        else:
            named[name] = element
    return named
