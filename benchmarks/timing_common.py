"""Tables of the timing benchmarks: printed, and kept with machine, versions and date."""

from __future__ import annotations

import datetime
import json
import os
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

__all__ = ["data_folder", "save_table"]

RESULTS = Path(__file__).parent / "results"
PACKAGES = ("casadi", "coal", "numba", "numpy", "pin", "scipy", "cma", "pyswarms")


def data_folder(name: str) -> Path:
    """A folder of the benchmark data: $DMOC_DATA, else ../shared/data beside the project."""
    root = os.environ.get("DMOC_DATA")
    base = Path(root) if root else Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = base / name
    if not folder.is_dir():
        raise SystemExit(f"{name}: no data at {base} (set DMOC_DATA); skipped")
    return folder


def save_table(name: str, rows: Sequence[Mapping[str, Any]], title: str) -> None:
    """Print `rows` as a table and write results/NAME.md and .json."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for row in rows:
        cells = [_text(row.get(column, "")) for column in columns]
        lines.append("| " + " | ".join(cells) + " |")
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "absent"
    python = platform.python_version()
    about = {
        "date": datetime.date.today().isoformat(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {python}",
        "versions": versions,
    }
    table = "\n".join(lines)
    print(f"{title}\n\n{table}\n")
    RESULTS.mkdir(exist_ok=True)
    note = f"CPU time, one thread. {about['date']}, {about['machine']}, "
    note += ", ".join(f"{k} {v}" for k, v in versions.items())
    (RESULTS / f"{name}.md").write_text(f"# {title}\n\n{table}\n\n{note}\n", encoding="utf-8")
    data = {"title": title, **about, "rows": [dict(row) for row in rows]}
    text = json.dumps(data, indent=1, default=float)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def _text(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)
