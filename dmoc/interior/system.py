"""The Newton system of one programme: memory of its factor, inertia correction, solves."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.interior.end_kernels import End, factorise_end, finish_end, start_from_end
from dmoc.interior.frames import Frames, places_of_end
from dmoc.interior.riccati_kernels import Factor, factorise, solve
from dmoc.jit import njit

FIRST_SHIFT = 1e-4
SMALLEST_SHIFT = 1e-20
LARGEST_SHIFT = 1e20
FIRST_GROWTH = 100.0
GROWTH = 8.0
DECAY = 1.0 / 3.0


@njit
def place_hessian(curves, at, hess):  # type: ignore[no-untyped-def]
    """`hess` (N·F·F,) from upper triangles; `at` (2, ·) are places and mirrored places or −1."""
    for i in range(hess.shape[0]):
        hess[i] = 0.0
    for i in range(curves.shape[0]):
        hess[at[0, i]] += curves[i]
        if at[1, i] >= 0:
            hess[at[1, i]] += curves[i]


@njit
def place_rows(slopes, source, target, rows):  # type: ignore[no-untyped-def]
    """`rows` ((N+1)·n·F,) from the nonzeros of the momentum rows."""
    for i in range(rows.shape[0]):
        rows[i] = 0.0
    for i in range(source.shape[0]):
        rows[target[i]] += slopes[source[i]]


@njit
def add_limits(slopes, limit, start, stage, weight, dense, hess):  # type: ignore[no-untyped-def]
    """Add Σ weight·aaᵀ of the limit rows a to the blocks `hess` (N, F, F) of their stages.

    `dense` (F,) is workspace, all zero before and after.
    """
    source, place = limit.source, limit.target
    for i in range(stage.shape[0]):
        if weight[i] > 0.0:
            k = stage[i]
            for p in range(start[i], start[i + 1]):
                dense[place[p]] = slopes[source[p]]
            for p in range(start[i], start[i + 1]):
                row, factor = place[p], weight[i] * slopes[source[p]]
                for j in range(dense.shape[0]):
                    hess[k, row, j] += factor * dense[j]
            for p in range(start[i], start[i + 1]):
                dense[place[p]] = 0.0


@njit
def momentum_pull(rows, y, n, frame, pull):  # type: ignore[no-untyped-def]
    """Jᵀy (size,) of the momentum rows, from their blocks `rows` (N+1, n, F); `frame` (F,)."""
    count, size_f = rows.shape[0] - 1, rows.shape[2]
    state, step = 3 * n + 1, (2 * count + 1) * n
    for i in range(pull.shape[0]):
        pull[i] = 0.0
    for k in range(count + 1):
        for j in range(size_f):
            frame[j] = 0.0
        for i in range(n):
            factor = y[k * n + i]
            for j in range(size_f):
                frame[j] += factor * rows[k, i, j]
        at = 2 * n * k
        for i in range(n):
            pull[at + i] += frame[n + i]
        if k > 0:
            for i in range(n):
                pull[at - 2 * n + i] += frame[i]
                pull[at - n + i] += frame[2 * n + i]
        if k < count:
            for i in range(n):
                pull[at + 2 * n + i] += frame[state + i]
                pull[at + n + i] += frame[state + n + i]
        pull[step] += frame[3 * n]


class NewtonSystem:
    """Stage blocks and factor for one pattern of free knots, K = `last_free` the last of them."""

    def __init__(self, frames: Frames, last_free: int) -> None:
        count, n = frames.num_intervals, frames.num_joints
        state, wide, full = 3 * n + 1, 4 * n + 1, 5 * n + 1
        many = (count - last_free + 2) * n
        self.frames = frames
        self.hess = np.zeros((count, full, full))
        self.rows = np.zeros((count + 1, n, full))
        self.shift = 0.0
        self._place = places_of_end(count, n, last_free)
        self._first = last_free - 1
        self._factor = Factor(
            np.zeros((count, n, wide)),
            np.zeros((count, n, state)),
            np.zeros((count, n, n)),
            np.zeros((count, n, wide)),
            np.zeros((count, n, n)),
        )
        self._end = End(
            np.zeros((many, many)),
            np.zeros(many, dtype=np.int64),
            np.zeros((many, state)),
            np.zeros((many, many + state)),
        )
        self._frame, self._value = np.zeros((full, full)), np.zeros((state, state))
        self._scratch, self._end_scratch = np.zeros((n, wide)), np.zeros((state + many,) * 2)
        self._push, self._known = np.zeros((3, count, n)), np.zeros((3, full))
        self._end_known = np.zeros((3, many))
        self._dense = np.zeros(full)
        self._pivot = 0.0
        self._last_shift = 0.0

    def restart(self) -> None:
        """Forget the shifts of an earlier problem: no result depends on what came before."""
        self._last_shift = 0.0

    def set_rows(self, slopes: Array) -> None:
        """Momentum rows from the flat Jacobian."""
        momentum = self.frames.momentum
        place_rows(slopes, momentum.source, momentum.target, self.rows.reshape(-1))

    def pull(self, y: Array, out: Array) -> None:
        """`out` (size,) becomes Jᵀy of the momentum rows set last."""
        momentum_pull(self.rows, y, self.frames.num_joints, np.empty(self.rows.shape[2]), out)

    def set_hessian(self, curves: Array, slopes: Array, weight: Array) -> None:
        """Stage Hessians with the limit rows condensed, each with its `weight` (L,)."""
        frames = self.frames
        place_hessian(curves, frames.hess_at, self.hess.reshape(-1))
        self._add_limits(slopes, weight)

    def set_identity(self, slopes: Array, weight: Array) -> None:
        """No curvature but that of the limit rows; the identity comes as the diagonal."""
        self.hess[:] = 0.0
        self._add_limits(slopes, weight)

    def _add_limits(self, slopes: Array, weight: Array) -> None:
        frames, limit = self.frames, self.frames.limit
        if len(weight):
            add_limits(
                slopes,
                limit,
                frames.limit_start,
                frames.limit_stage,
                weight,
                self._dense,
                self.hess,
            )

    def factorise(self, sigma: Array, fixed: Array) -> bool:
        """Factor with the smallest of a few shifts for which the inertia is right.

        `sigma` (≥ size,) is added to the diagonal, `fixed` (size,) marks variables without a step.
        False if the rows are dependent or no shift does.
        """
        self._fixed, n = fixed, self.frames.num_joints
        shift = 0.0
        while True:
            if not factorise_end(
                self.hess,
                self.rows,
                sigma,
                shift,
                self._place,
                n,
                self._first,
                self._end,
                self._value,
                self._end_scratch,
            ):
                return False
            self._pivot = factorise(
                self.hess,
                self.rows,
                sigma,
                shift,
                fixed,
                self._first,
                n,
                self._factor,
                self._frame,
                self._value,
                self._scratch,
            )
            if self._pivot > 0.0:
                break
            if shift == 0.0:
                last = self._last_shift
                shift = FIRST_SHIFT if last == 0.0 else max(SMALLEST_SHIFT, DECAY * last)
            else:
                shift *= FIRST_GROWTH if self._last_shift == 0.0 else GROWTH
            if shift > LARGEST_SHIFT:
                return False
        if shift > 0.0:
            self._last_shift = shift
        self.shift = shift
        return True

    def solve(self, gradient: Array, defect: Array) -> tuple[Array, Array]:
        """x (size,) and multipliers of the momentum rows for a gradient and their defect."""
        frames, n, first = self.frames, self.frames.num_joints, self._first
        x, lam = np.empty(frames.size), np.empty((frames.num_intervals + 1, n))
        defect = defect.reshape(lam.shape)
        end, known = (self._end, self._end_known, self._known), self._known
        start_from_end(gradient, defect, n, first, *end)
        pivot, fixed, factor = self._pivot, self._fixed, self._factor
        solve(
            self.rows, gradient, defect, pivot, fixed, first, n, factor, self._push, known, x, lam
        )
        finish_end(n, first, *end, x, lam)
        return x, lam.reshape(-1)
