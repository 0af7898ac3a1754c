"""`dmoc place`: where the robot of a station would stand better."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from rich.console import Console as Terminal
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.commands.plan import open_station
from sequencing.commands.workers import worker_pool
from sequencing.cycle.placement import Place, Placement, grid_of_places, place_station
from sequencing.report.placement_report import (
    base_block,
    placement_entry,
    placement_markdown,
    placement_png,
)
from sequencing.runs.archive import write_atomic


def run_place(
    console: Console,
    station_name: str,
    span_m: float,
    step_m: float,
    yaw_deg: float,
    yaw_step_deg: float,
    seed: int,
    out: Path | None,
    workers: int,
) -> CommandResult:
    """Judge a grid of places; table, map and CSV; exit 3 where no place reaches every stud."""
    station = open_station(station_name)
    places = grid_of_places(span_m, step_m, math.radians(yaw_deg), math.radians(yaw_step_deg))
    folder = out or Path("runs") / f"place-{station.name}"
    columns = (
        TextColumn("judging places"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Terminal(stderr=True)) as bar, worker_pool(workers) as executor:
        task = bar.add_task("", total=len(places))
        found = place_station(
            station,
            places,
            seed=seed,
            executor=executor,
            progress=lambda done, _: bar.update(task, completed=done),
        )
    console.show(placement_markdown(found))
    best = found[0]
    present = next((item for item in found if item.place == Place()), None)
    reached = math.isfinite(best.cost)
    if reached:
        console.show(f"\n{_verdict(best, present)}\n{base_block(station, best)}")
        console.show("Estimates rank places; `dmoc plan` says what the chosen one costs.")
    else:
        console.say("no place of the grid reaches every stud")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / "places.csv", _csv(found))
    write_atomic(folder / "place.png", placement_png(found, station.name))
    data = {
        "station": station.name,
        "places": [placement_entry(station, item) for item in found],
        "best": placement_entry(station, best) if reached else None,
        "present": None if present is None else placement_entry(station, present),
        "out": str(folder),
    }
    save_json(folder, "place.json", data)
    console.show(f"written to {folder}: place.png, places.csv, place.json")
    return CommandResult(data, 0 if reached else 3)


def _verdict(best: Placement, present: Placement | None) -> str:
    if present is None or not math.isfinite(present.cost):
        return "The best place; the present one does not reach every stud:"
    if present is best:
        return "The present place is the best of the grid:"
    share = 100 * (1 - best.cost / present.cost)
    return f"The best place, estimated {share:.1f} % below the present one:"


def _csv(found: tuple[Placement, ...]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(
        [
            "x_m",
            "y_m",
            "z_m",
            "yaw_rad",
            "estimated_cost",
            "alternatives",
            "fewest_alternatives",
            "unreached",
            "reason",
        ]
    )
    for item in found:
        place = item.place
        writer.writerow(
            [
                place.x_m,
                place.y_m,
                place.z_m,
                place.yaw_rad,
                item.cost if math.isfinite(item.cost) else "",
                item.alternatives,
                item.fewest,
                " ".join(item.unreached),
                item.reason,
            ]
        )
    return buffer.getvalue()
