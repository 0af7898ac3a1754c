"""The published studies as `dmoc study` runs them: the entry points of the group `dmoc.studies`.

Each takes the console and the options of the command line, and refuses those it has no use for.
"""

from __future__ import annotations

import time
from pathlib import Path

from dmoc.errors import InputError
from dmoc.refinement.params import method_named
from dmoc.solving.solvers import DEFAULT_SOLVER
from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.commands.plan import headline, no_cycle, open_bench, write_pages
from sequencing.commands.study import StudyOptions
from sequencing.runs.folder import write_run

STATIONS = {"A": "stud_welding_a", "B": "stud_welding_b", "C": "stud_welding_c"}


def stud_welding(console: Console, options: StudyOptions) -> CommandResult:
    """Old against new sequence of a stud-welding station, and where the saving comes from."""
    from sequencing.cycle.plan import NoCycle
    from studies.stud_welding.page import study_entry, write_study
    from studies.stud_welding.study import run_stud_welding_study
    from studies.stud_welding.tables import stud_welding_markdown

    station = options.station
    if station not in STATIONS:
        raise InputError.of(
            "study-station",
            field="--station",
            value=station,
            legal=", ".join(STATIONS),
            fix="name one of them",
        )
    began = time.perf_counter()
    folder = (
        options.out
        or Path("runs") / f"study-{STATIONS[station]}{'-reduced' if options.reduced else ''}"
    )
    try:
        with open_bench(folder, options.workers) as bench:
            run = run_stud_welding_study(
                station,
                bench.store,
                seed=options.seed,
                reduced=options.reduced,
                solver=options.solver or DEFAULT_SOLVER,
                method=method_named(options.method or "half-spaces"),
                executor=bench.executor,
                progress=bench.progress,
            )
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


def pallet_cell(console: Console, options: StudyOptions) -> CommandResult:
    """Schedules of the three-robot cell: as fast as possible, stretched, windows, general."""
    from sequencing.commands.schedule import cases_table
    from studies.pallet_cell.study import run_pallet_cell_study

    options.refuse("solver", "its motions are given")
    options.refuse("method", "its motions are given")
    data = run_pallet_cell_study(options.seed, progress=console.say)
    console.show(cases_table(data["cases"]))
    folder = options.out or Path("runs") / "pallet-cell"
    save_json(folder, "study.json", data)
    console.show(f"written to {folder}")
    return CommandResult(data)


def ur3(console: Console, options: StudyOptions) -> CommandResult:
    """Bézier moves of the UR3 by swarm, gradient and in free form, on the paper's pairs."""
    from studies.ur3.study import run_ur3_study
    from studies.ur3.tables import ur3_markdown

    options.refuse("method", "nothing is refined against obstacles there")
    folder = options.out or Path("runs") / "ur3"
    data = run_ur3_study(
        options.seed,
        folder,
        reduced=options.reduced,
        solver=options.solver or "ipopt",
        progress=console.say,
    )
    text = ur3_markdown(data)
    (folder / "study.md").write_text(text, encoding="utf-8")
    console.show(text)
    console.show(f"written to {folder}")
    return CommandResult(data)
