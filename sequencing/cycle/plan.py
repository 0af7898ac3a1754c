"""`plan_station`: from a station to the ordered, certified, energy-efficient cycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.refinement.params import method_named
from dmoc.solving.solvers import DEFAULT_SOLVER, require_solver
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from planning.welds.check import check_home, contact_depth_m
from planning.welds.poses import StudAlternatives
from sequencing import gtsp
from sequencing.cycle.baseline import TimedSequence, middle_place, time_based_sequences
from sequencing.cycle.lazy import LazyResult, LazyRound, LazyStop, solve_lazily
from sequencing.cycle.polish import polish_cycle
from sequencing.cycle.second_look import MotionLooks
from sequencing.cycle_types import (
    Cycle,
    CycleCost,
    CycleMotion,
    Reuse,
    Search,
    StudRow,
    Tables,
    Weld,
)
from sequencing.edges.nodes import HOME, StationNodes, station_nodes
from sequencing.edges.oracle import EdgeEvent, StationEdges
from sequencing.edges.pruning import pruned
from sequencing.edges.store import EdgeStore
from sequencing.gtsp.problem import Tour

MAX_FINAL_REPAIRS = 20
# Relative accuracy of a solved cost.
BOUND_SLACK = 1e-6


class NoCycle(RuntimeError):
    """No admissible cycle exists; `reasons` maps stud ids (or `cycle`) to why."""

    def __init__(self, reasons: dict[str, str]) -> None:
        self.reasons = reasons
        super().__init__("; ".join(f"{key}: {value}" for key, value in reasons.items()))

    def __reduce__(self) -> tuple[type[NoCycle], tuple[dict[str, str]]]:
        return (type(self), (self.reasons,))


@dataclass(frozen=True)
class PlanStop:
    """When planning stops: all limits are counts or proven numbers, never wall time.

    `training_edges` are solved before anything is decided (None: by the number of studs), and
    `coverage_edges` more, drawn at random, that only judge the estimate made from them (None: 200,
    or 99 below ten studs, the fewest with 99 % coverage);
    `conditional_gap` ends the lazy loop; `max_evaluations` limits the edges of the loop;
    `baseline_draws` is the number of time-optimal sequences drawn for the comparison.
    """

    training_edges: int | None = None
    coverage_edges: int | None = None
    conditional_gap: float = 0.01
    max_evaluations: int | None = None
    baseline_draws: int = 5

    def training(self, num_studs: int) -> int:
        """Number of training edges for a station of `num_studs` studs."""
        return self.training_edges or 40 + 8 * num_studs

    def coverage(self, num_studs: int) -> int:
        """Number of held-out edges for a station of `num_studs` studs."""
        if self.coverage_edges is not None:
            return self.coverage_edges
        return 200 if num_studs >= 10 else 99


@dataclass(frozen=True)
class PlanEvent:
    """Progress of a plan: phase, edges, best cycle cost so far and its conditional gap.

    The last event, `done`, says what came from the store.
    """

    phase: str
    edges: EdgeEvent | None = None
    best: float | None = None
    gap: float | None = None
    reuse: Reuse | None = None


Progress = Callable[[PlanEvent], None]


def plan_station(
    station: Station,
    *,
    seed: int = 0,
    method: str = "half-spaces",
    solver: str = DEFAULT_SOLVER,
    stop: PlanStop | None = None,
    executor: Executor | None = None,
    store: EdgeStore | Path | str | None = None,
    progress: Progress | None = None,
    polish: bool = False,
) -> Cycle:
    """Order, configurations and motions of a station.

    Alternatives → edge costs (bound, learned estimate, solved motions, lazily) → exact
    generalised TSP → final motions at N = 40, certified between the knots → comparison with
    sequences of least travel time. `executor` runs the edges (None: in this process); the result
    is the same, byte for byte, whatever it is. `store` keeps solved edges for the next run
    (a path is opened and closed again). `method` keeps motions free of collisions, `half-spaces`
    or `boxes`; `solver` is a name of `dmoc.solving.solvers.SOLVERS`.
    `polish` turns the tool of every weld continuously afterwards, for the whole cycle; it never
    makes it dearer, and the gaps keep speaking of the cycle before.

    Raises `NoCycle` when no stud has an alternative or no cycle joins those that have one.
    """
    settings, tell = stop or PlanStop(), progress or (lambda event: None)
    method = method_named(method)
    require_solver(solver, "solver")
    if not isinstance(store, EdgeStore):
        with EdgeStore(store or ":memory:") as opened:
            return plan_station(
                station,
                seed=seed,
                method=method,
                solver=solver,
                stop=stop,
                executor=executor,
                store=opened,
                progress=progress,
                polish=polish,
            )
    tell(PlanEvent("alternatives"))
    world = CollisionWorld(station)
    check_home(station, world)
    found = alternatives(station, world)
    unreachable = tuple(
        (item.stud.id, reason_text(item)) for item in found if not item.alternatives
    )
    kept, pruning = pruned(station, found)
    nodes = station_nodes(station, kept)
    if not nodes.studs:
        raise NoCycle(dict(unreachable))

    tell(PlanEvent("estimates"))
    oracle = StationEdges(
        station,
        world,
        nodes,
        store,
        seed=seed,
        method=method,
        solver=solver,
        executor=executor,
        progress=lambda event: tell(PlanEvent("edges", event)),
    )
    count = len(nodes.studs)
    oracle.train(settings.training(count), settings.coverage(count))
    factors, coverage = oracle.floor_factors(0.01)
    looks = MotionLooks(station)
    best, result = _best_cycle(oracle, looks, settings, factors, seed, tell)
    search = replace(_search(oracle, best, result, (factors, coverage)), pruning=pruning)
    tell(PlanEvent("baseline", best=best.tour.cost, gap=search.conditional_gap_percent / 100))
    old = time_based_sequences(oracle, settings.baseline_draws, seed)
    quick = time_based_sequences(oracle, 1, seed, accelerating=True) if old else ()
    tables = _tables(oracle, found, best, old, quick)
    polished = None
    welds, motions = best.welds, best.motions
    if polish:
        tell(PlanEvent("polish", best=best.cost.total))
        welds, motions, polished = polish_cycle(
            oracle,
            world,
            looks,
            welds,
            motions,
            lambda cost: tell(PlanEvent("polish", best=cost)),
        )
        travel = float(sum(item.motion.cost for item in motions))
        cost = CycleCost(travel, float(sum(weld.cost for weld in welds)))
        times = (*tables.travel_s[:2], _travel_s(motions))
        tables = replace(tables, energy_based=cost, travel_s=times)
    welds = tuple(replace(w, contact_depth_m=contact_depth_m(world, w.q_rad)) for w in welds)
    tell(PlanEvent("done", best=best.tour.cost, reuse=oracle.reuse()))
    return Cycle(
        station=station,
        seed=seed,
        method=method,
        tour=replace(best.tour, lower_bound=search.lower_bound, proven=False),
        welds=welds,
        motions=motions,
        tables=tables,
        search=search,
        configurations=nodes.num_configurations,
        unreachable=unreachable,
        polish=polished,
        second_look=looks.report(motions),
        solver=solver,
    )


def reason_text(item: StudAlternatives) -> str:
    """Why a stud has no alternative: reasons and how many candidates each one took away."""
    parts = [f"{reason} ({count})" for reason, count in sorted(item.reasons.items())]
    return ", ".join(parts) or "unreachable"


@dataclass(frozen=True)
class _Executed:
    """A tour with its final motions, in order of execution."""

    tour: Tour
    pairs: tuple[tuple[int, int], ...]
    welds: tuple[Weld, ...]
    motions: tuple[CycleMotion, ...]
    cost: CycleCost


def _best_cycle(
    oracle: StationEdges,
    looks: MotionLooks,
    settings: PlanStop,
    factors: Array,
    seed: int,
    tell: Progress,
) -> tuple[_Executed, LazyResult]:
    """The lazy loop, repeated until every motion of its tour is final, certified, looked at."""
    nodes, station = oracle.nodes, oracle.station
    base = nodes.problem(_zero_costs(nodes), station)

    def show(round_: LazyRound) -> None:
        tell(PlanEvent("search", None, round_.upper_bound, round_.conditional_gap))

    stop = LazyStop(settings.conditional_gap, "conditional", settings.max_evaluations)
    for _ in range(MAX_FINAL_REPAIRS):
        result = solve_lazily(
            base,
            oracle,
            stop,
            seed,
            known=dict(oracle.costs),
            symmetric=oracle.symmetric,
            factor=factors,
            bound_each_round=False,
            callback=show,
        )
        if not result.tour.found:
            raise NoCycle({"cycle": "; ".join([_why_no_cycle(oracle, result), *looks.refused])})
        tell(PlanEvent("final motions", None, result.tour.cost, result.conditional_gap))
        executed, failed = execute(oracle, result.tour)
        judged = zip(executed.pairs, looks.judged(executed.motions))
        failed += [pair for pair, item in judged if item.motion.status is Status.UNCERTIFIED]
        oracle.forbid(failed)
        # The loop goes on with the final costs until its tour consists of nothing else: cost and
        # gaps then speak of the cycle that is delivered.
        if not failed and not oracle.settle(executed.pairs, executed.motions):
            return executed, result
    why = f"no tour with certified final motions in {MAX_FINAL_REPAIRS} tries"
    raise NoCycle({"cycle": "; ".join([why, *looks.refused])})


def _zero_costs(nodes: StationNodes) -> np.ndarray:
    return np.zeros((nodes.num_nodes, nodes.num_nodes))


def _why_no_cycle(oracle: StationEdges, result: LazyResult) -> str:
    if result.status == "evaluation_limit":
        return (
            f"the limit of {result.evaluations} evaluations was reached before any whole cycle was "
            "solved: raise --max-evaluations; the edges solved so far are kept"
        )
    failed = sum(1 for value in oracle.costs.values() if not np.isfinite(value))
    return (
        f"{result.status}: {failed} of {len(oracle.costs)} solved travels have no certified "
        "motion, or the precedences admit no order"
    )


def execute(oracle: StationEdges, tour: Tour) -> tuple[_Executed, list[tuple[int, int]]]:
    """Final motions of a tour, rotated to begin at home; the pairs without a certified motion."""
    nodes, station = oracle.nodes, oracle.station
    order = list(tour.nodes)
    if nodes.home is not None:
        at = order.index(nodes.home)
        order = order[at:] + order[:at]
    problem = nodes.problem(_zero_costs(nodes), station)
    pairs = problem.edges(order)
    found = oracle.motions(pairs, "final")
    failed = [
        (int(i), int(j))
        for (i, j), motion in zip(pairs, found)
        if not (motion.status.ok and motion.certified and motion.trajectory is not None)
    ]
    motions = tuple(
        _cycle_motion(nodes, index, int(i), int(j), motion)
        for index, ((i, j), motion) in enumerate(zip(pairs, found))
    )
    times = {stud.id: stud.weld_time_s for stud in station.studs}
    welds = tuple(
        Weld(
            nodes.stud[v],
            int(nodes.alternative[v]),
            nodes.q_rad[v],
            float(nodes.weld_cost[v]),
            times[nodes.stud[v]],
        )
        for v in order
        if v != nodes.home
    )
    travel = float(sum(item.motion.cost for item in motions))
    cost = CycleCost(travel, float(sum(weld.cost for weld in welds)))
    rotated = replace(tour, nodes=tuple(order))
    directed = tuple((int(i), int(j)) for i, j in pairs)
    return _Executed(rotated, directed, welds, motions, cost), failed


def _cycle_motion(nodes: StationNodes, index: int, i: int, j: int, motion: Motion) -> CycleMotion:
    ends = (HOME if i == nodes.home else nodes.stud[i], HOME if j == nodes.home else nodes.stud[j])
    kind: Any = "home" if nodes.home in (i, j) else "travel"
    return CycleMotion(f"m{index:03d}", ends[0], ends[1], kind, motion)


def _search(
    oracle: StationEdges, best: _Executed, result: LazyResult, condition: tuple[Array, float]
) -> Search:
    """What is proven: the minimum over lower bounds that hold for every motion there is.

    Solved costs do not enter it: they are local optima, and an edge that failed is not proven to
    be impossible.
    """
    nodes = oracle.nodes
    strict = gtsp.solve(
        nodes.problem(bound_costs(oracle), oracle.station),
        seed=oracle.seed,
        method="exact",
        initial=[best.tour],
    )
    total = best.cost.total
    bound = min(strict.lower_bound, total)
    pairs = np.array(list(oracle.costs), dtype=np.int64).reshape(-1, 2)
    solved = np.array(list(oracle.costs.values()))
    # A solved edge below its bound would refute the bound; then nothing is called proven.
    holds = bool(np.all(solved >= oracle.bound(pairs) * (1.0 - BOUND_SLACK)))
    factors, coverage = condition
    unknown = [factors[i, j] for i, j in nodes.usable_pairs() if (i, j) not in oracle.costs]
    failed = sum(1 for value in oracle.costs.values() if not np.isfinite(value))
    return Search(
        edges_total=len(nodes.usable_pairs()),
        edges_evaluated=len(oracle.costs),
        edges_training=oracle.num_training,
        edges_held_out=len(oracle.held_out),
        edges_failed=failed,
        lower_bound=bound,
        bound_is_proven=holds and bool(np.isfinite(bound)),
        gap_percent=100.0 * (total - bound) / total,
        conditional_factor=float(np.median(unknown)) if unknown else 1.0,
        coverage_percent=100.0 * coverage,
        conditional_gap_percent=100.0 * max(0.0, total - result.conditional_bound) / total,
        stopped_by=result.status,
        rounds=tuple(_round(r) for r in result.rounds),
    )


def bound_costs(oracle: StationEdges) -> np.ndarray:
    """(V, V): proven lower bounds of all travels, inf within a stud."""
    nodes = oracle.nodes
    pairs = nodes.usable_pairs()
    table = np.full((nodes.num_nodes, nodes.num_nodes), np.inf)
    table[pairs[:, 0], pairs[:, 1]] = table[pairs[:, 1], pairs[:, 0]] = oracle.bound(pairs)
    return table


def _round(item: LazyRound) -> dict[str, Any]:
    return {
        "phase": item.phase,
        "upper_bound": item.upper_bound,
        "lower_bound": item.lower_bound,
        "conditional_bound": item.conditional_bound,
        "evaluations": item.evaluations,
        "batch": item.batch,
    }


def _tables(
    oracle: StationEdges,
    found: tuple[StudAlternatives, ...],
    best: _Executed,
    old: tuple[TimedSequence, ...],
    quick: tuple[TimedSequence, ...],
) -> Tables:
    rows = []
    for item in found:
        welds = [alternative.weld_cost for alternative in item.alternatives]
        if welds:
            rows.append(StudRow(item.stud.id, len(welds), min(welds), max(welds)))
    new_s = _travel_s(best.motions)
    final = sorted(
        (_final(oracle, sequence) for sequence in old), key=lambda item: item[0].total
    ) or [(best.cost, new_s)]
    middle, old_s = final[middle_place(len(final))]
    least, least_s = _final(oracle, quick[0]) if quick else (None, math.nan)
    totals = tuple(cost.total for cost, _ in final)
    return Tables(tuple(rows), middle, totals, best.cost, least, (old_s, least_s, new_s))


def _final(oracle: StationEdges, sequence: TimedSequence) -> tuple[CycleCost, float]:
    """Cost and travel time [s] of the sequence with final motions; its screening cost and NaN where
    one of them is not certified."""
    executed, failed = execute(oracle, Tour(sequence.nodes, sequence.cost.total))
    if failed:
        return sequence.cost, math.nan
    return executed.cost, _travel_s(executed.motions)


def _travel_s(motions: tuple[CycleMotion, ...]) -> float:
    """How long the motions take [s]; welding is not among them."""
    return float(sum(item.motion.duration_s for item in motions))
