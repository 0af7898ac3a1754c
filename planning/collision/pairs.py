"""Which pairs of bodies are checked against each other."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError
from planning.collision.kernels.layout import JointTable, Solids, Work
from planning.collision.kernels.never import never_touch
from planning.collision.packed import workspace
from planning.collision.pieces import Mounted, Piece

LEAST_M = 1e-4
MOST_CELLS = 60_000
MOST_JOINTS = 2

_known: dict[bytes, bool] = {}


def pairs_that_never_touch(
    pieces: Sequence[Piece],
    pairs: Sequence[tuple[str, str]],
    chain: JointTable,
    solids: Solids,
    limits: tuple[Array, Array],
    clearance_m: Mapping[tuple[str, str], float],
) -> tuple[tuple[str, str], ...]:
    """The body pairs of which no configuration within the limits brings pieces to 0.1 mm.

    Only pairs with at most two joints between them are tried (a box of angles is bisected, see
    `planning.collision.kernels.never`), and none with a clearance of its own. Such neighbours (the
    links around a wrist) stay a few millimetres apart in every configuration: no motion can make
    them collide, so they are neither obstacles nor near misses.
    """
    pose = np.zeros((len(pieces), 15))
    work = workspace(len(chain.info), len(pieces), 1)
    room = (pose, work, np.empty((256, 2, len(work.q))))
    of_body: dict[str, list[int]] = {}
    for p, piece in enumerate(pieces):
        of_body.setdefault(piece.body, []).append(p)
    found = []
    for a, b in pairs:
        ja, jb = (pieces[of_body[name][0]].joint for name in (a, b))
        between = int(np.sum(chain.above[ja] != chain.above[jb]))
        if between > MOST_JOINTS or (a, b) in clearance_m or (b, a) in clearance_m:
            continue
        if all(_never(i, k, chain, solids, limits, room) for i in of_body[a] for k in of_body[b]):
            found.append((a, b))
    return tuple(found)


def _never(
    i: int,
    k: int,
    chain: JointTable,
    solids: Solids,
    limits: tuple[Array, Array],
    room: tuple[Array, Work, Array],
) -> bool:
    """`never_touch`, remembered for this process: worlds of one robot ask the same again."""
    digest = hashlib.sha256()
    for array in (chain.info, chain.frame, *limits):
        digest.update(np.ascontiguousarray(array).tobytes())
    for p in (i, k):
        first, count = solids.info[p, 2:4]
        for array in (solids.info[p, :2], solids.frame[p], solids.size[p]):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update(np.ascontiguousarray(solids.verts[first : first + count]).tobytes())
    key = digest.digest()
    if key not in _known:
        _known[key] = bool(
            never_touch(
                chain, solids, room[0], i, k, limits[0], limits[1], LEAST_M, MOST_CELLS, *room[1:]
            )
        )
    return _known[key]


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
        Fault(
            "body-name",
            field=name,
            value="used twice",
            legal="one name per body",
            fix="rename one of the bodies (links of the robot count)",
        )
        for name in sorted({n for n in names if names.count(n) > 1})
    ]
    forbidden = set()
    for a, b in allowed:
        for name in (a, b):
            if name not in names:
                faults.append(
                    Fault(
                        "allowed-collision",
                        field="allowed_collisions",
                        value=name,
                        legal=", ".join(names),
                        fix="mend the spelling or remove the pair",
                    )
                )
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
