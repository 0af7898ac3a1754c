"""Studs: the frozen type, and `studs.csv` with every fault by row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmoc.arrays import Array, StaysReadonly, readonly
from dmoc.errors import Fault, InputError
from dmoc.table_file import number_of, read_table

REQUIRED = ("id", "x_m", "y_m", "z_m", "nx", "ny", "nz", "weld_time_s")
OPTIONAL = (
    "spin_free",
    "spin_from_deg",
    "spin_to_deg",
    "group",
    "depart_x",
    "depart_y",
    "depart_z",
    "depart_m",
    "on",
    "frame",
)
#: Columns that may stand for those of REQUIRED, and how many of their unit make a metre.
_MILLIMETRES = {"x_m": "x_mm", "y_m": "y_mm", "z_m": "z_mm"}
_TEXTS = ("id", "spin_free", "group", "on", "frame")
_TRUE, _FALSE = ("1", "true", "yes"), ("0", "false", "no")
_MOST_BYTES = 20_000_000


@dataclass(frozen=True)
class DepartureDefault:
    """The station's default: `direction` (3,) world or None (the stud's normal), `length_m`."""

    direction: Array | None = None
    length_m: float = 0.03


@dataclass(frozen=True, eq=False)
class Stud(StaysReadonly):
    """A weld: the tip's target and the straight line on which the gun leaves it.

    `position_m`, `normal`, `depart_direction` are (3,) in world axes, the last two unit vectors;
    the normal points out of the part. With `spin_free` the tool may turn about the normal. `on`
    names the obstacle that the stud sits on ("" if none). `spin_rad` are the first and the last
    turn of the tool about the normal that are allowed (None: all), from where `weld_poses`
    says.
    """

    id: str
    position_m: Array
    normal: Array
    weld_time_s: float
    group: str
    depart_direction: Array
    depart_m: float
    spin_free: bool = True
    on: str = ""
    spin_rad: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("position_m", "normal", "depart_direction"):
            object.__setattr__(self, name, readonly(getattr(self, name), name, 1))


def read_studs(
    path: Path,
    departure: DepartureDefault = DepartureDefault(),
    frames: Mapping[str, Array] | None = None,
) -> tuple[Stud, ...]:
    """The studs of a table (`id, x_m, y_m, z_m, nx, ny, nz, weld_time_s` and optional columns).

    `frames` has the pose (4, 4) of every body that a row may name as its `frame`; None leaves such
    rows where they are.

    Errors: `InputError` with the faults of all rows (code, line, column, value, legal, fix).
    """
    table = read_table(path, _TEXTS, _MOST_BYTES, "studs")
    header = table.header
    faults: list[Fault] = []
    _check_header(header, path, faults)
    if faults:
        raise InputError(faults)
    studs: list[Stud] = []
    seen: dict[str, int] = {}
    for line, row in table.rows:
        found = len(faults)
        if len(row) != len(header):
            faults.append(
                Fault(
                    "stud-row",
                    file=str(path),
                    line=line,
                    value=f"{len(row)} cells",
                    legal=f"{len(header)} cells",
                    fix="one cell for each column",
                )
            )
            continue
        cells = dict(zip(header, row, strict=True))
        stud = _stud(cells, departure, frames, path, line, faults)
        if cells["id"] in seen:
            faults.append(
                Fault(
                    "stud-duplicate",
                    file=str(path),
                    line=line,
                    field="id",
                    value=cells["id"],
                    legal=f"names used once (also on line {seen[cells['id']]})",
                    fix="rename it",
                )
            )
        seen[cells["id"]] = line
        if len(faults) == found and stud is not None:
            studs.append(stud)
    if not studs and not faults:
        faults.append(
            Fault(
                "studs-empty",
                file=str(path),
                value="no stud",
                legal="at least one stud",
                fix="add a row per stud",
            )
        )
    if faults:
        raise InputError(faults)
    return tuple(studs)


def _check_header(header: list[str], path: Path, faults: list[Fault]) -> None:
    legal = ", ".join((*REQUIRED, *OPTIONAL, *_MILLIMETRES.values()))
    for name in REQUIRED:
        in_mm = _MILLIMETRES.get(name, name)
        if in_mm != name and name in header and in_mm in header:
            found = f"{name} and {in_mm}"
            faults.append(
                Fault("csv-column", str(path), in_mm, found, "one of them", "remove one", 1)
            )
        if name not in header and in_mm not in header:
            faults.append(
                Fault(
                    "csv-column",
                    file=str(path),
                    line=1,
                    field=name,
                    value="no such column",
                    legal=legal,
                    fix="add the column",
                )
            )
    for name in sorted(set(header)):
        if name not in (*REQUIRED, *OPTIONAL, *_MILLIMETRES.values()):
            faults.append(
                Fault(
                    "csv-column",
                    file=str(path),
                    line=1,
                    field=name,
                    value=name,
                    legal=legal,
                    fix="remove the column or mend its name",
                )
            )
        elif header.count(name) > 1:
            faults.append(
                Fault(
                    "csv-column",
                    file=str(path),
                    line=1,
                    field=name,
                    value="given twice",
                    legal="each column once",
                    fix="remove one",
                )
            )


def _stud(
    cells: dict[str, str],
    departure: DepartureDefault,
    frames: Mapping[str, Array] | None,
    path: Path,
    line: int,
    faults: list[Fault],
) -> Stud | None:
    start = len(faults)

    def refuse(column: str, value: str, legal: str, fix: str, code: str = "stud-value") -> None:
        faults.append(
            Fault(
                code,
                file=str(path),
                line=line,
                field=column,
                value=value[:80],
                legal=legal,
                fix=fix,
            )
        )

    def number(column: str, least: float, most: float) -> float:
        text = cells.get(column, "")
        value = number_of(text)
        if not least <= value <= most:
            fix = "write a number"
            if column in ("x_m", "y_m", "z_m") and np.isfinite(value):
                fix = "lengths are metres: divide millimetres by 1000"
            elif text.count(",") == 1:
                fix = "write a decimal point instead of the comma"
            refuse(column, repr(text), f"a number from {least:g} to {most:g}", fix)
            return np.nan
        return value

    if not 1 <= len(cells["id"]) <= 80 or not cells["id"].isprintable():
        refuse("id", repr(cells["id"]), "a name of 1 to 80 printable characters", "name the stud")
    position = np.array(
        [
            number(name, -100, 100) if name in cells else number(in_mm, -1e5, 1e5) / 1000.0
            for name, in_mm in _MILLIMETRES.items()
        ]
    )
    if np.any(np.abs(position) > 60):
        refuse(
            "x_m, y_m, z_m",
            str(position),
            "metres, at most 60",
            "divide millimetres by 1000",
            "stud-unit",
        )
    normal = np.array([number(name, -1e6, 1e6) for name in ("nx", "ny", "nz")])
    weld_time = number("weld_time_s", 0, 1e5)
    lengths = [cells.get(name, "") for name in ("depart_x", "depart_y", "depart_z")]
    if any(lengths):
        direction = np.array(
            [number(name, -1e6, 1e6) for name in ("depart_x", "depart_y", "depart_z")]
        )
    else:
        direction = normal if departure.direction is None else np.array(departure.direction)
    frame = cells.get("frame", "")
    if frame and frames is not None and frame not in frames:
        refuse("frame", frame, ", ".join(frames) or "no obstacle", "name an obstacle", "stud-frame")
    elif frame and frames is not None:
        turn, at = frames[frame][:3, :3], frames[frame][:3, 3]
        if any(lengths) or departure.direction is None:
            direction = turn @ direction  # the station's own direction is the world's
        position, normal = turn @ position + at, turn @ normal
    depart_m = departure.length_m
    if cells.get("depart_m"):
        depart_m = number("depart_m", 1e-4, 1.0)
    spin_text = cells.get("spin_free", "").lower()
    if spin_text not in ("", *_TRUE, *_FALSE):
        refuse("spin_free", repr(spin_text), "true or false", "write true or false")
    spin = None
    given = [name for name in ("spin_from_deg", "spin_to_deg") if cells.get(name)]
    if len(given) == 1:
        refuse(given[0], cells[given[0]], "both ends of the range, or none", "give the other too")
    elif given:
        low, high = (number(name, -360, 360) for name in given)
        if not 0 <= high - low <= 360 and np.isfinite(high - low):
            value = f"{low:g} to {high:g}"
            refuse("spin_to_deg", value, "0 to 360 degrees from spin_from_deg", "mend the range")
        if spin_text in _FALSE:
            refuse("spin_free", spin_text, "true where a range is given", "leave one of them out")
        spin = (float(np.radians(low)), float(np.radians(high)))
    if len(faults) > start:
        return None
    for column, vector in (("nx, ny, nz", normal), ("depart_x, depart_y, depart_z", direction)):
        if np.linalg.norm(vector) < 1e-6:
            refuse(column, str(vector), "a vector that is not zero", "give a direction")
            return None
    normal = normal / np.linalg.norm(normal)
    direction = direction / np.linalg.norm(direction)
    if normal @ direction <= 0.05:
        refuse(
            "depart_x, depart_y, depart_z",
            str(direction.round(3)),
            "a direction away from the part (positive along the normal)",
            "turn the direction or the normal around",
            "stud-departure",
        )
        return None
    return Stud(
        id=cells["id"],
        position_m=position,
        normal=normal,
        weld_time_s=weld_time,
        group=cells.get("group", ""),
        depart_direction=direction,
        depart_m=depart_m,
        spin_free=spin_text not in _FALSE,
        on=cells.get("on", ""),
        spin_rad=spin,
    )
