"""`export_run`: a run as files for controllers, or a refusal that says which limit is broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from dmoc.errors import InputError
from sequencing.export.checks import check_exportable
from sequencing.export.krl import WELD_FILE, krl_program
from sequencing.export.program import program_of
from sequencing.export.rapid import WELD_MODULE, rapid_program
from sequencing.export.ros import ROS_STATEMENT, ros_files
from sequencing.export.rtde import csv_log, rtde_log
from sequencing.export.urscript import WELD_FUNCTION, urscript_program
from sequencing.export.wording import CUBIC, STREAMED, TIMED, program_name, six_joints
from sequencing.runs.archive import json_text, write_atomic
from sequencing.runs.folder import Run


@dataclass(frozen=True)
class Export:
    """Files written, what the format keeps of the plan, and what the program deviates.

    `max_deviation_rad` is the largest distance of any joint between the planned curve and the one
    that the controller makes of the file, as modelled. `beside` are the routine of the plant and
    the report of the program (`NAME.program.json`).
    """

    format: str
    files: tuple[Path, ...]
    statement: str
    max_deviation_rad: float | None
    beside: tuple[Path, ...] = ()


# Format: end of the file's name, and the writer of its text and deviation with the default step.
_STREAMS: dict[str, tuple[str, Callable[[Run, float], tuple[str, float]], float]] = {
    "csv": (".csv", csv_log, 0.01),
    "rtde": (".rtde.csv", rtde_log, 0.008),
}


class _Language(NamedTuple):
    name: str
    vendor: str
    model: Literal["zones", "spline", "cubic"]
    suffix: str
    weld_file: str
    weld_text: str


_LANGUAGES = {
    "rapid": _Language("RAPID", "abb", "zones", ".mod", "dm_welds.mod", WELD_MODULE),
    "krl": _Language("KRL", "kuka", "spline", ".src", "dm_weld.src", WELD_FILE),
    "urscript": _Language("URScript", "ur", "cubic", ".script", "dm_weld.script", WELD_FUNCTION),
}
EXPORT_FORMATS = tuple(sorted([*_STREAMS, *_LANGUAGES, "ros"]))


def export_run(run: Run, format: str, out: Path | str, step_s: float | None = None) -> Export:
    """Write `run` in `format` to the folder `out`.

    Formats: `csv` and `rtde` (the cycle on an even clock), `ros` (JointTrajectory, one file a
    motion), and programs in the controller's own angles: `urscript` (cubics evaluated on every
    control step, or servoj every `step_s`), `rapid` (MoveAbsJ with zones and times) and `krl`
    (spline blocks with times). A weld is a call of a routine that the plant owns: a file beside
    the program that is written where it is not there.

    Errors: `InputError` with export-format, export-step, export-limit, export-uncertified,
    export-motion, export-joints, export-controller, export-target or export-clearance; nothing is
    written then.
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
    out = Path(out)
    if format in _LANGUAGES:
        return _program(run, format, out, step_s)
    deviation = 0.0
    if format == "ros":
        files, statement = ros_files(run), ROS_STATEMENT
    else:
        suffix, stream, usual_s = _STREAMS[format]
        text, deviation = stream(run, usual_s if step_s is None else step_s)
        stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in run.name) or "run"
        files, statement = {stem + suffix: text}, STREAMED
    for name, text in files.items():
        write_atomic(out / name, text)
    return Export(format, tuple(out / name for name in files), statement, deviation)


def _program(run: Run, format: str, out: Path, step_s: float | None) -> Export:
    """A program, its report, and the plant's weld routine where it is not there yet."""
    language = _LANGUAGES[format]
    six_joints(run, language.name)
    program = program_of(run, language.model, language.vendor, language.name)
    stem, routine = out / program_name(run.name, language.name), out / language.weld_file
    deviation, statement = program.report["deviation_rad"], TIMED
    weld = routine.read_text(encoding="ascii") if routine.is_file() else language.weld_text
    if format == "urscript":
        text, deviation = urscript_program(program, weld, step_s)
        statement = CUBIC if step_s is None else STREAMED
    else:
        text = (rapid_program if format == "rapid" else krl_program)(program)
    file = stem.with_name(stem.name + language.suffix)
    report = stem.with_name(stem.name + ".program.json")
    write_atomic(file, text)
    write_atomic(report, json_text({"format": format, "file": file.name, **program.report}))
    if not routine.is_file():
        write_atomic(routine, weld)
    return Export(format, (file,), statement, deviation, (report, routine))
