"""`dmoc export`, `dmoc view`, `dmoc compare`: what can be done with a finished run."""

from __future__ import annotations

from pathlib import Path

from dmoc.errors import InputError
from dmoc.robot.robot import Robot
from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.export.exporting import export_run
from sequencing.report.curves import write_curves
from sequencing.report.html import write_report
from sequencing.report.measured_tables import measured_markdown
from sequencing.report.scene import write_scene
from sequencing.runs.compare import compare_runs, comparison_text, run_differences
from sequencing.runs.folder import Run, read_run, station_of
from sequencing.runs.measured import measured_against_plan


def run_measured(console: Console, log: Path, run: Path, out: Path | None) -> CommandResult:
    """Time, position, current and energy of a log against the run that was exported."""
    data = measured_against_plan(log, run)
    console.show(measured_markdown(data))
    save_json(out, "measured.json", data)
    return CommandResult(data)


def run_export(
    console: Console, run_dir: Path, format: str, step_s: float | None, out: Path | None
) -> CommandResult:
    """Write controller files; limits that are exceeded refuse the export (exit 2)."""
    export = export_run(read_run(run_dir), format, out or run_dir / "export", step_s)
    for path in (*export.files, *export.beside):
        console.show(f"wrote {path}")
    console.show(export.statement)
    return CommandResult(
        {
            "format": export.format,
            "files": [str(path) for path in export.files],
            "beside": [str(path) for path in export.beside],
            "statement": export.statement,
            "max_deviation_rad": export.max_deviation_rad,
        }
    )


def run_view(console: Console, run_dir: Path, out: Path | None) -> CommandResult:
    """Write curves, report and, where there is a station, the scene of a run anew."""
    run = read_run(run_dir)
    robot = _robot(run)
    folder = out or run_dir
    folder.mkdir(parents=True, exist_ok=True)
    files = [write_curves(run.timeline, robot, folder / "curves.png", run.name)]
    if run.planned:
        scene = folder / "scene.html"
        files.append(write_scene(station_of(run), run.timeline, scene, run.name))
    files.append(write_report(run, robot, folder / "report.html"))
    for path in files:
        console.show(f"wrote {path}")
    return CommandResult({"files": [str(path) for path in files]})


def run_compare(
    console: Console, first: Path, second: Path, out: Path | None, tolerance: float | None = None
) -> CommandResult:
    """Costs of two runs side by side; with a tolerance what differs by more, and then exit 1."""
    a, b = read_run(first), read_run(second)
    data = compare_runs(a, b)
    console.show(comparison_text(data))
    found: list[str] = []
    if tolerance is not None:
        found = run_differences(a, b, tolerance)
        data |= {"tolerance": tolerance, "differences": found}
        console.show(f"{len(found)} differences above {tolerance:g}" if found else "equal")
        for line in found:
            console.show(line)
    save_json(out, "compare.json", data)
    return CommandResult(data, 1 if found else 0)


def _robot(run: Run) -> Robot:
    """The run's robot: of the package, or the one of the station that was planned."""
    if run.robot is None and run.planned:
        return station_of(run).robot
    if run.robot is None:
        raise InputError.of(
            "run-robot",
            file=str(run.folder),
            field="robot",
            value=run.robot_note,
            legal="a robot of the package, or a planned run with its station",
            fix="plan again with this version",
        )
    return run.robot
