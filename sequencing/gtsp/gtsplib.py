"""Read and write `.gtsp` files: TSPLIB with a section of node sets (GTSPLIB).

    GTSP_SETS: m
    GTSP_SET_SECTION
    1  4 7 9 -1        set number, 1-based nodes, −1

All metrics and all explicit formats of TSPLIB are read. Keys and sections of our own keep what the
format lacks, written only where needed: HOME, START, END, PATH keys (1-based), NODE_COST_SECTION
(V numbers), EXIT_SECTION (V nodes) and PRECEDENCE_SECTION (pairs of sets, ended by −1).

A key, section or TYPE that is not listed here would be a constraint dropped without a word, so it
is refused by name; so is the word −1 in a matrix, which SOP files use for a precedence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.errors import DmocError, Fault, InputError
from dmoc.input_file import content_of
from sequencing.gtsp.problem import GtspProblem


def _nint(x: np.ndarray) -> np.ndarray:
    return np.floor(x + 0.5)


def _differences(xyz: np.ndarray) -> np.ndarray:
    return np.abs(xyz[:, None, :] - xyz[None, :, :])


def _straight(xyz: np.ndarray) -> np.ndarray:
    return np.sqrt((_differences(xyz) ** 2).sum(axis=2))


def _euclidean(xyz: np.ndarray) -> np.ndarray:
    return _nint(_straight(xyz))


def _manhattan(xyz: np.ndarray) -> np.ndarray:
    return _nint(_differences(xyz).sum(axis=2))


def _maximum(xyz: np.ndarray) -> np.ndarray:
    """The largest of the rounded coordinate differences."""
    return _nint(_differences(xyz)).max(axis=2)


def pseudo_euclidean(xyz: np.ndarray) -> np.ndarray:
    """ATT: sqrt(d²/10), rounded up to the next whole number that is not below it."""
    exact = np.sqrt((_differences(xyz) ** 2).sum(axis=2) / 10.0)
    rounded = _nint(exact)
    return np.where(rounded < exact, rounded + 1, rounded)


def geographical(xyz: np.ndarray) -> np.ndarray:
    """GEO: kilometres on TSPLIB's sphere; coordinates are degrees.minutes."""
    degrees = np.trunc(xyz)
    minutes = xyz - degrees
    radians = 3.141592 * (degrees + 5.0 * minutes / 3.0) / 180.0
    latitude, longitude = radians[:, 0], radians[:, 1]
    q1 = np.cos(longitude[:, None] - longitude[None, :])
    q2 = np.cos(latitude[:, None] - latitude[None, :])
    q3 = np.cos(latitude[:, None] + latitude[None, :])
    argument = 0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3)
    return np.trunc(6378.388 * np.arccos(np.clip(argument, -1.0, 1.0)) + 1.0)


def _crystallography(phi: float, chi: float, theta: float) -> Callable[[np.ndarray], np.ndarray]:
    """Time of the slowest motor of a diffractometer, in hundredths."""

    def distance(xyz: np.ndarray) -> np.ndarray:
        delta = _differences(xyz)
        turn = np.minimum(delta[:, :, 0], np.abs(delta[:, :, 0] - 360.0))
        times = np.maximum(np.maximum(turn / phi, delta[:, :, 1] / chi), delta[:, :, 2] / theta)
        return _nint(100.0 * times)

    return distance


# EDGE_WEIGHT_TYPE: (number of coordinates, distance)
METRICS: dict[str, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
    "EUC_2D": (2, _euclidean),
    "EUC_3D": (3, _euclidean),
    "MAX_2D": (2, _maximum),
    "MAX_3D": (3, _maximum),
    "MAN_2D": (2, _manhattan),
    "MAN_3D": (3, _manhattan),
    "CEIL_2D": (2, lambda xyz: np.ceil(_straight(xyz))),
    "GEO": (2, geographical),
    "ATT": (2, pseudo_euclidean),
    "XRAY1": (3, _crystallography(1.0, 1.0, 1.0)),
    "XRAY2": (3, _crystallography(1.25, 1.5, 1.15)),
}


