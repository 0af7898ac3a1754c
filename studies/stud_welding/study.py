"""The stud-welding study: a published comparison of old and new sequencing, run anew.

After Björkenstam et al., Efficient sequencing of industrial robots through optimal control,
Procedia CIRP 23 (2014), section 3: twenty studs, 2 s a weld, J = ∫ 1 + 1e-6 uᵀu + q̇ᵀq̇ dt. Robot,
gun and part are not published; the stations are our own and say what is assumed.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from dmoc.input_file import read_yaml
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.collision.world import CollisionWorld
from planning.station.build import demo_station
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing.cycle.baseline import (
    TimedSequence,
    middle_place,
    time_based_sequences,
    time_costs,
    undirected,
)
from sequencing.cycle.plan import NoCycle, PlanEvent, PlanStop, execute, plan_station
from sequencing.cycle.second_look import MotionLooks
from sequencing.cycle_types import Cycle, StudRow, Tables
from sequencing.edges.nodes import station_nodes
from sequencing.edges.oracle import StationEdges
from sequencing.edges.store import EdgeStore
from sequencing.gtsp.problem import Tour
from studies.stud_welding.ablation import NEW, ablation_cycles, ablation_rows
from studies.stud_welding.changes import CHANGES, FEW_CHANGES, price_change
from studies.stud_welding.departure import departure_rows
from studies.stud_welding.model import Model, StudyBench, open_model, square, travels
from studies.stud_welding.search import from_home, sequence_by
from studies.stud_welding.shares import sharing_out
from studies.stud_welding.trade_offs import trade_off_points
from studies.stud_welding.types import NEAR_PERCENT, StudWeldingStudy

STATIONS = {"A": "stud_welding_a", "B": "stud_welding_b", "C": "stud_welding_c"}


@dataclass(frozen=True)
class Budget:
    """Counts that bound the work.

    Training edges (None: by the number of studs), edges that only judge the estimate, old
    sequences drawn, edges that the search under a changed assumption may solve, names of the
    changes (None: all).
    """

    training_edges: int | None = None
    coverage_edges: int = 200
    draws: int = 15
    edges_per_change: int = 60
    changes: tuple[str, ...] | None = None

    @staticmethod
    def reduced() -> Budget:
        """What continuous integration runs."""
        return Budget(
            training_edges=12, coverage_edges=8, draws=3, edges_per_change=6, changes=FEW_CHANGES
        )


@dataclass(frozen=True)
class StudyRun:
    """The study's figures, and the two cycles of its Table 2 with final motions."""

    study: StudWeldingStudy
    new: Cycle
    old: Cycle


def study_station(letter: str, reduced: bool = False) -> Station:
    """Station A, B or C; reduced: four of its studs."""
    station = demo_station(STATIONS[letter])
    if not reduced:
        return station
    return station.replace(name=f"{station.name}_reduced", studs=station.studs[::5])


def run_stud_welding_study(
    letter: str,
    store: EdgeStore,
    *,
    seed: int = 0,
    reduced: bool = False,
    budget: Budget | None = None,
    solver: str = DEFAULT_SOLVER,
    method: Method = "halfspaces",
    executor: Executor | None = None,
    progress: Callable[[PlanEvent], None] | None = None,
) -> StudyRun:
    """Plan the station, compare with the old method, and ask what the saving rests on.

    Every solved edge is in `store` as soon as it is finished: an interrupted study goes on from
    there. The result depends on the station and the seed only. Raises `NoCycle` as `plan_station`.
    """
    limits = budget or (Budget.reduced() if reduced else Budget())
    tell = progress or (lambda event: None)
    station = study_station(letter, reduced)
    stop = PlanStop(
        training_edges=limits.training_edges,
        coverage_edges=limits.coverage_edges,
        baseline_draws=0,
    )
    cycle = plan_station(
        station,
        seed=seed,
        method=method,
        solver=solver,
        stop=stop,
        executor=executor,
        store=store,
        progress=progress,
    )
    bench = StudyBench(seed, store, executor, tell, solver, method)
    world = CollisionWorld(station)
    nodes = station_nodes(station, alternatives(station, world))
    model = open_model("nominal", station, nodes, world, bench)
    edges = model.edges
    assert isinstance(edges, StationEdges)
    edges.train(stop.training(len(nodes.studs)), stop.coverage_edges)
    bench.tell("sequences of least time")
    drawn = time_based_sequences(edges, limits.draws, seed)
    if not drawn:
        raise NoCycle({"cycle": "no sequence of least time has motions throughout"})
    return _study(model, cycle, drawn, world, bench, limits, letter, reduced)


