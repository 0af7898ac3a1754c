"""How a scene lies in memory: named tuples of plain arrays, which every kernel reads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array

Ints = npt.NDArray[np.int64]


class JointTable(NamedTuple):
    """Joints: `info` (J, 2) parent and type (0 revolute, 1 prismatic); `frame` (J, 15) rotation
    and position in the parent (row-major) and axis; `above` (J, J) whether joint k moves joint j.
    Joint 0 is the world; q has one entry per other joint.
    """

    info: Ints
    frame: Array
    above: npt.NDArray[np.bool_]


class Solids(NamedTuple):
    """Pieces, moving ones first. `info` (P, 4): joint, kind, first vertex, vertex count;
    `frame` (P, 12) T_joint_piece; `size` (P, 13): half lengths (3), radius, half length, margin,
    box centre (3), box half (3), radius of a ball about the box centre; `verts` (V, 3);
    the neighbours of vertex v are `near[near_start[v]:near_start[v + 1]]`.
    """

    info: Ints
    frame: Array
    size: Array
    verts: Array
    near_start: Ints
    near: Ints


class Pairs(NamedTuple):
    """Piece pairs: `piece` (M, 2); `body` (M,) index of the body pair; `extra` (M,) clearance
    subtracted from the pair's distance [m].
    """

    piece: Ints
    body: Ints
    extra: Array


class Work(NamedTuple):
    """Scratch of the kernels, for J joints, n coordinates, P pieces and M piece pairs.

    Every kernel writes before it reads: nothing is carried from one call to the next.
    """

    joints: Array  # (J, 15)
    s: Array  # (4, 15), the simplex
    out: Array  # (8,)
    axis: Array  # (3,)
    q: Array  # (n,)
    delta: Array  # (n,)
    reach: Array  # (P, n)
    sweep: Array  # (P,)
    axes: Array  # (M, 3)
    bound: Array  # (M,)
    order: Ints  # (M,)


class Query(NamedTuple):
    """A scene as one question looks at it: what every kernel of `queries`, `contact`, `segment` and
    `proof` is handed. No kernel reads of its workspace what the same call has not written.
    """

    chain: JointTable
    solids: Solids
    pose: Array  # (P, 15), workspace in which the poses of the standing pieces are filled in
    moving: int  # pieces that move; they come first
    tip: Array  # (4,) joint and position in it of the tool tip
    work: Work
    pairs: Pairs
    lines: Array  # (L, 8) start, direction, length and stray of departure lines
    exempt: npt.NDArray[np.bool_]  # (L, M) the pairs a tip inside the tube of a line may ignore
    inside: npt.NDArray[np.bool_]  # (L,) workspace for whether it is
