"""A station's geometry as plain arrays for the kernels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import RobotError
from planning.collision.kernels.layout import JointTable, Pairs, Solids, Work
from planning.collision.pieces import Piece

KINDS = {"convex": 0, "box": 1, "cylinder": 2, "sphere": 3}


def workspace(joints: int, pieces: int, pairs: int) -> Work:
    """A `Work` for that many joints (the world counts as one), pieces and piece pairs."""
    n = joints - 1
    return Work(
        np.zeros((joints, 15)),
        np.zeros((4, 15)),
        np.zeros(8),
        np.zeros(3),
        np.zeros(n),
        np.zeros(n),
        np.zeros((pieces, n)),
        np.zeros(pieces),
        np.zeros((pairs, 3)),
        np.zeros(pairs),
        np.zeros(pairs, dtype=np.int64),
    )


@dataclass(frozen=True)
class _Joint:
    kind: int
    axis: Array


def _joint(model: pin.Model, data: pin.Data, index: int) -> _Joint:
    joint = model.joints[index]
    if joint.nq != 1 or joint.nv != 1:
        raise RobotError.of(
            "joint-type",
            field=model.names[index],
            value=joint.shortname(),
            legal="revolute with limits, or prismatic",
            fix="give a continuous joint limits and make it revolute; fix what floats",
        )
    jacobian = pin.getJointJacobian(model, data, index, pin.ReferenceFrame.LOCAL)
    column = jacobian.reshape(6, -1)[:, joint.idx_v]  # one joint gives a vector
    if np.linalg.norm(column[3:]) > 0.5:
        return _Joint(0, column[3:])
    return _Joint(1, column[:3])


def pack_chain(model: pin.Model) -> JointTable:
    """The joints of `model`. Errors: `RobotError` for a joint with more than one coordinate."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    count = model.njoints
    info, frame = np.zeros((count, 2), dtype=np.int64), np.zeros((count, 15))
    above = np.zeros((count, count), dtype=bool)
    frame[0, :9] = np.eye(3).ravel()
    for j in range(1, count):
        joint = _joint(model, data, j)
        parent = int(model.parents[j])
        info[j] = parent, joint.kind
        placement = model.jointPlacements[j]
        frame[j] = np.concatenate([placement.rotation.ravel(), placement.translation, joint.axis])
        above[j] = above[parent]
        above[j, j] = True
    return JointTable(info, frame, above)


def pack_solids(pieces: Sequence[Piece]) -> Solids:
    """Pieces in the order given (moving ones first)."""
    count = len(pieces)
    info, frame = np.zeros((count, 4), dtype=np.int64), np.zeros((count, 12))
    size = np.zeros((count, 13))
    verts: list[Array] = [np.zeros((0, 3))]
    near: list[int] = []
    near_start = [0]
    for p, piece in enumerate(pieces):
        first = len(near_start) - 1
        info[p] = piece.joint, KINDS[piece.kind], first, len(piece.vertices_m)
        frame[p, :9], frame[p, 9:] = piece.pose[:3, :3].ravel(), piece.pose[:3, 3]
        if piece.kind == "box":
            size[p, :3] = np.array(piece.size_m) / 2
        elif piece.kind == "cylinder":
            size[p, 3:5] = piece.size_m[0], piece.size_m[1] / 2
        elif piece.kind == "sphere":
            size[p, 5] = piece.size_m[0]
        size[p, 6:9], size[p, 9:12] = piece.box_centre_m, piece.box_half_m
        size[p, 12] = piece.ball_radius_m
        verts.append(np.asarray(piece.vertices_m, dtype=float).reshape(-1, 3))
        neighbours: list[set[int]] = [set() for _ in range(len(piece.vertices_m))]
        for a, b, c in piece.faces:
            neighbours[a] |= {b, c}
            neighbours[b] |= {a, c}
            neighbours[c] |= {a, b}
        for around in neighbours:
            near += [first + int(v) for v in sorted(around)]
            near_start.append(len(near))
    return Solids(
        info,
        frame,
        size,
        np.ascontiguousarray(np.vstack(verts)),
        np.array(near_start, dtype=np.int64),
        np.array([*near, 0], dtype=np.int64),
    )


def pack_pairs(
    pieces: Sequence[Piece],
    pairs: Sequence[tuple[str, str]],
    extra_m: Mapping[tuple[str, str], float],
) -> Pairs:
    """All piece pairs of the body pairs, body pairs in order."""
    of_body: dict[str, list[int]] = {}
    for p, piece in enumerate(pieces):
        of_body.setdefault(piece.body, []).append(p)
    rows, body, extra = [], [], []
    for index, (a, b) in enumerate(pairs):
        margin = extra_m.get((a, b), extra_m.get((b, a), 0.0))
        for i in of_body[a]:
            for j in of_body[b]:
                rows.append((i, j))
                body.append(index)
                extra.append(margin)
    return Pairs(
        np.array(rows, dtype=np.int64).reshape(-1, 2),
        np.array(body, dtype=np.int64),
        np.array(extra, dtype=float),
    )
