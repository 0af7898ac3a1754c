"""`dmoc study`: a published study, run anew, found among the installed entry points."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

from dmoc.errors import Fault, InputError
from sequencing.commands.console import CommandResult, Console

GROUP = "dmoc.studies"


def run_study(
    console: Console,
    name: str,
    station: str,
    seed: int,
    out: Path | None,
    workers: int,
    reduced: bool = False,
) -> CommandResult:
    """Run the study `name` of the entry-point group `dmoc.studies`."""
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in found:
        raise InputError(
            Fault(
                "study-unknown",
                field="study",
                value=name,
                legal=", ".join(sorted(found)) or f"none is installed (entry points {GROUP})",
                fix="name one of them",
            )
        )
    result: CommandResult = found[name].load()(console, station, seed, out, workers, reduced)
    return result
