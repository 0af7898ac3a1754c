"""`dmoc measured`: a controller's log beside the plan."""

from __future__ import annotations

from pathlib import Path

from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.measured import measured_against_plan
from sequencing.report.measured_tables import measured_markdown


def run_measured(console: Console, log: Path, run: Path, out: Path | None) -> CommandResult:
    """Time, position, current and energy of a log against the run that was exported."""
    data = measured_against_plan(log, run)
    console.show(measured_markdown(data))
    save_json(out, "measured.json", data)
    return CommandResult(data)
