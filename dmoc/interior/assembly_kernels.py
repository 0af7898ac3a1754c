"""Kernels that put flat derivatives into the stages' blocks."""

from __future__ import annotations

from dmoc.interior.jit import kernel

__all__ = ["add_limits", "place_hessian", "place_rows"]


@kernel
def place_hessian(curves, at, hess):  # type: ignore[no-untyped-def]
    """`hess` (N·F·F,) from upper triangles; `at` (2, ·) are places and mirrored places or −1."""
    for i in range(hess.shape[0]):
        hess[i] = 0.0
    for i in range(curves.shape[0]):
        hess[at[0, i]] += curves[i]
        if at[1, i] >= 0:
            hess[at[1, i]] += curves[i]


@kernel
def place_rows(slopes, source, target, rows):  # type: ignore[no-untyped-def]
    """`rows` ((N+1)·n·F,) from the nonzeros of the momentum rows."""
    for i in range(rows.shape[0]):
        rows[i] = 0.0
    for i in range(source.shape[0]):
        rows[target[i]] += slopes[source[i]]


@kernel
def add_limits(slopes, source, place, start, stage, weight, hess):  # type: ignore[no-untyped-def]
    """Add Σ weight·aaᵀ of the limit rows a to the blocks `hess` (N, F, F) of their stages."""
    for i in range(stage.shape[0]):
        if weight[i] > 0.0:
            k = stage[i]
            for p in range(start[i], start[i + 1]):
                factor = weight[i] * slopes[source[p]]
                for q in range(start[i], start[i + 1]):
                    hess[k, place[p], place[q]] += factor * slopes[source[q]]
