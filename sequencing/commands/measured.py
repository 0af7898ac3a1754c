"""`dmoc measured`: a controller's log beside the plan."""

from __future__ import annotations

import json
from pathlib import Path

from sequencing.commands.console import Console, Outcome, plain, save_json
from sequencing.measured import measured_against_plan

__all__ = ["run_measured"]


def run_measured(console: Console, log: Path, run: Path, out: Path | None) -> Outcome:
    """Time, position, current and energy of a log against the run that was exported."""
    data = measured_against_plan(log, run)
    for key, value in data.items():
        console.show(f"{key}: {json.dumps(plain(value))}")
    save_json(out, "measured.json", data)
    return Outcome(data)