FORMATS = (
    "FULL_MATRIX",
    "UPPER_ROW",
    "LOWER_ROW",
    "UPPER_DIAG_ROW",
    "LOWER_DIAG_ROW",
    "UPPER_COL",
    "LOWER_COL",
    "UPPER_DIAG_COL",
    "LOWER_DIAG_COL",
)
LARGEST_DIMENSION = 20_000  # a cost matrix of 3.2 GB
TYPES = ("TSP", "ATSP", "GTSP", "AGTSP", "PCGTSP")
#: What is read, and what changes nothing.
KEYS = (
    "NAME",
    "TYPE",
    "COMMENT",
    "DIMENSION",
    "GTSP_SETS",
    "EDGE_WEIGHT_TYPE",
    "EDGE_WEIGHT_FORMAT",
    "NODE_COORD_TYPE",
    "DISPLAY_DATA_TYPE",
    "HOME",
    "START",
    "END",
    "PATH",
)
SECTIONS = (
    "NODE_COORD_SECTION",
    "EDGE_WEIGHT_SECTION",
    "DISPLAY_DATA_SECTION",
    "GTSP_SET_SECTION",
    "NODE_COST_SECTION",
    "EXIT_SECTION",
    "PRECEDENCE_SECTION",
)


class _File:
    """Header values and section tokens of one file, with line numbers for faults."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header: dict[str, tuple[str, int]] = {}
        self.sections: dict[str, list[tuple[str, int]]] = {}
        try:
            text = content_of(path).decode("utf-8")
        except OSError as error:
            raise InputError.of(
                "gtsp-file", file=str(path), value=str(error.strerror), legal="a file"
            ) from error
        except UnicodeDecodeError as error:
            raise InputError.of(
                "gtsp-file", file=str(path), value="not text", legal="a .gtsp text file"
            ) from error
        current: list[tuple[str, int]] | None = None
        for number, line in enumerate(text.splitlines(), start=1):
            words = line.split()
            if not words:
                continue
            if words[0].upper() == "EOF":
                break
            key = words[0].split(":", 1)[0].upper()
            if key[:1].isalpha() and key not in ("INF", "NAN"):
                self._require_known(key, number)
                name, colon, value = line.partition(":")
                value = value if colon and name.split() == [words[0].split(":")[0]] else ""
                value = value.strip() or " ".join(words[1:]).lstrip(": ")
                current = None
                if key in SECTIONS:
                    current = self.sections.setdefault(key, [])
                    current += [(word, number) for word in value.split()]
                else:
                    self.header[key] = (value, number)
            elif current is not None:
                current += [(word, number) for word in words]
            else:
                raise self.error("gtsp-line", "", line.strip()[:40], "KEY: value", number)

    def _require_known(self, key: str, line: int) -> None:
        if key not in KEYS and key not in SECTIONS:
            legal = (
                "the keys of TSPLIB and, as constraints, HOME, START, END, PATH, PRECEDENCE_SECTION"
            )
            fix = "say it with one of these, or take it out; remarks belong behind COMMENT:"
            raise self.error("gtsp-not-understood", key, key, legal, line, fix)
        if (key in self.header and key != "COMMENT") or key in self.sections:
            raise self.error("gtsp-twice", key, "a second time", "once", line)

    def error(
        self,
        code: str,
        field: str,
        value: str,
        legal: str,
        line: int | None = None,
        fix: str = "",
    ) -> InputError:
        return InputError.of(code, str(self.path), field, value, legal, fix, line)

    def text(self, key: str, default: str | None = None) -> str:
        if key in self.header:
            return self.header[key][0]
        if default is None:
            raise self.error("gtsp-key-missing", key, "nothing", f"a line '{key}: …'")
        return default

    def whole(self, key: str) -> int:
        text = self.text(key)
        line = self.header[key][1]
        try:
            value = int(text)
        except ValueError as error:
            raise self.error("gtsp-not-integer", key, text, "a whole number", line) from error
        if not 1 <= value <= LARGEST_DIMENSION:
            raise self.error("gtsp-range", key, text, f"1 … {LARGEST_DIMENSION}", line)
        return value

    def numbers(self, section: str, count: int | None = None) -> np.ndarray:
        if section not in self.sections:
            raise self.error("gtsp-section-missing", section, "nothing", "this section")
        tokens = self.sections[section]
        try:
            values = np.array([word for word, _ in tokens], dtype=np.float64)
        except ValueError:
            word, at = next((w, n) for w, n in tokens if not _is_number(w))
            raise self.error("gtsp-not-a-number", section, word, "a number", at) from None
        if count is not None and values.size != count:
            line = tokens[-1][1] if tokens else None
            legal = f"{count} numbers"
            raise self.error("gtsp-count", section, f"{values.size} numbers", legal, line)
        return values


def read_gtsplib(path: str | Path) -> GtspProblem:
    """The problem of a `.gtsp` file. Raises `InputError` naming file, line, field and remedy."""
    file = _File(Path(path))
    kind = file.text("TYPE", "GTSP").upper()
    if kind not in TYPES:
        raise file.error("gtsp-type", "TYPE", kind, ", ".join(TYPES), file.header["TYPE"][1])
    size = file.whole("DIMENSION")
    cost = _cost(file, size)
    clusters = _sets(file, size)
    fields: dict[str, Any] = {"name": file.text("NAME", Path(path).stem)}
    for key in ("HOME", "START", "END"):
        if key in file.header:
            fields[key.lower()] = file.whole(key) - 1
    path_text = file.text("PATH", "no").lower()
    if path_text not in ("yes", "true", "1", "no", "false", "0"):
        raise file.error("gtsp-path", "PATH", path_text, "yes or no", file.header["PATH"][1])
    fields["path"] = path_text in ("yes", "true", "1")
    if "NODE_COST_SECTION" in file.sections:
        fields["node_cost"] = file.numbers("NODE_COST_SECTION", size)
    if "EXIT_SECTION" in file.sections:
        fields["exit_of"] = file.numbers("EXIT_SECTION", size) - 1
    if "PRECEDENCE_SECTION" in file.sections:
        values = file.numbers("PRECEDENCE_SECTION")
        values = values[:-1] if values.size and values[-1] == -1 else values
        if values.size % 2:
            raise file.error("gtsp-count", "PRECEDENCE_SECTION", "an odd count", "pairs, then -1")
        if not np.array_equal(values, np.floor(values)):
            raise file.error("gtsp-not-integer", "PRECEDENCE_SECTION", "fractions", "set numbers")
        fields["precedence"] = [(int(a) - 1, int(b) - 1) for a, b in values.reshape(-1, 2)]
    try:
        return GtspProblem.from_clusters(cost, clusters, **fields)
    except DmocError as error:
        faults = [
            Fault(f.code, str(path), f.field, f.value, f.legal, f.fix, f.line) for f in error.faults
        ]
        raise InputError(faults) from error


def write_gtsplib(problem: GtspProblem, path: str | Path) -> None:
    """Write a problem with an explicit full matrix; reading it back gives the same problem."""
    size = problem.num_nodes
    symmetric = np.array_equal(problem.cost, problem.cost.T)
    lines = [
        f"NAME: {problem.name or Path(path).stem}",
        f"TYPE: {'GTSP' if symmetric else 'AGTSP'}",
        f"DIMENSION: {size}",
        f"GTSP_SETS: {problem.num_clusters}",
        "EDGE_WEIGHT_TYPE: EXPLICIT",
        "EDGE_WEIGHT_FORMAT: FULL_MATRIX",
    ]
    for key in ("home", "start", "end"):
        node = getattr(problem, key)
        if node is not None:
            lines.append(f"{key.upper()}: {node + 1}")
    if problem.path:
        lines.append("PATH: yes")
    lines.append("EDGE_WEIGHT_SECTION")
    lines += [" ".join(map(_number, row)) for row in problem.cost]
    if problem.node_cost.any():
        lines += ["NODE_COST_SECTION", " ".join(map(_number, problem.node_cost))]
    if not np.array_equal(problem.exit_of, np.arange(size)):
        lines += ["EXIT_SECTION", " ".join(str(v + 1) for v in problem.exit_of)]
    if problem.precedence:
        pairs = [f"{a + 1} {b + 1}" for a, b in problem.precedence]
        lines += ["PRECEDENCE_SECTION", *pairs, "-1"]
    lines.append("GTSP_SET_SECTION")
    for g, nodes in enumerate(problem.clusters, start=1):
        lines.append(" ".join(map(str, [g, *(v + 1 for v in nodes), -1])))
    Path(path).write_text("\n".join([*lines, "EOF", ""]), encoding="utf-8")


def _cost(file: _File, size: int) -> np.ndarray:
    kind = file.text("EDGE_WEIGHT_TYPE").upper()
    if kind == "EXPLICIT":
        return _explicit(file, size)
    if kind not in METRICS:
        legal = ", ".join(["EXPLICIT", *METRICS])
        raise file.error("gtsp-metric", "EDGE_WEIGHT_TYPE", kind, legal)
    if "EDGE_WEIGHT_SECTION" in file.sections:
        text = f"{kind} and EDGE_WEIGHT_SECTION"
        raise file.error("gtsp-metric", "EDGE_WEIGHT_TYPE", text, "a metric or EXPLICIT weights")
    dimensions, metric = METRICS[kind]
    table = file.numbers("NODE_COORD_SECTION", size * (dimensions + 1))
    table = table.reshape(size, dimensions + 1)
    if not np.array_equal(np.sort(table[:, 0]), np.arange(1, size + 1)):
        raise file.error("gtsp-node-range", "NODE_COORD_SECTION", "node numbers", f"1 … {size}")
    if not np.isfinite(table).all():
        raise file.error("gtsp-not-a-number", "NODE_COORD_SECTION", "inf or nan", "finite")
    return metric(table[np.argsort(table[:, 0]), 1:])


def _explicit(file: _File, size: int) -> np.ndarray:
    form = file.text("EDGE_WEIGHT_FORMAT").upper()
    if form not in FORMATS:
        raise file.error("gtsp-format", "EDGE_WEIGHT_FORMAT", form, ", ".join(FORMATS))
    diagonal = "DIAG" in form
    if form == "FULL_MATRIX":
        count = size * size
    else:
        count = size * (size + 1) // 2 if diagonal else size * (size - 1) // 2
    values = file.numbers("EDGE_WEIGHT_SECTION", count)
    if form == "FULL_MATRIX":
        rows, columns = (index.ravel() for index in np.indices((size, size)))
    else:
        # a matrix given by columns of one triangle is, read by rows, the other triangle
        upper = form.startswith("UPPER") != form.endswith("COL")
        offset = 0 if diagonal else 1
        rows, columns = np.triu_indices(size, offset) if upper else np.tril_indices(size, -offset)
    for k in np.flatnonzero((values == -1) & (rows != columns)):
        word, line = file.sections["EDGE_WEIGHT_SECTION"][k]
        if word == "-1":
            text = f"-1 in row {rows[k] + 1}, column {columns[k] + 1}"
            legal = "costs; in SOP and PCGTSP files -1 says that the column comes before the row"
            fix = "write the order as PRECEDENCE_SECTION; a cost of minus one is written -1.0"
            raise file.error("gtsp-minus-one", "EDGE_WEIGHT_SECTION", text, legal, line, fix)
    cost = np.zeros((size, size))
    cost[rows, columns] = values
    if form != "FULL_MATRIX":
        cost[columns, rows] = values
    return cost


def _sets(file: _File, size: int) -> list[list[int]]:
    wanted = file.whole("GTSP_SETS")
    values = file.numbers("GTSP_SET_SECTION")
    tokens = file.sections["GTSP_SET_SECTION"]
    sets: dict[int, list[int]] = {}
    row: list[int] = []
    for value, (word, line) in zip(values, tokens):
        if value != math.floor(value):
            raise file.error("gtsp-not-integer", "GTSP_SET_SECTION", word, "whole numbers", line)
        if value != -1:
            row.append(int(value))
            continue
        if not row or not 1 <= row[0] <= wanted:
            text = str(row[0]) if row else "nothing"
            raise file.error("gtsp-set", "GTSP_SET_SECTION", text, f"a set 1 … {wanted}", line)
        if row[0] in sets:
            raise file.error("gtsp-set", "GTSP_SET_SECTION", f"set {row[0]} twice", "once", line)
        outside = [v for v in row[1:] if not 1 <= v <= size]
        if outside:
            text = f"node {outside[0]} in set {row[0]}"
            raise file.error("gtsp-node-range", "GTSP_SET_SECTION", text, f"1 … {size}", line)
        sets[row[0]] = [v - 1 for v in row[1:]]
        row = []
    if row:
        text = f"set {row[0]} without its end"
        raise file.error("gtsp-set", "GTSP_SET_SECTION", text, "-1 after the nodes of a set")
    if len(sets) != wanted:
        text = f"{len(sets)} sets"
        raise file.error("gtsp-set", "GTSP_SET_SECTION", text, f"{wanted} sets, as GTSP_SETS")
    return [sets[k] for k in range(1, wanted + 1)]


def _number(value: float) -> str:
    if value == -1:
        return "-1.0"  # the bare word is refused in a matrix
    return str(int(value)) if math.isfinite(value) and value == int(value) else repr(float(value))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
