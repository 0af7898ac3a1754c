"""What the heuristics' kernels need of a normal form, prepared once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sequencing.gtsp.normal_form import NormalForm


@dataclass(frozen=True, eq=False)
class Arrays:
    """turned (N, N) costᵀ; into (M, N) least cost from a node into a cluster; outof (M, N) least
    cost from a cluster into a node; near (M, K) clusters by least distance; scale: a typical
    edge of a good tour."""

    form: NormalForm
    turned: np.ndarray
    into: np.ndarray
    outof: np.ndarray
    near: np.ndarray
    scale: float


NEIGHBOURS = 30


def prepare(form: NormalForm) -> Arrays:
    """Tables of a normal form for the heuristics."""
    cost = form.cost
    begins = form.ptr[:-1]
    into = np.minimum.reduceat(cost, begins, axis=1)
    outof = np.ascontiguousarray(np.minimum.reduceat(cost, begins, axis=0))
    between = np.minimum.reduceat(into, begins, axis=0)
    between = np.minimum(between, between.T)
    np.fill_diagonal(between, np.inf)
    near = np.argsort(between, axis=1, kind="stable")[:, : min(NEIGHBOURS, form.num_clusters - 1)]
    nearest = between.min(axis=1)
    nearest = nearest[nearest < form.penalty / 2]
    scale = float(np.abs(nearest).mean()) if nearest.size else 1.0
    return Arrays(
        form=form,
        turned=np.ascontiguousarray(cost.T),
        into=np.ascontiguousarray(into.T),
        outof=outof,
        near=np.ascontiguousarray(near, dtype=np.int64),
        scale=scale or 1.0,
    )
