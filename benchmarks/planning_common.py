"""Tables and result files of the planning benchmarks."""

from __future__ import annotations

import json
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

__all__ = ["save", "table"]

RESULTS = Path(__file__).parent / "results"
PACKAGES = ("coal", "python-fcl", "ompl", "pin", "numba", "numpy")


def table(head: list[str], rows: list[list[Any]]) -> str:
    """A Markdown table; numbers with three digits."""

    def text(value: Any) -> str:
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(text(v) for v in row) + " |" for row in rows]
    return "\n".join(lines)


def save(name: str, results: Any, title: str, text: str) -> None:
    """`results/name.json` and `.md`, with machine, versions and date."""
    about = {
        "date": date.today().isoformat(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "versions": {package: version(package) for package in PACKAGES},
        "time": "CPU seconds of the process; the machine was shared: read the ratios",
    }
    RESULTS.mkdir(exist_ok=True)
    record = json.dumps({"about": about, "results": results}, indent=1, default=float)
    (RESULTS / f"{name}.json").write_text(record + "\n")
    head = f"# {title}\n\n{about['date']}, Python {about['python']}, " + ", ".join(
        f"{k} {v}" for k, v in about["versions"].items()
    )
    (RESULTS / f"{name}.md").write_text(f"{head}. {about['time']}.\n\n{text}\n")
