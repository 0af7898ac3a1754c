"""`dmoc study`: a published study, run anew, found among the installed entry points."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from dmoc.errors import InputError
from sequencing.commands.console import CommandResult, Console

GROUP = "dmoc.studies"


@dataclass(frozen=True)
class StudyOptions:
    """What the command line says to a study; `station` (A, B or C) is stud-welding's.

    `solver` and `method` are None where the study's own are wanted.
    """

    station: str = "A"
    seed: int = 0
    out: Path | None = None
    workers: int = 0
    reduced: bool = False
    solver: str | None = None
    method: str | None = None

    def refuse(self, name: str, why: str) -> None:
        """An option that a study has no use for is a fault, not a silence."""
        value = getattr(self, name)
        if value is not None:
            raise InputError.of(
                "study-option",
                field=f"--{name}",
                value=value,
                legal=f"none: {why}",
                fix="leave it out",
            )


def run_study(console: Console, name: str, options: StudyOptions) -> CommandResult:
    """Run the study `name` of the entry-point group `dmoc.studies`."""
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in found:
        raise InputError.of(
            "study-unknown",
            field="study",
            value=name,
            legal=", ".join(sorted(found)) or f"none is installed (entry points {GROUP})",
            fix="name one of them",
        )
    result: CommandResult = found[name].load()(console, options)
    return result
