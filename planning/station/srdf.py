"""Allowed collisions from an SRDF file (MoveIt's semantic robot description)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from dmoc.errors import Fault, InputError, RobotError
from dmoc.robot.xml_file import Element, read_xml

Pair = tuple[str, str]


def read_srdf(
    path: str | Path, known: Collection[str], links: Collection[str] | None = None
) -> tuple[Pair, ...]:
    """The pairs of bodies that an SRDF file exempts from the collision check, sorted.

    `disable_collisions link1 link2` names a pair. `disable_default_collisions link` exempts the
    link against all of `links` (the robot's links and the tool, `known` if not given; never against
    obstacles), and `enable_collisions link1 link2` takes a pair of those back. Groups, states and
    everything else of the file have no meaning here.

    `known` are the names that may occur: links of the robot, bodies of the tool, obstacles.
    Errors: `InputError` with every fault (file, line, field, value, legal names, fix) for a file
    that cannot be read, is no SRDF, names an unknown link or pairs a link with itself.
    """
    file = Path(path)
    try:
        root = read_xml(file)
    except RobotError as error:
        raise InputError([_of_srdf(fault) for fault in error.faults]) from error
    if root.tag != "robot":
        raise InputError.of(
            "srdf-root",
            file=str(file),
            line=root.line,
            value=f"<{root.tag}>",
            legal="<robot name=...>",
            fix="name an SRDF file",
        )
    faults: list[Fault] = []
    own = sorted(known if links is None else links)
    disabled: set[Pair] = set()
    enabled: set[Pair] = set()
    for element in root.children:
        if element.tag == "disable_collisions":
            disabled.update(_pair(element, file, known, faults))
        elif element.tag == "enable_collisions":
            enabled.update(_pair(element, file, known, faults))
        elif element.tag == "disable_default_collisions":
            name = _name(element, "link", file, known, faults)
            disabled.update(_sorted(name, other) for other in own if name and other != name)
    if faults:
        raise InputError(faults)
    return tuple(sorted(disabled - enabled))


def _of_srdf(fault: Fault) -> Fault:
    """A fault of the XML reader, in the words of this file."""
    code = fault.code.replace("urdf-", "srdf-").replace("robot-missing", "file-missing")
    legal = fault.legal.replace("URDF", "SRDF")
    return Fault(code, fault.file, fault.field or "srdf", fault.value, legal, fault.fix, fault.line)


def _pair(
    element: Element, file: Path, known: Collection[str], faults: list[Fault]
) -> Iterator[Pair]:
    first = _name(element, "link1", file, known, faults)
    second = _name(element, "link2", file, known, faults)
    if first and first == second:
        faults.append(
            Fault(
                "srdf-pair",
                file=str(file),
                line=element.line,
                field=element.tag,
                value=f"{first} with itself",
                legal="two different links",
                fix="remove the line",
            )
        )
    elif first and second:
        yield _sorted(first, second)


def _name(
    element: Element, attribute: str, file: Path, known: Collection[str], faults: list[Fault]
) -> str:
    """The attribute if it names a known body, else '' and a fault."""
    name = element.attributes.get(attribute, "")
    if name in known:
        return name
    faults.append(
        Fault(
            "srdf-link",
            file=str(file),
            line=element.line,
            field=f"{element.tag}.{attribute}",
            value=name or "nothing",
            legal=", ".join(sorted(known))[:300],
            fix="mend the name, or remove the line if this robot has no such link",
        )
    )
    return ""


def _sorted(first: str, second: str) -> Pair:
    return (first, second) if first < second else (second, first)
