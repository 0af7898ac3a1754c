"""The one entry of the package: `solve` picks and combines the methods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmoc.errors import ProblemError
from sequencing.gtsp.held_karp_table import held_karp, table_bytes
from sequencing.gtsp.normalise import NormalForm, normal_form
from sequencing.gtsp.problem import GtspProblem, Tour, as_tours
from sequencing.gtsp.stop import EFFORTS, Callback, Incumbent, Stop


def travels(problem: GtspProblem, nodes: Sequence[int]) -> frozenset[tuple[int, int]]:
    """The travels of a tour as a set of (exit node, entry node)."""
    return frozenset((int(u), int(v)) for u, v in problem.edges(nodes))


def diverse(
    problem: GtspProblem, tours: Sequence[tuple[int, ...]], count: int
) -> tuple[tuple[int, ...], ...]:
    """At most `count` of the tours: the first, then always the one with most new travels.

    Ties go to the earlier (better) tour; a tour without a new travel is not taken.
    """
    left = list(dict.fromkeys(tours))
    if not left:
        return ()
    chosen = [left.pop(0)]
    seen = set(travels(problem, chosen[0]))
    while left and len(chosen) < count:
        news = [len(travels(problem, nodes) - seen) for nodes in left]
        at = max(range(len(left)), key=lambda k: (news[k], -k))
        if news[at] == 0:
            break
        chosen.append(left.pop(at))
        seen |= travels(problem, chosen[-1])
    return tuple(chosen)


QUICK, THOROUGH = 0.25, 4.0  # of the normal budget


@dataclass(frozen=True)
class Plan:
    """iterations in all, members of the population, iterations for a child."""

    iterations: int
    population: int
    child: int

    @staticmethod
    def of(clusters: int, effort: str, iterations: int | None) -> Plan:
        """The plan for a problem; `iterations` overrides what the effort says."""
        if iterations is None:
            if clusters <= 60:
                normal = 40_000 + 1000 * clusters
            else:
                normal = 3500 * clusters if clusters <= 120 else min(6000 * clusters, 1_000_000)
            factor = {"quick": QUICK, "normal": 1.0, "thorough": THOROUGH}[effort]
            iterations = int(normal * factor)
        child = 1500 if clusters <= 60 else 2000
        population = min(8 if clusters <= 60 else 16, iterations // (3 * child))
        return Plan(iterations, population, child)


METHODS = ("auto", "heuristic", "exact", "held-karp", "ruin-recreate")
PROOF_TOLERANCE = 1e-7
SMALL_TABLE_BYTES = 4 << 20  # Held–Karp takes milliseconds
INSTANT_STEPS = 20_000_000  # of Held–Karp: some 20 ms
LARGEST_STEPS = 5_000_000_000
AVOID = 0.3  # of a mean travel: what it costs a tour of the pool to repeat one


def solve(
    problem: GtspProblem,
    stop: Stop | int | None = None,
    seed: int = 0,
    *,
    method: str = "auto",
    effort: str = "normal",
    initial: Sequence[Tour | Sequence[int]] = (),
    pool: int = 0,
    callback: Callback | None = None,
) -> Tour:
    """The best tour found, with a proven lower bound where the method gives one.

    stop      `Stop`, or a number of heuristic iterations, or None (as `effort` says).
    seed      same problem, seed and limits: same tour.
    method    'auto': Held–Karp where its table is tiny, else the heuristic;
              'heuristic': memetic with ruin-and-recreate; 'exact': bounded dynamic programming;
              'held-karp': reference; 'ruin-recreate': one annealed run.
    effort    'quick', 'normal' or 'thorough'.
    initial   tours to start from; those that do not fit the problem are left out.
    pool      number of diverse tours to return in `Tour.pool` (heuristic methods).
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
    if method in ("auto", "heuristic", "exact") and pool <= 1 and _is_instant(form, limits):
        # Few clusters of many nodes: the exact answer costs less than a round of improvement.
        exact, bound = held_karp(form, math.inf, limits.memory_bytes)
        if exact is None:
            return Tour((), math.inf, bound, True, "held-karp")
        # Once more below the cost just found: finer rounding, and with it the proof.
        nodes = form.lift(exact)
        _, bound = held_karp(form, problem.tour_cost(nodes), limits.memory_bytes)
        return finish(problem, form, nodes, bound, "held-karp")
    generator = np.random.default_rng(seed)
    start = [n for n in map(form.lower, as_tours(initial)) if n is not None]
    found = _heuristic(problem, form, limits, effort, method, generator, start, callback)
    nodes = found[0] if found else ()
    cost = problem.tour_cost(nodes) if nodes else math.inf
    small = table_bytes(form) <= SMALL_TABLE_BYTES
    if method == "held-karp" or (small and method in ("auto", "exact")):
        exact, bound = held_karp(form, cost, limits.memory_bytes)
        if exact is None:
            return Tour((), math.inf, bound, True, "held-karp")
        return finish(problem, form, form.lift(exact), bound, "held-karp")
    if method == "exact":
        from sequencing.gtsp.bounded import bounded_dp

        tolerance = 0.5 if form.whole else 1e-9 * problem.tour_magnitude(nodes)
        exact, bound = bounded_dp(form, cost, tolerance, limits.states, limits.memory_bytes)
        if exact is not None:
            nodes = form.lift(exact)
        return finish(problem, form, nodes, bound, "bounded-dp")
    name = method if method == "ruin-recreate" else "memetic ruin-and-recreate"
    tour = finish(problem, form, nodes, -math.inf, name)
    if pool > 1 and tour.found:
        return replace(tour, pool=_pool(problem, found, pool, seed))
    return tour


