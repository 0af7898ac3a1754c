"""Kernels that put flat derivatives into the stages' blocks."""

from __future__ import annotations

from dmoc.jit import njit


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
