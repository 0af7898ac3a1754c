"""Rows of changed assumptions, kept in a file of the study: a resumed study reads them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError
from planning.station import Station
from sequencing.cycle_types import CycleCost
from sequencing.edge_worker import context_fingerprint
from sequencing.run_archive import write_atomic
from sequencing.store import EdgeStore
from sequencing.studies.stud_welding_types import ChangeRow, Use

# Raised whenever a change of the code changes what a row says.
ROW_VERSION = 2


def row_key(
    name: str, station: Station, table: Array, cycles: Sequence[tuple[int, ...]], limit: int,
    seed: int,
) -> str:  # fmt: skip
    """sha256 of all that decides a row: the changed station, estimates, cycles, budget, seed."""
    digest = hashlib.sha256(
        f"row|{ROW_VERSION}|{name}|{cycles!r}|{limit}|{seed}|{station.fingerprint}".encode()
    )
    digest.update(context_fingerprint(station, "halfspaces").encode())
    digest.update(np.ascontiguousarray(table).tobytes())
    return digest.hexdigest()


def rows_file(store: EdgeStore) -> Path:
    """The study's file of rows: it lies beside the store of solved edges."""
    return store.path.with_name("change_rows.json")


def keep_row(path: Path, key: str, row: ChangeRow) -> None:
    """Add a row to the file."""
    write_atomic(path, json.dumps({**_rows(path), key: asdict(row)}, indent=1))


def kept_row(path: Path, key: str) -> ChangeRow | None:
    """The row under `key`, if there is one."""
    data = _rows(path).get(key)
    if data is None:
        return None
    for name in ("best", "nominal", "old"):
        data[name] = None if data[name] is None else CycleCost(**data[name])
    for name in ("best_use", "nominal_use"):
        data[name] = None if data[name] is None else Use(**data[name])
    return ChangeRow(**{**data, "order": tuple(data["order"])})


def _rows(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}
    except ValueError as error:
        raise InputError(
            Fault("rows-damaged", file=str(path), value=str(error), legal="the rows of a study",
                  fix="remove the file; its rows are priced again")
        ) from error  # fmt: skip
