"""Rows of changed assumptions, kept in the store of solved edges: a resumed study reads them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from dmoc.arrays import Array
from planning.station import Station
from sequencing.cycle_types import CycleCost
from sequencing.edge_worker import context_fingerprint
from sequencing.store import EdgeStore
from sequencing.studies.stud_welding_types import ChangeRow, Use

__all__ = ["keep_row", "kept_row", "row_key"]

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


def keep_row(store: EdgeStore, key: str, row: ChangeRow) -> None:
    """Write a row."""
    store.put(key, json.dumps(asdict(row)).encode())


def kept_row(store: EdgeStore, key: str) -> ChangeRow | None:
    """The row under `key`, if there is one."""
    payload = store.get(key)
    if payload is None:
        return None
    data: dict[str, Any] = json.loads(payload)
    for name in ("best", "nominal", "old"):
        data[name] = None if data[name] is None else CycleCost(**data[name])
    for name in ("best_use", "nominal_use"):
        data[name] = None if data[name] is None else Use(**data[name])
    return ChangeRow(**{**data, "order": tuple(data["order"])})
