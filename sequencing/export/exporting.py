"""`export_run`: a run as files for controllers, or a refusal that says which limit is broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dmoc.errors import InputError
from sequencing.export.checks import check_exportable
from sequencing.export.krl import krl_program
from sequencing.export.rapid import rapid_program
from sequencing.export.ros import ROS_STATEMENT, ros_files
from sequencing.export.rtde import csv_log, rtde_log
from sequencing.export.urscript import urscript_program
from sequencing.export.wording import POINT_TO_POINT, STREAMED, program_name
from sequencing.runs.archive import write_atomic
from sequencing.runs.folder import Run


@dataclass(frozen=True)
class Export:
    """Files written, what the format keeps of the plan, and what sampling costs.

    `max_deviation_rad` is the largest distance of any joint between the planned curve and the
    curve that the controller makes of the file, where that is known (straight lines between
    streamed points, a cubic through points with velocities); None where the controller decides.
    """

    format: str
    files: tuple[Path, ...]
    statement: str
    max_deviation_rad: float | None


# Format: end of the file's name, and the writer of its text and deviation with the default step.
_STREAMS: dict[str, tuple[str, Callable[[Run, float], tuple[str, float]], float]] = {
    "csv": (".csv", csv_log, 0.01),
    "rtde": (".rtde.csv", rtde_log, 0.008),
    "urscript": (".script", urscript_program, 0.008),
}
_PROGRAMS = {"krl": (".src", krl_program), "rapid": (".mod", rapid_program)}
_STATEMENTS = {"krl": POINT_TO_POINT, "rapid": POINT_TO_POINT, "ros": ROS_STATEMENT}
EXPORT_FORMATS = tuple(sorted([*_STREAMS, *_PROGRAMS, "ros"]))


def export_run(run: Run, format: str, out: Path | str, step_s: float | None = None) -> Export:
    """Write `run` in `format` to the folder `out`.

    Formats: `csv` and `rtde` (the cycle on an even clock), `urscript` (servoj every `step_s`,
    8 ms by default), `ros` (JointTrajectory, one file a motion), `rapid` (MoveAbsJ) and `krl`
    (PTP), both in degrees. Point-to-point formats do not preserve the timing and therefore not
    the torques; each file says so.

    Errors: `InputError` with export-format, export-step, export-limit, export-uncertified,
    export-motion or export-joints; nothing is written then.
    """
    if format not in EXPORT_FORMATS:
        raise InputError.of(
            "export-format",
            field="format",
            value=format,
            legal=", ".join(EXPORT_FORMATS),
            fix="choose one of these",
        )
    if step_s is not None and not 0.001 <= step_s <= 1.0:
        raise InputError.of(
            "export-step",
            field="step_s",
            value=repr(step_s),
            legal="0.001 to 1 s",
            fix="UR controllers take 0.002 or 0.008 s",
        )
    check_exportable(run)
    files, deviation = _texts(run, format, step_s)
    paths = []
    for name, text in files.items():
        paths.append(Path(out) / name)
        write_atomic(paths[-1], text)
    statement = _STATEMENTS.get(format, STREAMED)
    return Export(format, tuple(paths), statement, deviation)


def _texts(run: Run, format: str, step_s: float | None) -> tuple[dict[str, str], float | None]:
    """Text by file name, and the deviation where it is known."""
    if format == "ros":
        return ros_files(run), 0.0
    language = {"krl": "KRL", "rapid": "RAPID", "urscript": "URScript"}.get(format)
    stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in run.name) or "run"
    if language:
        stem = program_name(run.name, language)
    if format in _PROGRAMS:
        suffix, program = _PROGRAMS[format]
        return {stem + suffix: program(run)}, None
    suffix, stream, usual_s = _STREAMS[format]
    text, deviation = stream(run, usual_s if step_s is None else step_s)
    return {stem + suffix: text}, deviation
