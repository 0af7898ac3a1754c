"""The cost table of the lazy loop: what is known, bounded and estimated of every travel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from dmoc.errors import ProblemError
from sequencing.gtsp.problem import GtspProblem
from sequencing.gtsp.validation import closure

MIN_CALIBRATION = 6


class CostOracle(Protocol):
    """Costs of travels, asked in batches. `pairs` (K, 2) int64 are (from node, to node).

    bound     cheap; a proven lower bound of `evaluate` when the loop is told `strict=True`.
    estimate  cheap; the best guess, ideally within some per cent of `evaluate`.
    evaluate  expensive; the true cost. Called once for each pair.
    inf means that the travel is impossible. A NaN from any of them is a `ProblemError`.
    """

    def bound(self, pairs: np.ndarray) -> np.ndarray: ...

    def estimate(self, pairs: np.ndarray) -> np.ndarray: ...

    def evaluate(self, pairs: np.ndarray) -> np.ndarray: ...


class CostTable:
    """(V, V) tables of an oracle's answers for the travels that a tour of `problem` can use.

    true is NaN where nothing was evaluated. With `symmetric`, u → v stands for v → u as well.
    """

    def __init__(self, problem: GtspProblem, oracle: CostOracle, symmetric: bool) -> None:
        self.problem = problem
        self.oracle = oracle
        self.symmetric = symmetric
        self.evaluations = 0
        self.violations = 0
        self.usable = usable_travels(problem)
        pairs = np.argwhere(self.usable | self.usable.T if symmetric else self.usable)
        if symmetric:
            pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        self.pairs = pairs
        size = problem.num_nodes
        self.true = np.full((size, size), np.nan)
        self.bound = np.full((size, size), np.inf)
        self.estimate = np.full((size, size), np.inf)
        bounds = checked(oracle.bound(pairs), pairs, "bound")
        guesses = checked(oracle.estimate(pairs), pairs, "estimate")
        self._put(self.bound, pairs, bounds)
        self._put(self.estimate, pairs, np.where(np.isinf(bounds), np.inf, guesses))

    def _put(self, table: np.ndarray, pairs: np.ndarray, values: np.ndarray) -> None:
        table[pairs[:, 0], pairs[:, 1]] = values
        if self.symmetric:
            table[pairs[:, 1], pairs[:, 0]] = values

    def load(self, known: Mapping[tuple[int, int], float]) -> None:
        """Take over costs evaluated earlier; travels that are not of this problem are left out."""
        size = self.problem.num_nodes
        inside = [(u, v) for u, v in known if 0 <= u < size and 0 <= v < size and u != v]
        if not inside:
            return
        pairs = np.array(inside, dtype=np.int64)
        values = checked(np.array([known[pair] for pair in inside]), pairs, "known")
        self._store(pairs, values)

    def known(self) -> dict[tuple[int, int], float]:
        """All evaluated travels, in order: give it to `load` to resume."""
        pairs = self.pairs[~np.isnan(self.true[self.pairs[:, 0], self.pairs[:, 1]])]
        return {(int(u), int(v)): float(self.true[u, v]) for u, v in pairs}

    def unknown_of(self, nodes: tuple[int, ...]) -> list[tuple[int, int]]:
        """Travels of a tour that are not yet evaluated, in canonical direction."""
        edges = self.problem.edges(nodes)
        new = edges[np.isnan(self.true[edges[:, 0], edges[:, 1]])]
        if self.symmetric:
            new = np.sort(new, axis=1)
        return [(int(u), int(v)) for u, v in new]

    def evaluate(self, wanted: list[tuple[int, int]]) -> int:
        """Evaluate travels in one batch, each once; returns how many."""
        unique = list(dict.fromkeys(wanted))
        if not unique:
            return 0
        pairs = np.array(unique, dtype=np.int64)
        self._store(pairs, checked(self.oracle.evaluate(pairs), pairs, "evaluate"))
        self.evaluations += len(unique)
        return len(unique)

    def _store(self, pairs: np.ndarray, values: np.ndarray) -> None:
        lows = self.bound[pairs[:, 0], pairs[:, 1]]
        with np.errstate(invalid="ignore"):
            below = values < lows - 1e-9 * np.maximum(np.abs(lows), 1e-9)
        below |= np.isinf(lows) & np.isfinite(values)
        self.violations += int((below & self.usable[pairs[:, 0], pairs[:, 1]]).sum())
        self._put(self.true, pairs, values)

    def calibration(self) -> float:
        """Median of true cost / estimate over the evaluated travels; 1 while there are few."""
        u, v = self.pairs[:, 0], self.pairs[:, 1]
        true, guess = self.true[u, v], self.estimate[u, v]
        use = np.isfinite(true) & np.isfinite(guess) & (guess > 0) & (true > 0)
        if use.sum() < MIN_CALIBRATION:
            return 1.0
        return float(np.median(true[use] / guess[use]))

    def mixed(self, unknown: np.ndarray) -> np.ndarray:
        """(V, V): the true cost where known, else `unknown`; inf where no tour can travel."""
        cost = np.where(np.isnan(self.true), unknown, self.true)
        return np.where(self.usable, cost, np.inf)

    def expected(self) -> np.ndarray:
        """(V, V) the calibrated estimate, never below the bound."""
        return np.maximum(self.estimate * self.calibration(), self.bound)

    def conditional(self, factor: float | np.ndarray, strict: bool) -> np.ndarray:
        """(V, V) factor × estimate, or the bound where that is strict and higher."""
        low = factor * self.estimate
        return np.maximum(low, self.bound) if strict else low


def usable_travels(problem: GtspProblem) -> np.ndarray:
    """(V, V) bool: travels (exit node, entry node) that some admissible tour may contain."""
    size = problem.num_nodes
    cluster = problem.cluster_of
    entry = np.isfinite(problem.node_cost)
    for special in (problem.home, problem.start, problem.end):
        if special is not None:
            entry = entry & ((cluster != cluster[special]) | (np.arange(size) == special))
    leaves = np.zeros(size, dtype=bool)
    arrives = entry.copy()
    may_leave = entry.copy()
    if problem.end is not None:
        may_leave &= cluster != cluster[problem.end]
    if problem.start is not None:
        arrives &= cluster != cluster[problem.start]
    leaves[problem.exit_of[may_leave]] = True
    usable = np.isfinite(problem.cost) & leaves[:, None] & arrives[None, :]
    if problem.num_clusters > 1:
        usable &= cluster[:, None] != cluster[None, :]
    np.fill_diagonal(usable, False)
    if problem.precedence and (problem.path or problem.home is not None):
        before = closure(problem.precedence, problem.num_clusters)
        if problem.home is not None:  # every cluster may return home
            before[cluster[problem.home]] = False
        usable &= ~before.T[np.ix_(cluster, cluster)]
    return usable


def checked(values: np.ndarray, pairs: np.ndarray, what: str) -> np.ndarray:
    """The answer of an oracle as float64 (K,), or a `ProblemError` that names the pair."""
    out = np.asarray(values, dtype=np.float64)
    if out.shape != (len(pairs),):
        raise ProblemError.of(
            "oracle-shape",
            field=what,
            value=f"shape {out.shape}",
            legal=f"({len(pairs)},), one cost for each pair",
        )
    wrong = np.flatnonzero(np.isnan(out) | np.isneginf(out))
    if wrong.size:
        u, v = pairs[wrong[0]]
        raise ProblemError.of(
            "oracle-value",
            field=f"{what}({u}, {v})",
            value=str(out[wrong[0]]),
            legal="finite, or inf for an impossible travel",
        )
    return out
