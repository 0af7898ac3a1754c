"""A run folder from the command line: what it keeps while edges are solved, and its pages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sequencing.commands.console import CommandResult, Console
from sequencing.commands.workers import worker_pool
from sequencing.cycle import NoCycle, PlanEvent
from sequencing.cycle_types import Cycle
from sequencing.report.curves import write_curves
from sequencing.report.html import write_report
from sequencing.report.progress import plan_progress
from sequencing.report.scene import write_scene
from sequencing.run_files import read_run
from sequencing.store import EdgeStore


@dataclass(frozen=True)
class RunBench:
    """What solving edges needs: the store in the folder, worker processes, a progress bar."""

    store: EdgeStore
    executor: Executor | None
    progress: Callable[[PlanEvent], None]


@contextmanager
def open_bench(folder: Path, workers: int) -> Iterator[RunBench]:
    """Store, workers and progress bar for the run in `folder`, closed in the end."""
    with (
        EdgeStore(folder / "edges.sqlite") as store,
        worker_pool(workers) as executor,
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
