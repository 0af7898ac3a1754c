"""A controller's log: CSV with the names that Universal Robots' RTDE gives its signals."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError


@dataclass(frozen=True, eq=False)
class ControllerLog:
    """K samples of n joints: `t_s` (K,) from 0, `q_rad`, `velocity_rad_s` (K, n).

    `source` says whether positions are `actual` or `target` ones. `current_a` (K, n),
    `joint_voltage_v` (K, n) and the robot's DC power `power_w` (K,) are None where the log has
    none.
    """

    t_s: Array
    q_rad: Array
    velocity_rad_s: Array
    source: str
    current_a: Array | None = None
    joint_voltage_v: Array | None = None
    power_w: Array | None = None

    @property
    def duration_s(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.t_s[-1])


def read_controller_log(path: Path | str) -> ControllerLog:
    """The log in a CSV file: `timestamp` [s] and `actual_q_0` … or `target_q_0` … at least.

    `actual_qd_*`, `actual_current_*`, `actual_joint_voltage_*`, `actual_robot_voltage` and
    `actual_robot_current` are used where present; other columns are left alone, lines that begin
    with # skipped. Lines may end with CR, LF or both; a repeated time stamp keeps its first row.
    Velocities that were not logged are differences of the positions.

    Errors: `InputError` (log-missing, log-columns, log-value, log-samples, log-time).
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(
            Fault("log-missing", file=str(path), legal="a CSV file", fix="check the path")
        )
    text = path.read_bytes().decode("utf-8", "replace").lstrip("\ufeff")
    lines = [line for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n") if line]
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    header = [name.strip() for name in rows[0]] if rows else []
    table = _numbers(path, header, rows[1:])
    source = next((kind for kind in ("actual", "target") if f"{kind}_q_0" in table), None)
    if "timestamp" not in table or source is None:
        raise InputError(
            Fault(
                "log-columns",
                file=str(path),
                field="header",
                value=", ".join(header[:8]),
                legal="timestamp and actual_q_0, actual_q_1, … (or target_q_0, …)",
                fix="record timestamp and actual_q with RTDE, one column per joint",
            )
        )
    stamp = table["timestamp"]
    keep = np.concatenate([[True], np.diff(stamp) > 0])
    if np.any(np.diff(stamp) < 0):
        row = int(np.argmax(np.diff(stamp) < 0)) + 3
        raise InputError(
            Fault(
                "log-time",
                file=str(path),
                field="timestamp",
                value="a time before the last",
                legal="rising times [s]",
                fix="log one recording to one file",
                line=row,
            )
        )
    if keep.sum() < 4:
        raise InputError(
            Fault(
                "log-samples",
                file=str(path),
                value=f"{keep.sum()} samples",
                legal=">= 4",
                fix="record the whole motion",
            )
        )
    t = stamp[keep] - stamp[0]
    joints = sum(f"{source}_q_{j}" in table for j in range(12))

    def columns(name: str) -> Array | None:
        names = [f"{name}_{j}" for j in range(joints)]
        found = all(key in table for key in names)
        return np.column_stack([table[key][keep] for key in names]) if found else None

    q = columns(f"{source}_q")
    if q is None:
        raise InputError(
            Fault(
                "log-columns",
                file=str(path),
                field="header",
                value=f"{joints} columns {source}_q_*, and a number is missing between them",
                legal=f"{source}_q_0, {source}_q_1, … without a gap",
                fix="record one column per joint",
            )
        )
    velocity = columns(f"{source}_qd")
    power = None
    if {"actual_robot_voltage", "actual_robot_current"} <= table.keys():
        power = (table["actual_robot_voltage"] * table["actual_robot_current"])[keep]
    return ControllerLog(
        t_s=t,
        q_rad=q,
        source=source,
        velocity_rad_s=np.gradient(q, t, axis=0) if velocity is None else velocity,
        current_a=columns("actual_current"),
        joint_voltage_v=columns("actual_joint_voltage"),
        power_w=power,
    )


_USED = ("timestamp", "actual_", "target_q")


def _numbers(path: Path, header: list[str], rows: list[list[str]]) -> dict[str, Array]:
    """The used columns as numbers; columns with an empty cell are left out."""
    table = {}
    for k, name in enumerate(header):
        if not name.startswith(_USED):
            continue
        cells = [row[k].strip() if k < len(row) else "" for row in rows]
        if "" in cells and name != "timestamp":
            continue
        try:
            table[name] = np.array([float(cell) for cell in cells])
        except ValueError as error:
            bad = next(i for i, cell in enumerate(cells) if not _is_number(cell))
            raise InputError(
                Fault(
                    "log-value",
                    file=str(path),
                    field=name,
                    value=repr(cells[bad]),
                    legal="a number",
                    fix="remove the row, or record again",
                    line=bad + 2,
                )
            ) from error
    return table


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
