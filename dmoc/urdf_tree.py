"""The tree of a URDF: one root, no loops, one serial chain of moving joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dmoc.urdf_checks import Faults
from dmoc.urdf_xml import Element

__all__ = ["check_tree", "moving_groups"]

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
                faults.add("urdf-link-unknown", joint, link or "nothing", "the name of a link",
                           f"name the {role} link", f"joint {name}.{role}")  # fmt: skip
        if child in parent_of:
            faults.add("urdf-tree", joint, f"link {child} has two parents", "one parent a link",
                       "remove one of the joints", f"joint {name}")  # fmt: skip
        parent_of[child] = parent
    if len(faults.found) > before:
        return False
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        faults.add("urdf-tree", root, f"{len(roots)} root links {roots[:5]}", "one root link",
                   "join the parts, and break loops")  # fmt: skip
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
        faults.add("urdf-tree", root, f"links {lost[:5]} are not connected", "one tree",
                   "break the loop")  # fmt: skip
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
        faults.add("urdf-joints", root, f"{len(moving)} moving joints", f"1 to {_MOST_MOVING}",
                   "give one serial arm")  # fmt: skip
        return
    carrier = {link: name for name, group in moving_groups(joints) for link in group}
    below: dict[str, list[str]] = {}
    for name in moving:
        parent = _ends(joints[name])[0]
        below.setdefault(carrier.get(parent, ""), []).append(name)
    for names in below.values():
        if len(names) > 1:
            faults.add("urdf-serial", joints[names[1]], f"{', '.join(names)} branch",
                       "one serial chain of moving joints",
                       "fix the joints of the branch that is no arm (a gripper's fingers)",
                       f"joint {names[1]}")  # fmt: skip
