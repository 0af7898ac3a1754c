"""Tables of text as programs write them: the separator, the decimal mark, cells with their line."""

from __future__ import annotations

import csv
import errno
import io
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from dmoc.errors import InputError
from dmoc.input_file import content_of

_NUMBER = re.compile(r"[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?")
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}


def read_text(path: Path, most_bytes: int, field: str = "") -> str:
    """The text of a UTF-8 file (UTF-16 with its mark too) with plain newlines.

    Errors: `InputError` (file-missing, file-large, file-encoding).
    """

    def refuse(code: str, value: str, legal: str, fix: str) -> InputError:
        return InputError.of(code, str(path), field, value[:120], legal, fix)

    try:
        data = content_of(path, most_bytes)
    except OSError as error:
        if error.errno == errno.EFBIG:
            legal = f"<= {most_bytes} bytes"
            raise refuse("file-large", str(error.strerror), legal, "split the file") from error
        legal = "an existing, readable file"
        raise refuse("file-missing", path.name, legal, "check the name") from error
    wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise refuse("file-encoding", str(error), "UTF-8 text", "save it as UTF-8") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def separator_of(header: str) -> str:
    """What stands between the columns of a header: `,`, `;`, a tab, or else blanks."""
    counts = {mark: header.count(mark) for mark in (",", ";", "\t")}
    most = max(counts, key=lambda mark: counts[mark])
    return most if counts[most] else " "


@dataclass(frozen=True)
class Table:
    """Header and rows (line in the file, cells); numbers have a point whatever the file had."""

    header: list[str]
    rows: list[tuple[int, list[str]]]


def number_of(cell: str) -> float:
    """A plain decimal number; NaN for anything else, also for what only Python calls one."""
    return float(cell) if _NUMBER.fullmatch(cell) and "," not in cell else float("nan")


def read_table(path: Path, texts: Collection[str], most_bytes: int, field: str = "") -> Table:
    """The table in `path`; only the columns in `texts` may hold something else than numbers.

    Between the columns stand commas, semicolons, tabs or blanks. Where they are no commas, numbers
    may have a decimal comma; a file with both marks is refused, for one of them could divide
    thousands. Lines that begin with # are skipped.

    Errors: those of `read_text`, csv-syntax, csv-decimal.
    """
    text = read_text(path, most_bytes, field)
    lines = text.split("\n")
    mark = separator_of(next((x for x in lines if x.strip() and not x.startswith("#")), ""))
    if mark == " ":
        text = "\n".join(line.strip() for line in lines)
    reader = csv.reader(io.StringIO(text), delimiter=mark, skipinitialspace=mark == " ")
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise InputError.of(
            "csv-syntax",
            str(path),
            field,
            str(error)[:120],
            f"values between {_NAMES[mark]}",
            "mend this line",
            reader.line_num,
        ) from error
    rows = [(line, row) for line, row in rows if any(row) and not row[0].startswith("#")]
    header = rows[0][1] if rows else []
    if mark != ",":
        rows = _with_points(path, rows, [k for k, name in enumerate(header) if name not in texts])
    return Table(header, rows[1:])


def _with_points(
    path: Path, rows: list[tuple[int, list[str]]], numeric: list[int]
) -> list[tuple[int, list[str]]]:
    """Rows with decimal points in the columns `numeric`."""
    first: dict[str, int] = {}
    for line, row in rows[1:]:
        for k in numeric:
            if k < len(row) and _NUMBER.fullmatch(row[k]):
                for sign in ",.":
                    if sign in row[k]:
                        first.setdefault(sign, line)
    if len(first) == 2:
        raise decimal_fault(path, first[","], first["."])
    for _, row in rows[1:]:
        for k in numeric:
            if k < len(row) and _NUMBER.fullmatch(row[k]):
                row[k] = row[k].replace(",", ".")
    return rows


def decimal_fault(path: Path, comma_line: int, point_line: int) -> InputError:
    """The fault of a file whose numbers have commas as well as points."""
    return InputError.of(
        "csv-decimal",
        str(path),
        value=f"a comma on line {comma_line}, a point on line {point_line}",
        legal="one decimal mark in the whole file, nothing between thousands",
        fix="write all numbers with a point",
        line=max(comma_line, point_line),
    )