def _is_instant(form: NormalForm, limits: Stop) -> bool:
    """Whether Held–Karp needs fewer steps than the heuristic would take anyway.

    Few clusters of many nodes: one exact optimisation of the clusters along a fixed order, which
    the heuristic repeats all the time, is nearly as dear as the whole table.
    """
    sizes = np.diff(form.ptr)
    roots = 1 if form.pinned else int(sizes.min())
    table = table_bytes(form) // 4 * form.num_nodes * roots
    rounds = 10_000 if limits.iterations is None else limits.iterations
    heuristic = rounds * form.num_nodes * int(sizes.mean()) * roots // 10
    return table <= min(max(INSTANT_STEPS, heuristic), LARGEST_STEPS)


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
    method: str,
    generator: np.random.Generator,
    start: list[np.ndarray],
    callback: Callback | None,
) -> list[tuple[int, ...]]:
    """Admissible tours found by the heuristic, best first (empty: none)."""
    from sequencing.gtsp.arrays import prepare
    from sequencing.gtsp.evolution import memetic, ruin_recreate

    count = 0
    best = math.inf

    def report(done: int, nodes: np.ndarray, cost: float) -> None:
        nonlocal count, best
        count += done
        if callback is not None and cost < best:
            best = cost
            lifted = form.lift(nodes)
            callback(Incumbent(count, lifted, admissible_cost(problem, lifted)))

    arrays = prepare(form)
    goal = limits.target_cost
    if math.isfinite(goal):  # (−inf + inf would be NaN)
        goal += 1e-9 * abs(goal)
    plan = Plan.of(form.num_clusters, effort, limits.iterations)
    if method == "ruin-recreate" or plan.population < 2:
        nodes, cost = ruin_recreate(
            arrays,
            plan.iterations,
            generator,
            start[0] if start else None,
            goal,
            0.3 if start else 1.0,
            report,
        )
        members = [(cost, nodes)]
    else:
        members = memetic(
            arrays, plan.iterations, plan.population, generator, plan.child, start, goal, report
        )
    tours = [form.lift(nodes) for _, nodes in members]
    tours += [form.lift(nodes) for nodes in start]  # never worse than what was given
    good = [(admissible_cost(problem, nodes), nodes) for nodes in tours]
    return [nodes for cost, nodes in sorted(good) if math.isfinite(cost)]


def _pool(
    problem: GtspProblem, found: list[tuple[int, ...]], count: int, seed: int
) -> tuple[tuple[int, ...], ...]:
    """Diverse tours: those found, then tours that avoid the travels of the earlier ones."""
    chosen = diverse(problem, found, count)
    cost = problem.cost.copy()
    raised: set[tuple[int, int]] = set()
    while len(chosen) < count:
        for nodes in chosen:
            new = travels(problem, nodes) - raised
            step = AVOID * problem.tour_magnitude(nodes) / max(len(nodes), 1)
            for u, v in new:
                cost[u, v] += step
            raised |= new
        stop = Stop(iterations=1000 + 200 * problem.num_clusters)
        other = solve(problem.replace(cost=cost), stop, seed, method="ruin-recreate")
        more = diverse(problem, [*chosen, other.nodes], count)
        if not other.found or len(more) == len(chosen):
            break
        chosen = more
    return chosen


def _one_cluster(problem: GtspProblem, form: NormalForm) -> Tour:
    nodes = [int(v) for v in form.origin if v >= 0]
    costs = [problem.tour_cost([v]) for v in nodes]
    best = int(np.argmin(costs)) if costs else 0
    if not costs or not math.isfinite(costs[best]):
        return Tour((), math.inf, math.inf, True, "one cluster")
    return Tour((nodes[best],), costs[best], costs[best], True, "one cluster")


def _check(value: str, legal: Sequence[str], field: str) -> None:
    if value not in legal:
        raise ProblemError.of("gtsp-option", field=field, value=repr(value), legal=", ".join(legal))