def _study(
    model: Model,
    cycle: Cycle,
    drawn: tuple[TimedSequence, ...],
    world: CollisionWorld,
    bench: StudyBench,
    limits: Budget,
    letter: str,
    reduced: bool,
) -> StudyRun:
    edges, home = model.edges, model.nodes.home
    assert isinstance(edges, StationEdges)
    table = square(model.nodes, edges.estimate)
    middle = middle_place(len(drawn))
    old = from_home(drawn[middle].nodes, home)
    new = from_home(cycle.tour.nodes, home)
    bench.tell("final motions of the old sequence")
    totals = tuple(sequence.cost.total for sequence in drawn)
    cycle, old_cycle = _both_cycles(edges, cycle, old, totals)
    bench.tell("sequences of nearly least time")
    near = _near_totals(model, drawn, limits.draws // 2)
    bench.tell("ablation")
    cycles = ablation_cycles(model, table, old, new, limits.edges_per_change)
    ablation = ablation_rows(model, cycles)
    bench.tell("shares of the saving")
    nearest = sorted(drawn, key=lambda s: abs(s.cost.total - drawn[middle].cost.total))
    shares = sharing_out(model, [from_home(s.nodes, home) for s in nearest], new)
    wanted = [c for c in CHANGES if limits.changes is None or c.name in limits.changes]
    rows = []
    for change in wanted:
        bench.tell(change.name)
        rows.append(
            price_change(change, model, table, old, new, world, bench, limits.edges_per_change)
        )
    found = tuple(row for row in rows if row is not None)
    bench.tell("ways to leave the welds")
    compared = {n: c for n, c in cycles.items() if c is not None and "estimate" not in n}
    departures = departure_rows(model, compared, NEW, bench)
    bench.tell("cycle time against energy")
    points = trade_off_points(model, old, new, wanted, found)
    study = StudWeldingStudy(
        station=letter,
        seed=bench.seed,
        reduced=reduced,
        studs=_studs(model),
        old=old_cycle.tables.time_based,
        new=old_cycle.tables.energy_based,
        old_totals=totals,
        near_totals=near,
        old_time_s=drawn[middle].time_s,
        old_order=model.studs_of(old),
        new_order=model.studs_of(new),
        ablation=ablation,
        shares=shares,
        changes=found,
        departures=departures,
        trade_offs=points,
        edges_evaluated=len(edges.costs) + sum(row.edges for row in found),
        provenance=provenance_of(model.station),
    )
    return StudyRun(study, cycle, old_cycle)


def _near_totals(model: Model, drawn: tuple[TimedSequence, ...], count: int) -> tuple[float, ...]:
    """Costs of up to `count` sequences that are slower than the tied ones `drawn`, but by at most
    `NEAR_PERCENT`; cheapest first."""
    least_s = min(sequence.time_s for sequence in drawn)
    tied = {undirected(sequence.nodes) for sequence in drawn}
    times = time_costs(model.station, model.nodes)
    free = np.zeros(model.nodes.num_nodes)
    found: dict[tuple[int, ...], float] = {}
    for draw in range(count):
        noise = np.random.default_rng([model.edges.seed, 1, draw]).random(times.shape)
        slack = 1.0 + NEAR_PERCENT / 100.0 * np.maximum(noise, noise.T)
        cycle = sequence_by(model, times * slack, node_cost=free)
        if cycle is None:
            continue
        pairs = travels(cycle)
        cost = model.cost_of(cycle)
        time = float(np.sum(times[pairs[:, 0], pairs[:, 1]]))
        near = time <= least_s * (1.0 + NEAR_PERCENT / 100.0)
        if cost is not None and near and undirected(cycle) not in tied:
            found[undirected(cycle)] = cost.total
    return tuple(sorted(found.values()))


def _both_cycles(
    edges: StationEdges, cycle: Cycle, old: tuple[int, ...], totals: tuple[float, ...]
) -> tuple[Cycle, Cycle]:
    """Both cycles with the same tables: final motions of the median old sequence and of the new."""
    executed, failed = execute(edges, Tour(old, 0.0))
    if failed:
        raise NoCycle({"cycle": "the old sequence has no certified final motions"})
    looks = MotionLooks(cycle.station)
    if any(looks.touch(item) is not None for item in executed.motions):
        raise NoCycle({"cycle": "; ".join(looks.refused)})
    new_cost = cycle.tables.energy_based
    tables = Tables(cycle.tables.studs, executed.cost, totals, new_cost)
    tour = replace(executed.tour, cost=executed.cost.total)
    old_cycle = replace(
        cycle,
        tour=tour,
        welds=executed.welds,
        motions=executed.motions,
        tables=tables,
        second_look=looks.report(executed.motions),
    )
    return replace(cycle, tables=tables), old_cycle


def provenance_of(station: Station) -> dict[str, str]:
    """The tags of the provenance.yaml beside a station file; none where there is no such file."""
    path = station.source.parent / "provenance.yaml"
    if not path.is_file():
        return {}
    return {str(key): str(tag) for key, tag in read_yaml(path).data.items()}


def _studs(model: Model) -> tuple[StudRow, ...]:
    nodes, rows = model.nodes, []
    for cluster, stud in enumerate(nodes.studs):
        costs = nodes.weld_cost[nodes.cluster_of == cluster]
        rows.append(StudRow(stud, len(costs), float(costs.min()), float(costs.max())))
    return tuple(rows)
