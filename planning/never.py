"""Pairs of a robot's own bodies that cannot touch within the joint limits, found by proof."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from dmoc.arrays import Array
from planning.kernels.range_proof import never_touch
from planning.packed import Chain, Solids, Work, workspace
from planning.pieces import Piece

__all__ = ["pairs_that_never_touch"]

LEAST_M = 1e-4
MOST_CELLS = 60_000
MOST_JOINTS = 2

_known: dict[bytes, bool] = {}


def pairs_that_never_touch(
    pieces: Sequence[Piece],
    pairs: Sequence[tuple[str, str]],
    chain: Chain,
    solids: Solids,
    limits: tuple[Array, Array],
    clearance_m: Mapping[tuple[str, str], float],
) -> tuple[tuple[str, str], ...]:
    """The body pairs of which no configuration within the limits brings pieces to 0.1 mm.

    Only pairs with at most two joints between them are tried (a box of angles is bisected, see
    `planning.kernels.range_proof`), and none with a clearance of its own. Such neighbours (the
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
    i: int, k: int, chain: Chain, solids: Solids, limits: tuple[Array, Array],
    room: tuple[Array, Work, Array],
) -> bool:  # fmt: skip
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
