"""`dmoc study`: a published study, run anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from dmoc.errors import Fault, InputError
from sequencing.commands.console import Console, Outcome, plain
from sequencing.report.tables import markdown_table, number

__all__ = ["run_study"]

STUDIES = ("stud-welding", "pallet-cell", "ur3")
STATIONS = {"A": "stud_welding_a", "B": "stud_welding_b", "C": "stud_welding_c"}


def run_study(
    console: Console, name: str, station: str, seed: int, out: Path | None, workers: int
) -> Outcome:
    """Run the study `name`; `station` is A, B or C and matters to stud-welding only."""
    if name not in STUDIES:
        raise InputError(
            Fault("study-unknown", field="study", value=name, legal=", ".join(STUDIES),
                  fix="name one of them")
        )  # fmt: skip
    if name == "stud-welding":
        return _stud_welding(console, station, seed, out, workers)
    folder = out or Path("runs") / name
    data = _pallet_cell(console, seed) if name == "pallet-cell" else _ur3(console, seed, folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.json").write_text(json.dumps(plain(data.data), indent=1), encoding="utf-8")
    console.show(f"written to {folder}")
    return data


def _stud_welding(
    console: Console, station: str, seed: int, out: Path | None, workers: int
) -> Outcome:
    from sequencing.commands.plan import run_plan

    if station not in STATIONS:
        raise InputError(
            Fault("study-station", field="--station", value=station, legal=", ".join(STATIONS),
                  fix="name one of them")
        )  # fmt: skip
    folder = out or Path("runs") / f"study-{STATIONS[station]}"
    return run_plan(
        console, STATIONS[station], seed, folder, workers, "halfspaces", None, 0.01
    )  # fmt: skip


def _pallet_cell(console: Console, seed: int) -> Outcome:
    from sequencing.commands.schedule import cases_table
    from sequencing.timing.study import run_pallet_cell_study

    data = run_pallet_cell_study(seed, progress=console.say)
    console.show(cases_table(data["cases"]))
    return Outcome(data)


def _ur3(console: Console, seed: int, folder: Path) -> Outcome:
    from sequencing.studies.ur3 import run_ur3_study

    data = run_ur3_study(seed, folder, progress=console.say)
    console.show(_ur3_table(data["movements"]))
    return Outcome(data)


def _ur3_table(movements: list[dict[str, Any]]) -> str:
    rows = []
    for move in movements:
        for name, metric in move["metrics"].items():
            rows.append(
                [move["name"], name, number(metric["baseline_j"]),
                 number(metric["swarm"]["median_saving_percent"]),
                 number(metric["gradient"]["saving_percent"]),
                 number(metric["physical_saving_with_base_percent"], 2),
                 number(move["paper_saving_percent"])]
            )  # fmt: skip
    header = ("move", "metric", "baseline J", "swarm saving % (median)", "gradient saving %",
              "physical saving with base %", "paper saving %")  # fmt: skip
    return markdown_table(header, rows)
