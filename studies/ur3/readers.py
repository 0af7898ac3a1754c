"""Reading exported programs back: what a controller would be told, in radians.

Meant for checking exports and for comparing logs, not for programs that others wrote.
"""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np

from dmoc.arrays import Array

_BEGIN = re.compile(r"^\s*[#!;] motion (\S+) ")
_END = re.compile(r"^\s*[#!;] end \S+")


def read_urscript(path: Path) -> dict[str, Array]:
    """Joint vectors (K, n) [rad] of the servoj commands of every motion, by key."""
    return _by_motion(path, re.compile(r"servoj\(\[([^\]]+)\]"))


def read_rapid(path: Path) -> dict[str, Array]:
    """Joint vectors (K, 6) [rad] of the MoveAbsJ of every motion, by key."""
    found = _by_motion(path, re.compile(r"MoveAbsJ \[\[([^\]]+)\]"))
    return {key: np.radians(values) for key, values in found.items()}


def read_krl(path: Path) -> dict[str, Array]:
    """Joint vectors (K, 6) [rad] of the PTP of every motion, by key."""
    found = _by_motion(path, re.compile(r"PTP \{([^}]+)\}"))
    return {key: np.radians(values) for key, values in found.items()}


def read_ros(path: Path) -> tuple[str, Array, Array, Array]:
    """Key, times (K,) [s], positions and velocities (K, n) of one motion's file."""
    data = json.loads(path.read_text(encoding="utf-8"))
    points = data["joint_trajectory"]["points"]
    times = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    position, velocity = (
        np.array([point[name] for point in points]) for name in ("positions", "velocities")
    )
    return data["key"], np.array(times), position, velocity


def read_log(path: Path) -> dict[str, Array]:
    """Columns of a `csv` or `rtde` export by name; empty cells are NaN, text columns left out."""
    with path.open(encoding="utf-8", newline="") as stream:
        lines = [line for line in stream if not line.startswith("#")]
    header, *rows = csv.reader(lines)
    return {
        name: np.array([float(row[k]) if row[k] else np.nan for row in rows])
        for k, name in enumerate(header)
        if name != "segment"
    }


def _by_motion(path: Path, command: re.Pattern[str]) -> dict[str, Array]:
    found: dict[str, list[list[float]]] = {}
    key = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        if begin := _BEGIN.match(line):
            key = begin.group(1)
            found[key] = []
        elif _END.match(line):
            key = ""
        elif key and (hit := command.search(line)):
            numbers = re.findall(r"(?<![A-Za-z\d])[-+]?\d+\.\d+", hit.group(1))
            found[key].append([float(x) for x in numbers])
    return {name: np.array(values) for name, values in found.items()}
