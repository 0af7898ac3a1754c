"""A controller's log: CSV with the names that Universal Robots' RTDE gives its signals."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.errors import InputError
from dmoc.table_file import decimal_fault, read_text, separator_of
from sequencing.runs.log_cells import ROW_CELLS, lines_with_cells, read_cells


@dataclass(frozen=True, eq=False)
class ControllerLog:
    """K samples of n joints: `t_s` (K,) from 0, `q_rad`, `velocity_rad_s` (K, n).

    `source` says whether positions are `actual` or `target` ones. `current_a` (K, n),
    `joint_voltage_v` (K, n), torques at the motors and at the joints (K, n) and the robot's
    DC power `power_w` (K,) are None where the log has none. Where `source` is `motor`, positions
    are those of the motors' encoders.
    """

    t_s: Array
    q_rad: Array
    velocity_rad_s: Array
    source: str
    current_a: Array | None = None
    joint_voltage_v: Array | None = None
    power_w: Array | None = None
    motor_torque_nm: Array | None = None
    joint_torque_nm: Array | None = None

    @property
    def duration_s(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.t_s[-1])


def read_controller_log(path: Path | str, motor: bool = False) -> ControllerLog:
    """The log in a table of text: `timestamp` [s] and `actual_q_0` … or `target_q_0` … at least.

    `actual_qd_*`, `actual_current_*`, `actual_joint_voltage_*`, `actual_robot_voltage` and
    `actual_robot_current` are used where present and not empty from top to bottom; other columns
    are left alone, lines that begin with # skipped. Between the columns stand commas, semicolons,
    tabs or blanks (UR's own recorder); a decimal comma is read where it is none of these. A
    repeated time stamp keeps its first row. Velocities that were not logged are differences of
    the positions.

    `motor_torque_*` and `actual_torque_*` [N·m] are read too; with `motor`, `motor_q_*` will do
    where no joint positions were logged.

    Nothing is guessed: a cell that is empty, NaN or no number, a gap in time, and values whose unit
    cannot be the one of RTDE (s, rad, A, V) are refused with the row.

    Errors: `InputError` (file-missing, file-large, log-columns, log-value, log-row, csv-decimal,
    log-samples, log-time, log-gap, log-unit).
    """
    table = _read(Path(path), motor)
    log = _log_of(table)
    _check_units(table, log)
    return log


@dataclass(frozen=True)
class _Columns:
    """The used columns by name, and the line in the file of every row."""

    path: Path
    values: dict[str, Array]
    lines: npt.NDArray[np.int64]

    def fault(
        self, code: str, field: str, value: str, legal: str, fix: str, row: int | None = None
    ) -> InputError:
        line = None if row is None else int(self.lines[row])
        return InputError.of(code, str(self.path), field, value, legal, fix, line)


_USED = re.compile(
    r"timestamp|(?:actual_qd?|target_qd?|actual_current|actual_joint_voltage)_\d+"
    r"|(?:motor_q|motor_torque|actual_torque)_\d+"
    r"|actual_robot_(?:voltage|current)"
)
#: Where positions may come from, best first.
_SOURCES = ("actual", "target", "motor")
_MOST_BYTES = 8_000_000_000


def _read(path: Path, motor: bool) -> _Columns:
    text = read_text(path, _MOST_BYTES)
    data = np.frombuffer(text.encode(), dtype=np.uint8)
    ends = np.append(np.flatnonzero(data == ord("\n")), len(data))
    starts = np.append(0, ends[:-1] + 1)
    lines = np.flatnonzero(lines_with_cells(data, starts, ends))
    if len(lines) and bytes(data[starts[lines[0]] : ends[lines[0]]]).startswith(b"sep="):
        lines = lines[1:]  # a spreadsheet's own line about the separator
    head = bytes(data[starts[lines[0]] : ends[lines[0]]]).decode() if len(lines) else ""
    mark = separator_of(head)
    cells = head.split() if mark == " " else head.split(mark)
    header = [name.strip().strip('"').strip() for name in cells]
    rows = lines[1:]
    used = [name for name in header if _USED.fullmatch(name)]
    where = _Columns(path, {}, rows + 1)
    if len(set(used)) < len(used):
        twice = next(name for name in used if used.count(name) > 1)
        raise where.fault(
            "log-columns", "header", f"{twice} twice", "each column once", "rename it"
        )
    if "timestamp" not in used or not {f"{s}_q_0" for s in _SOURCES[: 3 if motor else 2]} & set(
        used
    ):
        raise where.fault(
            "log-columns",
            "header",
            ", ".join(header[:8])[:120],
            "timestamp and actual_q_0, actual_q_1, … (or target_q_0, …)",
            "record timestamp and actual_q with RTDE, one column per joint",
        )
    out = np.empty((len(rows), len(used)))
    slot = np.array([used.index(name) if name in used else -1 for name in header])
    empty, marks = np.zeros((2, len(used)), dtype=np.int64), np.full(2, -1)
    kind, row, column = read_cells(
        data, starts[rows], ends[rows], ord(mark), slot, out, empty, marks
    )
    if kind:
        whole = bytes(data[starts[rows[row]] : ends[rows[row]]]).decode()
        if kind == ROW_CELLS:
            raise where.fault(
                "log-row",
                "",
                whole[:60],
                f"{len(header)} cells, as the header",
                "remove the row, or record again",
                row,
            )
        cell = (whole.split() if mark == " " else whole.split(mark))[column]
        raise where.fault(
            "log-value",
            header[column],
            repr(cell.strip())[:60],
            "a finite decimal number",
            "remove the row, or record again",
            row,
        )
    if marks.min() >= 0:
        raise decimal_fault(path, int(where.lines[marks[0]]), int(where.lines[marks[1]]))
    for k, name in enumerate(used):
        if 0 < empty[0, k] < len(rows):
            raise where.fault(
                "log-value",
                name,
                "an empty cell",
                "a number in every row, or none in the column",
                "remove the row, or record again",
                int(empty[1, k]),
            )
    where.values.update(
        {name: out[:, k] for k, name in enumerate(used) if not empty[0, k] or not len(rows)}
    )
    return where


def _joints(table: _Columns, name: str) -> list[str]:
    """The columns `name`_0, `name`_1, … without a hole; empty where there is none."""
    found = sorted(
        int(key.rpartition("_")[2])
        for key in table.values
        if key.rpartition("_")[0] == name and key != "actual_robot_current"
    )
    if found != list(range(len(found))):
        raise table.fault(
            "log-columns",
            name,
            ", ".join(f"{name}_{j}" for j in found)[:120],
            f"{name}_0, {name}_1, … without a hole",
            "record every joint",
        )
    return [f"{name}_{j}" for j in found]


def _log_of(table: _Columns) -> ControllerLog:
    stamp = table.values.get("timestamp", np.empty(0))
    source = next((kind for kind in _SOURCES if f"{kind}_q_0" in table.values), "")
    steps = np.diff(stamp)
    if np.any(steps < 0):
        row = int(np.argmax(steps < 0)) + 1
        raise table.fault(
            "log-time",
            "timestamp",
            "a time before the last",
            "rising times [s]",
            "log one recording to one file",
            row,
        )
    keep = np.concatenate([[True], steps > 0]) if len(stamp) else np.zeros(0, dtype=bool)
    if keep.sum() < 4 or not source:
        raise table.fault(
            "log-samples", "", f"{keep.sum()} samples", ">= 4", "record the whole motion"
        )
    steps, rows = np.diff(stamp[keep]), np.flatnonzero(keep)
    usual = float(np.median(steps))
    if usual > LONGEST_STEP_S:
        raise table.fault(
            "log-unit",
            "timestamp",
            f"{usual:g} from row to row",
            f"seconds, at most {LONGEST_STEP_S:g} from row to row",
            "divide milliseconds by 1000, or record faster",
        )
    longest = max(GAP_STEPS * usual, GAP_S)
    if steps.max() > longest:
        gap = int(np.argmax(steps > longest))
        raise table.fault(
            "log-gap",
            "timestamp",
            f"{steps[gap]:.4g} s without a sample",
            f"<= {longest:.4g} s (samples come every {usual:.4g} s)",
            "record again: what happened in between is not known",
            int(rows[gap + 1]),
        )
    names = _joints(table, f"{source}_q")
    t = stamp[keep] - stamp[0]

    def columns(name: str) -> Array | None:
        found = _joints(table, name)
        if found and len(found) != len(names):
            raise table.fault(
                "log-columns",
                name,
                f"{len(found)} columns",
                f"{len(names)}, as {source}_q",
                "record every joint, or leave the columns out",
            )
        return np.column_stack([table.values[key][keep] for key in found]) if found else None

    q = np.column_stack([table.values[key][keep] for key in names])
    velocity = columns(f"{source}_qd")
    power = None
    if {"actual_robot_voltage", "actual_robot_current"} <= table.values.keys():
        power = (table.values["actual_robot_voltage"] * table.values["actual_robot_current"])[keep]
    return ControllerLog(
        t_s=t,
        q_rad=q,
        source=source,
        velocity_rad_s=np.gradient(q, t, axis=0) if velocity is None else velocity,
        current_a=columns("actual_current"),
        joint_voltage_v=columns("actual_joint_voltage"),
        power_w=power,
        motor_torque_nm=columns("motor_torque"),
        joint_torque_nm=columns("actual_torque"),
    )


#: Samples further apart than this say nothing about a motion [s].
LONGEST_STEP_S = 0.5
#: A gap is longer than this many usual steps, and than this [s].
GAP_STEPS, GAP_S = 5.0, 0.1
#: The largest value that a column may have in its own unit: rad, rad/s, A, V.
_LARGEST = {"q": 26.0, "qd": 20.0, "current": 300.0, "voltage": 1500.0}


def _check_units(table: _Columns, log: ControllerLog) -> None:
    """Refuse degrees, milliseconds, milliamperes: by size, and by velocity against position."""
    legal = {"q": "radians", "qd": "rad/s", "current": "amperes", "voltage": "volts"}
    for name, values in table.values.items():
        kind = name.rstrip("0123456789_").rpartition("_")[2]
        most = None if name.startswith("motor_") else _LARGEST.get(kind)
        if most is not None and np.abs(values).max() > most:
            row = int(np.argmax(np.abs(values) > most))
            raise table.fault(
                "log-unit",
                name,
                f"{values[row]:g}",
                f"{legal[kind]}, at most {most:g}",
                "convert the column, or remove the row",
                row,
            )
    step = np.diff(log.t_s)[:, None]
    driven = 0.5 * (log.velocity_rad_s[1:] + log.velocity_rad_s[:-1]) * step
    moved = np.diff(log.q_rad, axis=0)
    if np.abs(moved).sum() < 0.2:
        return
    slope = float(np.sum(moved * driven) / max(float(np.sum(driven**2)), 1e-300))
    if not 0.5 <= slope <= 2.0:
        raise table.fault(
            "log-unit",
            f"{log.source}_q, {log.source}_qd, timestamp",
            f"positions move {slope:.3g} times as far as the velocities say",
            "s, rad and rad/s",
            "convert milliseconds to seconds and degrees to radians",
        )
