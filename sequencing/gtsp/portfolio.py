"""The one entry of the package: `solve` picks and combines the methods."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dmoc.errors import Fault, ProblemError
from sequencing.gtsp.bounded_dp import bounded_dp
from sequencing.gtsp.held_karp import held_karp, table_bytes
from sequencing.gtsp.normal_form import NormalForm, normal_form
from sequencing.gtsp.problem import GtspProblem, Tour, as_tours
from sequencing.gtsp.stop import EFFORTS, Callback, Incumbent, Stop

__all__ = ["solve"]

METHODS = ("auto", "heuristic", "exact", "held-karp", "ruin-recreate")
PROOF_TOLERANCE = 1e-7
SMALL_TABLE_BYTES = 4 << 20  # Held–Karp takes milliseconds


def solve(
    problem: GtspProblem,
    stop: Stop | int | None = None,
    seed: int = 0,
    *,
    method: str = "auto",
    effort: str = "normal",
    initial: Sequence[Tour | Sequence[int]] = (),
    callback: Callback | None = None,
) -> Tour:
    """The best tour found, with a proven lower bound where the method gives one.

    stop      `Stop`, or a number of heuristic iterations, or None (as `effort` says).
    seed      same problem, seed and limits: same tour.
    method    'auto' (heuristic), 'held-karp' (proof, small problems), 'ruin-recreate'.
    effort    'quick', 'normal' or 'thorough'.
    initial   tours to start from; those that do not fit the problem are left out.
    callback  receives an `Incumbent` from time to time.

    A problem without any tour is an answer, not an error: `Tour.found` is False, and `proven`
    says whether that is certain. Raises `ProblemError` for unknown options and where Held–Karp
    would need more memory than allowed.
    """
    _check(method, METHODS, "method")
    _check(effort, EFFORTS, "effort")
    limits = Stop(iterations=stop) if isinstance(stop, int) else stop or Stop()
    form = normal_form(problem)
    if form.empty:
        return Tour((), math.inf, math.inf, True, "a cluster has no available node")
    if problem.num_clusters == 1:
        return _one_cluster(problem, form)
    generator = np.random.default_rng(seed)
    start = [n for n in map(form.lower, as_tours(initial)) if n is not None]
    nodes, cost = _heuristic(problem, form, limits, effort, generator, start, callback)
    small = table_bytes(form) <= SMALL_TABLE_BYTES
    if method == "held-karp" or (small and method in ("auto", "exact")):
        exact, bound = held_karp(form, cost, limits.memory_bytes)
        if exact is None:
            return Tour((), math.inf, bound, True, "held-karp")
        return finish(problem, form, form.lift(exact), bound, "held-karp")
    if method == "exact":
        tolerance = 0.5 if form.whole else 1e-9 * problem.tour_magnitude(nodes)
        exact, bound = bounded_dp(form, cost, tolerance, limits.states, limits.memory_bytes)
        if exact is not None:
            nodes = form.lift(exact)
        return finish(problem, form, nodes, bound, "bounded-dp")
    return finish(problem, form, nodes, -math.inf, "ruin-recreate")


def finish(
    problem: GtspProblem, form: NormalForm, nodes: tuple[int, ...], bound: float, method: str
) -> Tour:
    """A tour with its cost recomputed from the problem and its proof checked."""
    cost = admissible_cost(problem, nodes)
    if not math.isfinite(cost):
        return Tour((), math.inf, bound, bound == math.inf, method)
    if form.whole and math.isfinite(bound):
        bound = math.ceil(bound - 1e-6)
    proven = bound >= cost - PROOF_TOLERANCE * problem.tour_magnitude(nodes)
    return Tour(nodes, cost, min(bound, cost), proven, method)


def admissible_cost(problem: GtspProblem, nodes: Sequence[int]) -> float:
    """Cost of an admissible tour, inf for anything else."""
    if not nodes or problem.faults(nodes):
        return math.inf
    return problem.tour_cost(nodes)


def _heuristic(
    problem: GtspProblem,
    form: NormalForm,
    limits: Stop,
    effort: str,
    generator: np.random.Generator,
    start: list[np.ndarray],
    callback: Callback | None,
) -> tuple[tuple[int, ...], float]:
    from sequencing.gtsp.arrays import prepare
    from sequencing.gtsp.ruin_recreate import ruin_recreate

    iterations = limits.iterations
    if iterations is None:
        iterations = {"quick": 10_000, "normal": 60_000, "thorough": 400_000}[effort]
    count = 0

    def report(done: int, nodes: np.ndarray, cost: float) -> None:
        nonlocal count
        count += done
        if callback is not None:
            lifted = form.lift(nodes)
            callback(Incumbent(count, lifted, admissible_cost(problem, lifted)))

    best, _ = ruin_recreate(
        prepare(form), iterations, generator, start[0] if start else None,
        limits.target_cost, report=report,
    )  # fmt: skip
    nodes = form.lift(best)
    true_cost = admissible_cost(problem, nodes)
    return (nodes, true_cost) if math.isfinite(true_cost) else ((), math.inf)


def _one_cluster(problem: GtspProblem, form: NormalForm) -> Tour:
    nodes = [int(v) for v in form.origin if v >= 0]
    costs = [problem.tour_cost([v]) for v in nodes]
    best = int(np.argmin(costs)) if costs else 0
    if not costs or not math.isfinite(costs[best]):
        return Tour((), math.inf, math.inf, True, "one cluster")
    return Tour((nodes[best],), costs[best], costs[best], True, "one cluster")


def _check(value: str, legal: Sequence[str], field: str) -> None:
    if value not in legal:
        raise ProblemError(
            Fault("gtsp-option", field=field, value=repr(value), legal=", ".join(legal))
        )
