"""What the heuristics' kernels need of a normal form, prepared once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dmoc.jit import njit
from sequencing.gtsp.normalise import NormalForm


def stream(generator: np.random.Generator) -> np.ndarray:
    """A fresh stream (1,) uint64."""
    return generator.integers(0, 2**63, size=1, dtype=np.uint64)


@njit
def uniform(state):  # type: ignore[no-untyped-def]
    """Next number in [0, 1)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return np.float64(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit
def below(state, n):  # type: ignore[no-untyped-def]
    """Next whole number in 0 … n−1."""
    return min(int(uniform(state) * n), n - 1)


class FormTables(NamedTuple):
    """Parts of the normal form, and turned (N, N) costᵀ; into (M, N) least cost from a node into a
    cluster; outof (M, N) least cost from a cluster into a node; near (M, K) clusters by least
    distance."""

    cost: np.ndarray
    turned: np.ndarray
    into: np.ndarray
    outof: np.ndarray
    ptr: np.ndarray
    cluster: np.ndarray
    before: np.ndarray
    ordered: bool
    pinned: bool
    near: np.ndarray


@dataclass(frozen=True, eq=False)
class Arrays:
    """A normal form, its tables, and a typical edge of a good tour as the scale."""

    form: NormalForm
    tables: FormTables
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
    tables = FormTables(
        cost,
        np.ascontiguousarray(cost.T),
        np.ascontiguousarray(into.T),
        outof,
        form.ptr,
        form.cluster,
        form.before,
        form.ordered,
        form.pinned,
        np.ascontiguousarray(near, dtype=np.int64),
    )
    return Arrays(form, tables, scale or 1.0)
