"""`dmoc study`: a published study, run anew."""

from __future__ import annotations

import time
from pathlib import Path

from dmoc.errors import Fault, InputError
from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.commands.plan import headline
from sequencing.commands.run_folder import no_cycle, open_bench, write_pages
from sequencing.run_files import write_run

STUDIES = ("stud-welding", "pallet-cell", "ur3")
STATIONS = {"A": "stud_welding_a", "B": "stud_welding_b", "C": "stud_welding_c"}


def run_study(
    console: Console, name: str, station: str, seed: int, out: Path | None, workers: int,
    reduced: bool = False,
) -> CommandResult:  # fmt: skip
    """Run the study `name`; `station` (A, B or C) matters to stud-welding only."""
    if name not in STUDIES:
        raise InputError(
            Fault("study-unknown", field="study", value=name, legal=", ".join(STUDIES),
                  fix="name one of them")
        )  # fmt: skip
    if name == "stud-welding":
        return _stud_welding(console, station, seed, out, workers, reduced)
    folder = out or Path("runs") / name
    if name == "ur3":
        data = _ur3(console, seed, folder, reduced)
    else:
        data = _pallet_cell(console, seed)
        save_json(folder, "study.json", data.data)
    console.show(f"written to {folder}")
    return data


def _stud_welding(
    console: Console, station: str, seed: int, out: Path | None, workers: int, reduced: bool
) -> CommandResult:
    from sequencing.cycle import NoCycle
    from sequencing.report.stud_welding_page import study_entry, write_study
    from sequencing.report.stud_welding_tables import stud_welding_markdown
    from sequencing.studies.stud_welding import run_stud_welding_study

    if station not in STATIONS:
        raise InputError(
            Fault("study-station", field="--station", value=station, legal=", ".join(STATIONS),
                  fix="name one of them")
        )  # fmt: skip
    began = time.perf_counter()
    folder = out or Path("runs") / f"study-{STATIONS[station]}{'-reduced' if reduced else ''}"
    try:
        with open_bench(folder, workers) as bench:
            run = run_stud_welding_study(
                station, bench.store, seed=seed, reduced=reduced, executor=bench.executor,
                progress=bench.progress,
            )  # fmt: skip
    except NoCycle as none:
        return no_cycle(console, none, folder)
    for cycle, place in ((run.new, folder), (run.old, folder / "old")):
        write_run(cycle, place, {"wall_s": time.perf_counter() - began})
        write_pages(cycle, place)
    write_study(run.study, folder)
    console.show(stud_welding_markdown(run.study))
    console.show(
        f"written to {folder}: study.html, study.md, study.json, figures/, tables/, the run of the "
        f"new sequence, and in {folder / 'old'} that of the old one"
    )
    wall = time.perf_counter() - began
    data = {**headline(run.new, wall, folder), "study": study_entry(run.study)}
    return CommandResult(data, 0 if not run.new.unreachable else 3)


def _pallet_cell(console: Console, seed: int) -> CommandResult:
    from sequencing.commands.schedule import cases_table
    from sequencing.timing.study import run_pallet_cell_study

    data = run_pallet_cell_study(seed, progress=console.say)
    console.show(cases_table(data["cases"]))
    return CommandResult(data)


def _ur3(console: Console, seed: int, folder: Path, reduced: bool) -> CommandResult:
    from sequencing.report.ur3_tables import ur3_markdown
    from sequencing.studies.ur3 import run_ur3_study

    data = run_ur3_study(seed, folder, reduced=reduced, progress=console.say)
    text = ur3_markdown(data)
    (folder / "study.md").write_text(text, encoding="utf-8")
    console.show(text)
    return CommandResult(data)
