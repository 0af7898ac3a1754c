"""Which pairs of bodies are checked against each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pinocchio as pin

from dmoc.errors import Fault, InputError
from planning.pieces import Mounted

__all__ = ["checked_pairs"]


def checked_pairs(
    model: pin.Model,
    links: Sequence[Mounted],
    tools: Sequence[Mounted],
    obstacles: Sequence[Mounted],
    allowed: Iterable[tuple[str, str]],
) -> tuple[tuple[str, str], ...]:
    """Names of the body pairs to check, obstacle or base first.

    Left out: bodies that do not move relative to each other, two links joined by one joint (they
    touch at it by design; a tool is no link and is checked against the link before the flange),
    and the `allowed` pairs. Errors: `InputError` for a name used twice or an unknown name.
    """
    bodies = [*obstacles, *links, *tools]
    names = [m.body.name for m in bodies]
    faults = [
        Fault("body-name", field=name, value="used twice", legal="one name per body",
              fix="rename one of the bodies (links of the robot count)")
        for name in sorted({n for n in names if names.count(n) > 1})
    ]  # fmt: skip
    forbidden = set()
    for a, b in allowed:
        for name in (a, b):
            if name not in names:
                faults.append(
                    Fault("allowed-collision", field="allowed_collisions", value=name,
                          legal=", ".join(names), fix="mend the spelling or remove the pair")
                )  # fmt: skip
        forbidden.add(frozenset((a, b)))
    if faults:
        raise InputError(faults)
    links_by_id = {id(m) for m in links}
    pairs = []
    for i, first in enumerate(bodies):
        for second in bodies[i + 1 :]:
            if first.joint == second.joint:
                continue
            adjacent = second.joint > 0 and model.parents[second.joint] == first.joint
            adjacent |= first.joint > 0 and model.parents[first.joint] == second.joint
            both_links = id(first) in links_by_id and id(second) in links_by_id
            if adjacent and both_links:
                continue
            if frozenset((first.body.name, second.body.name)) in forbidden:
                continue
            pairs.append((first.body.name, second.body.name))
    return tuple(pairs)
