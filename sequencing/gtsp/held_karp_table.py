"""Generalised Held–Karp (the paper's exact algorithm): the reference for small problems."""

from __future__ import annotations

import math

import numpy as np

from dmoc.errors import ProblemError
from sequencing.gtsp.normalise import NormalForm, normal_form
from sequencing.gtsp.problem import GtspProblem
from sequencing.gtsp.rooted import Rooted, rooted_problems, smallest_first

LARGEST_SUM = 1 << 28
MEMORY_BYTES = 2 << 30
LOW = 6  # clusters whose sets share one gathered matrix: the smallest ones, for they are padded


def held_karp_memory_bytes(problem: GtspProblem) -> int:
    """Bytes of the table that Held–Karp needs for a problem: 4 · n · 2^(m−1).

    n nodes in m clusters besides the depot (or, in a free cycle, besides the smallest cluster).
    """
    return table_bytes(normal_form(problem))


def table_bytes(form: NormalForm) -> int:
    """Bytes of the largest table for a normal form (one root after the other)."""
    clusters, nodes = form.num_clusters - 1, form.num_nodes
    smallest = int(np.diff(form.ptr).min())
    return 4 * (nodes - (1 if form.pinned else smallest)) * 2 ** max(clusters - 1, 0)


def held_karp(
    form: NormalForm, upper: float = math.inf, memory_bytes: int = MEMORY_BYTES
) -> tuple[np.ndarray | None, float]:
    """Best nodes of a normal form (None: there is no tour) and a proven lower bound.

    `upper` is the cost of a known tour (it only sharpens the rounding). Costs are rounded *down*
    to whole multiples of a step of 2^-28 of the largest possible sum, so the bound is proven and
    at most (M · step) below the optimum; whole-number costs keep step 1 and are exact.
    Raises `ProblemError` where the table would need more than `memory_bytes`.
    """
    best_nodes: np.ndarray | None = None
    best = math.inf
    bound = math.inf
    need = table_bytes(form)
    if need > memory_bytes:
        raise ProblemError.of(
            "gtsp-memory",
            field="problem",
            value=f"{form.num_clusters} clusters, a table of {need / 2**30:.2f} GiB",
            legal=f"at most {memory_bytes / 2**30:.2f} GiB",
            fix="method='exact' (bounded dynamic programming), or a higher memory_bytes",
        )
    for rooted in map(smallest_first, rooted_problems(form)):
        nodes, low = _solve_rooted(rooted, upper, form.whole)
        bound = min(bound, low)
        if nodes is not None:
            full = np.concatenate([[rooted.root], rooted.node[nodes]])
            total = math.fsum(form.cost[full, np.roll(full, -1)])
            if total < best:
                best, best_nodes = total, full
    return best_nodes, bound


def _solve_rooted(rooted: Rooted, upper: float, whole: bool) -> tuple[np.ndarray | None, float]:
    """Nodes of a rooted problem and its lower bound (inf and None if it has no tour)."""
    from sequencing.gtsp.held_karp_kernel import INF, fill, trace

    m = len(rooted.ptr) - 1
    finite = np.concatenate(
        [a[np.isfinite(a)] for a in (rooted.cost.ravel(), rooted.leave, rooted.back)]
    )
    if finite.size == 0:
        return None, math.inf
    shift = float(finite.min())
    largest = (m + 1) * (float(finite.max()) - shift)
    if math.isfinite(upper):
        largest = min(largest, upper - (m + 1) * shift)
    step = max(largest, 1e-6 * (float(finite.max()) - shift)) / LARGEST_SUM
    if whole and step <= 0.5:
        step = 0.5  # half-split node costs come in halves
    step = step or 1.0
    cost, leave, back = (_scaled(a, shift, step) for a in (rooted.cost, rooted.leave, rooted.back))
    sizes = np.diff(rooted.ptr)
    base = np.concatenate([[0], np.cumsum(sizes)[:-1]]) * 2 ** max(m - 1, 0)
    table = np.empty(len(rooted.node) * 2 ** max(m - 1, 0), dtype=np.int32)
    fill(cost, rooted.ptr, leave, rooted.needs, base.astype(np.int64), min(m, LOW), table)
    total, nodes = trace(cost, rooted.ptr, back, base.astype(np.int64), table)
    if total >= INF:
        return None, math.inf
    return nodes, float(total) * step + (m + 1) * shift


def _scaled(values: np.ndarray, shift: float, step: float) -> np.ndarray:
    """int32: floor((values − shift) / step); forbidden or beyond the largest sum: 2^29."""
    from sequencing.gtsp.held_karp_kernel import INF

    with np.errstate(invalid="ignore"):
        scaled = np.floor((values - shift) / step * (1.0 + 1e-15))
    scaled[~(scaled <= 2 * LARGEST_SUM - 1)] = int(INF)
    return np.ascontiguousarray(scaled.astype(np.int32))
