"""Tables and result files of the planning benchmarks."""

from __future__ import annotations

import json
import os
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

__all__ = ["machine_load", "merged", "save", "table"]

RESULTS = Path(__file__).parent / "results"
_LOAD_AT_START = os.getloadavg()[0]
PACKAGES = ("coal", "python-fcl", "ompl", "pin", "numba", "numpy")


def table(head: list[str], rows: list[list[Any]]) -> str:
    """A Markdown table; numbers with three digits."""

    def text(value: Any) -> str:
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(text(v) for v in row) + " |" for row in rows]
    return "\n".join(lines)


def machine_load() -> str:
    """What else the machine was doing: processes that wanted to run, this one included."""
    return (
        f"load average of the last minute {_LOAD_AT_START:.1f} at the start and "
        f"{os.getloadavg()[0]:.1f} at the end, this process included, {os.cpu_count()} cores"
    )


def merged(name: str, key: str, fresh: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """`fresh` rows in place of those of before with the same `key`; new ones behind."""
    path = RESULTS / f"{name}.json"
    before = json.loads(path.read_text(encoding="utf-8"))["results"] if path.is_file() else []
    new = {row[key]: row for row in fresh}
    rows = [new.pop(row[key], row) for row in before]
    return [*rows, *new.values()]


def save(name: str, results: Any, title: str, text: str) -> None:
    """`results/name.json` and `.md`, with machine, versions and date."""
    about = {
        "date": date.today().isoformat(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "versions": {package: version(package) for package in PACKAGES},
        "time": f"CPU seconds of the process; {machine_load()}",
    }
    RESULTS.mkdir(exist_ok=True)
    record = json.dumps({"about": about, "results": results}, indent=1, default=float)
    (RESULTS / f"{name}.json").write_text(record + "\n")
    head = f"# {title}\n\n{about['date']}, Python {about['python']}, " + ", ".join(
        f"{k} {v}" for k, v in about["versions"].items()
    )
    (RESULTS / f"{name}.md").write_text(f"{head}. {about['time']}.\n\n{text}\n")
