"""Reading exported programs back: what a controller would be told, in radians.

Meant for checking exports and for comparing logs, not for programs that others wrote.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array

_BEGIN = re.compile(r"^\s*[#!;] motion (\S+) ")
_END = re.compile(r"^\s*[#!;] end \S+")


class ReadMotion(NamedTuple):
    """What a program tells of one motion: targets (K, n) [deg] in the controller's angles, the
    time (K,) [s] of each stretch, and which targets are exact stops. A track [mm] comes last."""

    degrees: Array
    times_s: Array
    exact: npt.NDArray[np.bool_]


def read_urscript(path: Path) -> dict[str, Array]:
    """Joint vectors (K, n) [rad] of the servoj commands of every motion, by key."""
    return _by_motion(path, re.compile(r"servoj\(\[([^\]]+)\]"))


def read_cubics(path: Path) -> dict[str, tuple[Array, Array, Array]]:
    """Times (K + 1,) [s], knots and speeds (K + 1, n) [rad] of every motion of a URScript."""
    found = {}
    for key, rows in _by_motion(path, re.compile(r"dm_cubic\((.+), dm_t\)")).items():
        times = np.r_[0.0, np.cumsum(rows[:, -1])]
        q0, v0, q1, v1 = np.split(rows[:, :-1], 4, axis=1)
        found[key] = (times, np.vstack([q0, q1[-1:]]), np.vstack([v0, v1[-1:]]))
    return found


def read_rapid(path: Path) -> dict[str, ReadMotion]:
    """The MoveAbsJ of every motion, by key."""
    rows = _by_motion(path, re.compile(r"MoveAbsJ \[(\[[^\]]+\],\[[^\]]+\])\].*\\T:=([\d.]+), "))
    zone = re.compile(r"MoveAbsJ .*\\T:=[\d.]+, (\w+),")
    stops = _by_motion(path, zone, lambda text: [float(text == "fine")])
    return {
        key: ReadMotion(row[:, :-1], row[:, -1], stops[key][:, 0] > 0) for key, row in rows.items()
    }


def read_krl(path: Path) -> dict[str, ReadMotion]:
    """The SPTP of every motion's spline block, by key; parts of its time in per cent."""
    points = _by_motion(path, re.compile(r"SPTP \{([^}]+)\}"))
    parts = _by_motion(path, re.compile(r"TIME_BLOCK (?:PART|END) = ([\d.]+)"))
    found = {}
    for key, degrees in points.items():
        shares, seconds = parts[key][:-1, 0] / 100, parts[key][-1, 0]
        times = seconds * np.r_[shares, 1 - shares.sum()]
        found[key] = ReadMotion(degrees, times, np.arange(len(times)) == len(times) - 1)
    return found


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


def _numbers(text: str) -> list[float]:
    return [float(x) for x in re.findall(r"(?<![A-Za-z\d])[-+]?\d+\.\d+", text)]


def _by_motion(
    path: Path,
    command: re.Pattern[str],
    read: Callable[[str], list[float]] = _numbers,
) -> dict[str, Array]:
    found: dict[str, list[list[float]]] = {}
    key = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        if begin := _BEGIN.match(line):
            key = begin.group(1)
            found[key] = []
        elif _END.match(line):
            key = ""
        elif key and (hit := command.search(line)):
            found[key].append(read(" ".join(hit.groups())))
    return {name: np.array(values) for name, values in found.items()}
