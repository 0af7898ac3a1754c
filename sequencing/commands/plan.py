"""`dmoc demo` and `dmoc plan`: plan a station and write everything a person looks at."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planning.station.build import available_stations, demo_station, load_station
from planning.station.station import Station
from sequencing.commands.console import CommandResult, Console
from sequencing.commands.workers import worker_pool
from sequencing.cycle.plan import NoCycle, PlanEvent, PlanStop, plan_station
from sequencing.cycle_types import Cycle, Reuse
from sequencing.edges.store import EdgeStore
from sequencing.report.curves import write_curves
from sequencing.report.html import write_report
from sequencing.report.progress import plan_progress
from sequencing.report.scene import write_scene
from sequencing.runs.folder import read_run, write_run
from sequencing.runs.inputs import locked


@dataclass(frozen=True)
class RunBench:
    """What solving edges needs: the store in the folder, worker processes, a progress bar."""

    store: EdgeStore
    executor: Executor | None
    progress: Callable[[PlanEvent], None]


@contextmanager
def open_bench(folder: Path, workers: int, executor_kind: str = "processes") -> Iterator[RunBench]:
    """Store, workers and progress bar for the run in `folder`, closed in the end."""
    with (
        EdgeStore(folder / "edges.sqlite") as store,
        worker_pool(workers, executor_kind) as executor,
        plan_progress() as progress,
    ):
        yield RunBench(store, executor, progress)


def no_cycle(console: Console, none: NoCycle, folder: Path) -> CommandResult:
    """Say why there is no cycle; exit 3."""
    for key, reason in none.reasons.items():
        console.say(f"no cycle: {key}: {reason}")
    return CommandResult({"status": "no_cycle", "reasons": none.reasons, "out": str(folder)}, 3)


def write_pages(cycle: Cycle, folder: Path) -> None:
    """Curves, scene and report of the run that `write_run` left in `folder`."""
    robot, name = cycle.station.robot, cycle.station.name
    run = read_run(folder, robot)
    write_curves(run.timeline, robot, folder / "curves.png", name)
    write_scene(cycle.station, run.timeline, folder / "scene.html", name)
    write_report(run, robot, folder / "report.html")


DEMO = "stud_welding_a_8"


def open_station(name_or_path: str) -> Station:
    """An embedded station by name, or a station.yaml."""
    if name_or_path in available_stations():
        return demo_station(name_or_path)
    return load_station(name_or_path)


def run_demo(
    console: Console,
    seed: int,
    out: Path | None,
    workers: int,
    method: str,
    solver: str,
    polish: bool = False,
) -> CommandResult:
    """The main job on the embedded eight-stud station."""
    folder = out or Path("runs/demo")
    return run_plan(console, DEMO, seed, folder, workers, method, solver, None, 0.01, polish)


def run_plan(
    console: Console,
    station_name: str,
    seed: int,
    out: Path | None,
    workers: int,
    method: str,
    solver: str,
    max_evaluations: int | None,
    conditional_gap: float,
    polish: bool = False,
    coverage: int | None = None,
    executor: str = "processes",
) -> CommandResult:
    """Plan, write the run folder, print the tables; exit 3 with reasons where there is no cycle."""
    began = time.perf_counter()
    station = open_station(station_name)
    for doubt in station.robot.description.warnings:
        console.say(f"warning: {doubt}")
    folder = out or Path("runs") / run_name(station.name)
    stop = PlanStop(
        conditional_gap=conditional_gap, max_evaluations=max_evaluations, coverage_edges=coverage
    )
    events: list[PlanEvent] = []
    with locked(folder):
        try:
            with open_bench(folder, workers, executor) as bench:
                cycle = plan_station(
                    station,
                    seed=seed,
                    method=method,
                    solver=solver,
                    stop=stop,
                    store=bench.store,
                    executor=bench.executor,
                    progress=_kept(bench.progress, events),
                    polish=polish,
                )
        except NoCycle as none:
            return no_cycle(console, none, folder)
        planned = time.perf_counter() - began
        reuse = next(event.reuse for event in reversed(events) if event.reuse is not None)
        write_run(cycle, folder, _timing(planned, planned, reuse))
        write_pages(cycle, folder)
        wall = time.perf_counter() - began
        write_run(cycle, folder, _timing(planned, wall, reuse))
    console.show((folder / "tables.md").read_text(encoding="utf-8"))
    console.show(f"{reuse.summary()} (listed in timing.json)")
    console.show(
        f"written to {folder}: tables.md, report.html, scene.html, curves.png, result.json, "
        "motions.npz"
    )
    return CommandResult(headline(cycle, wall, folder), 0 if not cycle.unreachable else 3)


def run_name(name: str) -> str:
    """A folder name for a station's name: letters, digits, dots, dashes, no path."""
    kept = "".join(c if c.isalnum() or c in "._-" else "_" for c in name).strip(".")
    return kept or "station"


def headline(cycle: Cycle, wall_s: float, out: Path) -> dict[str, Any]:
    """The object that `dmoc demo --json` and `dmoc plan --json` print."""
    search, tables = cycle.search, cycle.tables
    return {
        "studs": len(cycle.welds),
        "warnings": [doubt.to_dict() for doubt in cycle.station.robot.description.warnings],
        "configurations": cycle.configurations,
        "edges": {
            "total": search.edges_total,
            "evaluated": search.edges_evaluated,
            "training": search.edges_training,
            "held_out": search.edges_held_out,
            "failed": search.edges_failed,
        },
        "time_based": tables.time_based.to_dict(),
        "time_based_totals": list(tables.time_based_totals),
        "energy_based": tables.energy_based.to_dict(),
        "saving_percent": tables.saving_percent,
        "lower_bound": search.lower_bound,
        "bound_is_proven": search.bound_is_proven,
        "gap_percent": search.gap_percent,
        "conditional_gap_percent": search.conditional_gap_percent,
        "conditional_factor": search.conditional_factor,
        "coverage_percent": search.coverage_percent,
        "stopped_by": search.stopped_by,
        "polish": None if cycle.polish is None else cycle.polish.to_dict(),
        "cycle_time_s": cycle.duration_s,
        "motions": len(cycle.motions),
        "certified": cycle.certified,
        "fallbacks": cycle.fallbacks,
        "unreachable": [{"stud": stud, "reason": reason} for stud, reason in cycle.unreachable],
        "wall_s": wall_s,
        "out": str(out),
    }


def _kept(
    progress: Callable[[PlanEvent], None], events: list[PlanEvent]
) -> Callable[[PlanEvent], None]:
    """`progress`, with every event kept in `events` too."""

    def both(event: PlanEvent) -> None:
        events.append(event)
        progress(event)

    return both


def _timing(plan_s: float, wall_s: float, reuse: Reuse) -> dict[str, Any]:
    own = resource.getrusage(resource.RUSAGE_SELF)
    workers = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "plan_wall_s": plan_s,
        "wall_s": wall_s,
        "cpu_s": own.ru_utime + own.ru_stime,
        "workers_cpu_s": workers.ru_utime + workers.ru_stime,
        "edges": reuse.to_dict(),
    }
