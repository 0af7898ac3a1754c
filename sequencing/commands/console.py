"""Where a command writes: one JSON object on stdout, or tables; everything else on stderr."""

from __future__ import annotations

import json as json_module
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dmoc.errors import Fault


@dataclass(frozen=True)
class CommandResult:
    """What a command returns: the object for `--json`, and the exit code."""

    data: Mapping[str, Any]
    exit_code: int = 0


@dataclass(frozen=True)
class Console:
    """The two streams of a command."""

    json: bool = False
    lines: list[str] = field(default_factory=list)

    def say(self, text: str) -> None:
        """A line for a person, on stderr."""
        sys.stderr.write(text + "\n")
        sys.stderr.flush()

    def show(self, text: str) -> None:
        """A result for a person: stdout, unless that belongs to JSON."""
        stream = sys.stderr if self.json else sys.stdout
        stream.write(text + "\n")
        stream.flush()

    def result(self, data: Mapping[str, Any]) -> None:
        """The one object of `--json`."""
        if self.json:
            sys.stdout.write(json_module.dumps(plain(data), allow_nan=False) + "\n")
            sys.stdout.flush()

    def errors(self, faults: Sequence[Fault]) -> None:
        """Coded errors on stderr, and as `errors` on stdout with `--json`."""
        for fault in faults:
            self.say(f"error {fault}")
        self.result({"errors": [fault.to_dict() for fault in faults]})


def plain(value: Any) -> Any:
    """Numbers, lists and dicts that JSON knows; infinite and NaN become null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy arrays and scalars; numpy itself is not imported here
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def save_json(folder: Path | None, name: str, data: Mapping[str, Any]) -> None:
    """Write the object of `--json` to `folder`/`name`, if a folder was asked for."""
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        text = json_module.dumps(plain(data), indent=1)
        (folder / name).write_text(text, encoding="utf-8")
