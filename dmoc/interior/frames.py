"""Where the entries of a programme's blocks lie in the frames of its stages.

The frame of stage k is (q_{k−1}, q_k, û_{k−1}, h, q_{k+1}, û_k), 5n + 1 places (see
`dmoc.interior.riccati_kernels`). A programme fits if every copy of every block lies in one frame;
sums over the whole motion and a free last velocity do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dmoc.programme.builder import MotionProgramme
from dmoc.programme.transcription import Block, Index


class Entries(NamedTuple):
    """Nonzeros of a Jacobian: `source` in the flat values, global `row` and `column`, `target`.

    `target` is the flat place in the stages' rows (momentum) or a place in the frame (limits).
    """

    source: Index
    row: Index
    column: Index
    target: Index


@dataclass(frozen=True)
class Frames:
    """The blocks of a programme and the places of their values.

    `variables`, `multipliers` gather x and (1, row multipliers) for all copies of all blocks, one
    after another; `rows` is the row of every value, −1 for the objective. `hess_at` (2, ·) are the
    flat places of a Hessian value and of its mirror (−1 on the diagonal) in (N, F, F).
    `limit_start` (L+1,) begins the entries of each limit row, `limit_stage` (L,) is its stage.
    """

    num_intervals: int
    num_joints: int
    blocks: tuple[Block, ...]
    variables: Index
    multipliers: Index
    rows: Index
    objective: Entries
    momentum: Entries
    limit: Entries
    limit_start: Index
    limit_stage: Index
    hess_at: Index

    @property
    def size(self) -> int:
        """Number of variables."""
        return (2 * self.num_intervals + 1) * self.num_joints + 1

    @property
    def num_momentum(self) -> int:
        """Number of momentum rows, which are the first of all rows."""
        return (self.num_intervals + 1) * self.num_joints


def frames_of(motion: MotionProgramme) -> Frames | None:
    """The frames of a programme, or None if a block does not lie in one stage."""
    layout, n = motion.layout, motion.layout.num_joints
    momentum = (layout.num_intervals + 1) * n
    if layout.end_velocity or "rms_torque" in motion.rows:
        return None
    stages = [_stages(block, layout.num_intervals, n) for block in motion.blocks]
    jac, hess = _Flat(), []
    for block, stage in zip(motion.blocks, stages):
        row, column = (np.array(i) for i in block.stage.jac_sparsity.get_triplet())
        columns = block.variables[column].T
        rows = -np.ones_like(columns) if block.rows is None else block.rows[row].T
        limits = np.broadcast_to(stage[:, None], columns.shape)
        at = np.where((rows >= 0) & (rows < momentum), rows // n, limits)
        places = _places(columns, at, layout.num_intervals, n)
        jac.add(rows, columns, places, limits)
        i, j = (np.array(i) for i in block.stage.hess_sparsity.get_triplet())
        if len(i):
            left, right = (
                _places(block.variables[index].T, stage[:, None], layout.num_intervals, n)
                for index in (i, j)
            )
            if min(left.min(), right.min()) < 0:
                return None
            corner = (5 * n + 1) * stage[:, None]
            mirror = np.where(left == right, -1, (corner + right) * (5 * n + 1) + left)
            hess.append(np.stack([((corner + left) * (5 * n + 1) + right), mirror]).reshape(2, -1))
    source, row, column, place, stage = jac.joined()
    if np.any(place[row >= 0] < 0):
        return None
    of_momentum, of_limit = (row >= 0) & (row < momentum), row >= momentum
    order = np.flatnonzero(of_limit)[np.argsort(row[of_limit], kind="stable")]
    count = motion.programme.num_rows - momentum
    first = np.searchsorted(row[order], momentum + np.arange(count + 1))
    limit_stage = np.zeros(count, dtype=np.int64)
    limit_stage[row[order] - momentum] = stage[order]
    flat = row * (5 * n + 1) + place

    def entries(pick: Index, target: Index) -> Entries:
        return Entries(source[pick], row[pick], column[pick], target[pick])

    return Frames(
        num_intervals=layout.num_intervals,
        num_joints=n,
        blocks=motion.blocks,
        variables=np.concatenate([block.variables.T.ravel() for block in motion.blocks]),
        multipliers=np.concatenate([_row_numbers(block) + 1 for block in motion.blocks]),
        rows=np.concatenate([_row_numbers(block) for block in motion.blocks]),
        objective=entries(np.flatnonzero(row < 0), place),
        momentum=entries(np.flatnonzero(of_momentum), flat),
        limit=entries(order, place),
        limit_start=first,
        limit_stage=limit_stage,
        hess_at=np.concatenate(hess, axis=1),
    )


class _Flat:
    """Collects entries of the blocks in the order in which their values come."""

    def __init__(self) -> None:
        self.size = 0
        self.parts: list[tuple[Index, ...]] = []

    def add(self, *columns: Index) -> None:
        count = columns[0].size
        self.parts.append((np.arange(self.size, self.size + count), *(c.ravel() for c in columns)))
        self.size += count

    def joined(self) -> tuple[Index, ...]:
        return tuple(np.concatenate(column) for column in zip(*self.parts))


def _row_numbers(block: Block) -> Index:
    if block.rows is None:
        return np.full(block.copies, -1, dtype=np.int64)
    return block.rows.T.ravel()


def _stages(block: Block, count: int, n: int) -> Index:
    """(K,) the stage of every copy: the last interval that it touches."""
    step = (2 * count + 1) * n
    knot, rest = np.divmod(block.variables, 2 * n)
    last = np.where(rest < n, knot - 1, knot)
    last[block.variables >= step] = 0
    return np.asarray(np.clip(last.max(axis=0), 0, count - 1), dtype=np.int64)


def _places(variables: Index, stage: Index, count: int, n: int) -> Index:
    """Places in the frame of `stage`, −1 for what is not there."""
    knot, rest = np.divmod(variables, 2 * n)
    ahead, is_torque = knot - stage, rest >= n
    place = np.where(
        is_torque, 2 * n + (ahead + 1) * (2 * n + 1) + rest - n, rest + n * (ahead + 1)
    )
    place = np.where((ahead == 1) & ~is_torque, 3 * n + 1 + rest, place)
    place = np.where((ahead < -1) | (ahead > 1) | (is_torque & (ahead == 1)), -1, place)
    return np.asarray(np.where(variables == (2 * count + 1) * n, 3 * n, place), dtype=np.int64)


def places_of_end(count: int, n: int, last_free: int) -> Index:
    """(N+1−m, 5n+1) places of the frames of stages m..N in (state of m, q_K, û_m, …, û_{N−1}).

    K = `last_free` is the last knot that is free, m = K − 1; −1 for what is fixed or not there.
    """
    first, state = last_free - 1, 3 * n + 1
    joints, none = np.arange(n), np.full(n, -1)
    knots = {first - 1: joints, first: n + joints, last_free: state + joints}
    torques = {first - 1: 2 * n + joints}
    torques |= {k: state + n * (k - first + 1) + joints for k in range(first, count)}
    rows = [
        np.concatenate(
            [
                knots.get(k - 1, none),
                knots.get(k, none),
                torques.get(k - 1, none),
                [3 * n],
                knots.get(k + 1, none),
                torques.get(k, none),
            ]
        )
        for k in range(first, count + 1)
    ]
    return np.array(rows, dtype=np.int64)
