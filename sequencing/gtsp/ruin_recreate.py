"""One annealed run of ruin and recreate on a normal form, in slices that report progress."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sequencing.gtsp.arrays import Arrays
from sequencing.gtsp.construct import insertion_tour
from sequencing.gtsp.rng import stream

HOT = 0.5  # first temperature, in typical edges
COLD = 0.01
LARGEST_RUIN = 15
BLINK = 0.01
SLICE = 20_000


def ruin_recreate(
    arrays: Arrays,
    iterations: int,
    generator: np.random.Generator,
    start: np.ndarray | None = None,
    goal: float = -math.inf,
    hot: float = HOT,
    report: Callable[[int, np.ndarray, float], None] | None = None,
) -> tuple[np.ndarray, float]:
    """Best nodes (M,) and their cost after `iterations`; `report(done, nodes, cost)` each slice."""
    from sequencing.gtsp.ruin_recreate_kernel import anneal

    form = arrays.form
    state = stream(generator)
    current = insertion_tour(arrays, generator, state) if start is None else start.copy()
    best = current.copy()
    cost = math.inf
    for begin in range(0, max(iterations, 1), SLICE):
        end = min(begin + SLICE, iterations)
        cost, done = anneal(
            form.cost, arrays.turned, arrays.into, arrays.outof, form.ptr, form.cluster,
            form.before, form.ordered, form.pinned, arrays.near, current, best, begin, end,
            max(iterations, 1), hot * arrays.scale, COLD * arrays.scale, LARGEST_RUIN, BLINK,
            goal, state,
        )  # fmt: skip
        if report is not None:
            report(done, best, cost)
        if cost <= goal:
            break
    return best, float(cost)
