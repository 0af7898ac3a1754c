"""The lazy loop: find the best tour while evaluating few of the expensive travel costs.

Three phases. *Estimate*: travels not yet evaluated cost their calibrated estimate; the best tours
are evaluated until the best one holds nothing unevaluated. *Refute*: unevaluated travels cost
their bound, the least they may cost; every tour that could still beat the best one is evaluated.
*Certify*: no such tour is found any more, and an exact minimisation proves that there is none
(or finds one, and the loop goes on). The scheme is section 2.1 of Björkenstam et al.; evaluating
several diverse tours in one batch is ours.

A number is called a *lower bound* only if it is proven: the oracle's bounds are strict (`strict`)
and the minimisation was exact or a proven relaxation. Where bounds are not strict the loop can
work on the *condition* that no unevaluated travel costs less than `factor` × its estimate; what
follows from that is reported separately, as conditional.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dmoc.arrays import Array
from sequencing.cycle.lazy_costs import CostOracle, CostTable
from sequencing.cycle.lazy_result import (
    LazyResult,
    LazyRound,
    LazyStop,
    Phase,
    Status,
    relative_gap,
)
from sequencing.gtsp.portfolio import admissible_cost, solve
from sequencing.gtsp.problem import GtspProblem, Tour
from sequencing.gtsp.stop import Stop

SOLVED = 1e-9  # relative: a mixed cost this close to the best tour's does not beat it


def solve_lazily(
    problem: GtspProblem,
    oracle: CostOracle,
    stop: LazyStop | None = None,
    seed: int = 0,
    *,
    known: Mapping[tuple[int, int], float] | None = None,
    strict: bool = True,
    symmetric: bool = False,
    factor: float | Array = 0.9,
    tours: int = 4,
    iterations: int | None = None,
    exact: Stop | None = None,
    bound_each_round: bool = True,
    callback: Callable[[LazyRound], None] | None = None,
) -> LazyResult:
    """The best tour of `problem` under the oracle's true costs, with few evaluations.

    problem     clusters, node costs, home, ends, precedence, exit nodes. Of its `cost` only
                forbidden entries (inf) count; finite ones are replaced by the oracle's.
    oracle      `CostOracle`; pairs are (exit node, entry node), in batches.
    known       {(from, to): true cost} of earlier runs; never evaluated again.
    strict      the oracle's bounds are proven lower bounds of its true costs.
    symmetric   travel u → v costs the same as v → u: only u < v is asked, and stands for both.
    factor      of the condition: an unevaluated travel costs at least factor × estimate; one for
                all, or (V, V) of them.
    tours       diverse tours evaluated in one batch.
    iterations  of the heuristic in each minimisation (default 1000 × clusters).
    exact       limits of the exact minimisation (`Stop(states=…)`).
    bound_each_round  also compute a relaxation's lower bound in every round.
    callback    receives the `LazyRound` of each batch.

    The same arguments give the same result; resuming with `known` continues from those costs.
    Raises `ProblemError` for NaN or misshapen answers of the oracle.
    """
    loop = _Loop(
        problem=problem,
        stop=stop or LazyStop(),
        table=CostTable(problem, oracle, symmetric),
        generator=np.random.default_rng(seed),
        strict=strict,
        factor=factor,
        tours=max(1, tours),
        iterations=iterations or 1000 * problem.num_clusters,
        exact=exact or Stop(),
        bound_each_round=bound_each_round,
        callback=callback,
    )
    if known:
        loop.table.load(known)
    status = loop.run()
    return loop.result(status)


@dataclass
class _Loop:
    """The changing state of one call."""

    problem: GtspProblem
    stop: LazyStop
    table: CostTable
    generator: np.random.Generator
    strict: bool
    factor: float | Array
    tours: int
    iterations: int
    exact: Stop
    bound_each_round: bool
    callback: Callable[[LazyRound], None] | None
    best: tuple[int, ...] = ()
    upper: float = math.inf
    proven_bound: float = -math.inf
    conditional_bound: float = -math.inf
    impossible: bool = False
    warm: list[tuple[int, ...]] = field(default_factory=list)
    rounds: list[LazyRound] = field(default_factory=list)

    def run(self) -> Status:
        self._harvest()  # resumed costs may already hold a whole tour
        return self._phase("estimate") or self._phase("refute") or "open"

    def result(self, status: Status) -> LazyResult:
        table = self.table
        bound = self._strict_bound()
        proven = self.impossible and not self.best
        if self.best:
            bound = min(bound, self.upper)
            proven = bound >= self.upper - 1e-7 * self._magnitude()
        tour = Tour(self.best, self.upper, bound, proven, f"lazy, {status}")
        return LazyResult(
            tour=tour,
            status=status,
            conditional_bound=self.conditional_bound,
            rounds=tuple(self.rounds),
            evaluations=table.evaluations,
            violations=table.violations,
            calibration=table.calibration(),
            known=table.known(),
        )

    def _phase(self, phase: Phase) -> Status | None:
        """Batches of one phase until it is exhausted (None) or the loop ends (its status)."""
        if phase == "refute":
            self._relax(self._costs(phase))
            if self.best and self._reached():
                self._report("refute", self.upper, 0)
                return self._reached()
        while True:
            costs = self._costs(phase)
            batch, minimum = self._candidates(costs, phase)
            if not batch and phase == "estimate":
                return None
            label: Phase = phase
            if not batch:  # the heuristic knows nothing better: let the exact solver look
                label = "certify"
                nodes, complete = self._certify(costs)
                batch = self.table.unknown_of(nodes) if nodes else []
                if nodes and not batch:  # evaluated throughout, and the heuristic missed it
                    self.warm.append(nodes)
                    self._harvest()
                    continue
                if not batch:
                    self._report(label, minimum, 0)
                    return self._ending(complete)
            room = self._room()
            done = self.table.evaluate(batch[:room])
            if self._lower_than(costs, batch[:room]):
                self.conditional_bound = self.proven_bound
            self._harvest()
            if phase == "refute" and self.bound_each_round and label == "refute":
                self._relax(self._costs(phase))
            self._report(label, minimum, done)
            status = self._finished()
            if status is not None:
                return status

    def _lower_than(self, costs: np.ndarray, batch: list[tuple[int, int]]) -> bool:
        """True if a travel turned out cheaper than a bound assumed: bounds so found are void."""
        return any(self.table.true[u, v] < costs[u, v] for u, v in batch)

    def _costs(self, phase: Phase) -> np.ndarray:
        table = self.table
        if phase == "estimate":
            return table.mixed(table.expected())
        if self._conditional:
            return table.mixed(table.conditional(self.factor, self.strict))
        return table.mixed(table.bound)

    @property
    def _conditional(self) -> bool:
        return self.stop.kind == "conditional" or not self.strict

    def _solve(self, cost: np.ndarray, method: str, stop: Stop) -> Tour:
        """One minimisation under mixed costs, warm from the tours at hand."""
        seed = int(self.generator.integers(2**31))
        initial = ([self.best] if self.best else []) + self.warm
        return solve(self.problem.replace(cost=cost), stop, seed, method=method, initial=initial)

    def _candidates(self, cost: np.ndarray, phase: Phase) -> tuple[list[tuple[int, int]], float]:
        """Unevaluated travels of up to `tours` tours that may beat the best; the least cost.

        After each tour its unevaluated travels take their expected cost, so that the next tour
        differs where the answer of the first cannot be foreseen.
        """
        cost = cost.copy()
        expected = self.table.expected()
        wanted: list[tuple[int, int]] = []
        minimum = math.inf
        found: list[tuple[int, ...]] = []
        for _ in range(self.tours):
            tour = self._solve(cost, "heuristic", Stop(iterations=self.iterations))
            if not tour.found:
                break
            minimum = min(minimum, tour.cost)
            new = self.table.unknown_of(tour.nodes)
            if not new or tour.cost >= self._target(phase):
                break
            found.append(tour.nodes)
            wanted += new
            for u, v in new:
                raised = max(expected[u, v], cost[u, v] * 1.05, cost[u, v] + 1e-9)
                cost[u, v] = raised
                if self.table.symmetric:
                    cost[v, u] = raised
        if found:
            self.warm = found
        return wanted, minimum

    def _target(self, phase: Phase) -> float:
        """A tour must cost less than this to be worth evaluating."""
        slack = SOLVED if phase == "estimate" else max(SOLVED, self.stop.gap)
        return self.upper - slack * abs(self.upper) if self.best else math.inf

    def _certify(self, cost: np.ndarray) -> tuple[tuple[int, ...], bool]:
        """Exact minimum under mixed costs: a tour that beats the best, if any; finished or not."""
        tour = self._solve(cost, "exact", self.exact)
        self._raise_bound(tour.lower_bound)
        if not tour.found:
            self.impossible = tour.proven
            return (), tour.proven
        better = tour.cost < self._target("refute")
        return (tour.nodes if better else ()), tour.proven

    def _relax(self, cost: np.ndarray) -> None:
        limits = Stop(iterations=0, states=0, memory_bytes=self.exact.memory_bytes)
        self._raise_bound(self._solve(cost, "exact", limits).lower_bound)

    def _raise_bound(self, bound: float) -> None:
        """A minimum of mixed costs stays a lower bound: evaluation only raises costs."""
        if self._conditional:
            self.conditional_bound = max(self.conditional_bound, bound)
        else:
            self.proven_bound = max(self.proven_bound, bound)
            self.conditional_bound = max(self.conditional_bound, bound)

    def _strict_bound(self) -> float:
        if not self.strict or self.table.violations:
            return -math.inf
        complete = self.conditional_bound if self._nothing_assumed() else -math.inf
        return max(self.proven_bound, complete)

    def _nothing_assumed(self) -> bool:
        """True if every travel of the problem is evaluated: then no condition is left."""
        return not np.isnan(self.table.true[self.table.usable]).any()

    def _harvest(self) -> None:
        """Best tour over evaluated travels only, from all tours at hand."""
        cost = self.table.mixed(np.full_like(self.table.true, np.inf))
        known = self.problem.replace(cost=cost)
        for nodes in self.warm:
            self._offer(nodes, known)
        if self.best or np.isfinite(cost).sum() >= self.problem.num_clusters:
            tour = self._solve(cost, "heuristic", Stop(iterations=self.iterations // 4))
            self._offer(tour.nodes, known)

    def _offer(self, nodes: tuple[int, ...], known: GtspProblem) -> None:
        cost = admissible_cost(known, nodes)
        if cost < self.upper:
            self.best, self.upper = nodes, cost

    def _room(self) -> int | None:
        if self.stop.evaluations is None:
            return None
        return max(0, self.stop.evaluations - self.table.evaluations)

    def _finished(self) -> Status | None:
        if self.stop.evaluations is not None and self._room() == 0:
            return "evaluation_limit"
        if self.stop.rounds is not None and len(self.rounds) >= self.stop.rounds:
            return "round_limit"
        if self.best and self.rounds[-1].phase != "estimate":
            return self._reached()
        return None

    def _reached(self) -> Status | None:
        conditional = self.stop.kind == "conditional"
        bound = self.conditional_bound if conditional else self._strict_bound()
        if self._strict_bound() >= self.upper - 1e-7 * self._magnitude():
            return "proven"
        return "gap" if relative_gap(self.upper, bound) <= self.stop.gap + 1e-12 else None

    def _ending(self, complete: bool) -> Status:
        if not self.best:
            return "no_tour"
        return self._reached() or ("gap" if complete and self._conditional else "open")

    def _magnitude(self) -> float:
        cost = self.table.mixed(np.full_like(self.table.true, np.inf))
        return self.problem.replace(cost=cost).tour_magnitude(self.best)

    def _report(self, phase: Phase, minimum: float, done: int) -> None:
        round_ = LazyRound(
            index=len(self.rounds),
            phase=phase,
            upper_bound=self.upper,
            lower_bound=min(self._strict_bound(), self.upper),
            conditional_bound=min(self.conditional_bound, self.upper),
            minimum=minimum,
            evaluations=self.table.evaluations,
            batch=done,
        )
        self.rounds.append(round_)
        if self.callback is not None:
            self.callback(round_)
