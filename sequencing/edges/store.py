"""The store of finished edges: sqlite, written as they finish, keyed by what determines them.

A second run reads instead of solving; an interrupted run resumes. Values are plain numpy archives
and JSON, never pickles, so a store from elsewhere cannot run code; each carries its sha256, and
one that is damaged or says what no motion can be is absent: its edge is solved anew.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from dmoc.arrays import arrays_of
from dmoc.errors import DmocError, InputError
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot

SCHEMA = 1
_COLUMNS = [("key", "TEXT"), ("payload", "BLOB")]
_ARRAYS = ("t_s", "q_rad", "velocity_rad_s", "torque_nm")
# What a scalar of a motion may be; numbers that are given must be finite and not negative.
_NUMBER, _MAYBE = (int, float), (int, float, type(None))
_SCALARS: dict[str, tuple[type, ...]] = {
    "cost": _NUMBER,
    "executed_cost": _MAYBE,
    "smoothing_cost": _NUMBER,
    "iterations": (int,),
    "max_defect": _MAYBE,
    "replay_error_rad": _MAYBE,
    "min_clearance_m": _MAYBE,
    "proven_clearance_m": _MAYBE,
    "certified": (bool, type(None)),
    "note": (str,),
    "solver": (str,),
    "planner": (str,),
    "method": (str,),
}


def encode_motion(motion: Motion) -> bytes:
    """Bytes of a motion (numpy archive; the robot is not part of it)."""
    meta = {name: getattr(motion, name) for name in _SCALARS}
    meta |= {"status": motion.status.value, "source": motion.source}
    arrays = {}
    if motion.trajectory is not None:
        arrays = {name: getattr(motion.trajectory, name) for name in _ARRAYS}
    buffer = io.BytesIO()
    np.savez(buffer, meta=np.array(json.dumps(meta, sort_keys=True)), **arrays)
    return buffer.getvalue()


def decode_motion(payload: bytes, robot: Robot) -> Motion:
    """The motion of `encode_motion`, with `robot` on its trajectory.

    Raises ValueError for bytes that `encode_motion` did not write, or not of a motion of `robot`.
    """
    arrays = arrays_of(payload)
    try:
        meta = json.loads(str(arrays.pop("meta")[()]))
        status, source = Status(meta.pop("status")), meta.pop("source")
        trajectory = _trajectory_of(arrays, robot) if arrays else None
        _check_scalars(meta, source, trajectory)
        return Motion(status=status, source=source, trajectory=trajectory, **meta)
    except (AttributeError, KeyError, TypeError, RecursionError, DmocError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _trajectory_of(arrays: dict[str, Any], robot: Robot) -> JointTrajectory:
    times, joints = len(arrays["t_s"]), robot.num_joints
    shapes = [(times,), (times, joints), (times, joints), (times - 1, joints)]
    for name, shape in zip(_ARRAYS, shapes):
        array = arrays[name]
        if array.dtype != np.float64 or array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"{name}: {array.dtype} {array.shape}, or not finite")
    if times < 2 or np.any(np.diff(arrays["t_s"]) <= 0.0):
        raise ValueError("t_s: times that do not rise")
    return JointTrajectory(**{name: arrays[name] for name in _ARRAYS}, robot=robot)


def _check_scalars(
    meta: dict[str, Any], source: object, trajectory: JointTrajectory | None
) -> None:
    if meta.keys() != _SCALARS.keys() or source not in ("refined", "fallback"):
        raise ValueError("other fields than a motion has")
    for name, kinds in _SCALARS.items():
        value = meta[name]
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise ValueError(f"{name}: {value!r}")
        if isinstance(value, float) and name != "min_clearance_m":  # negative: a depth
            endless = name == "cost" and trajectory is None  # no motion, no cost
            if not (value >= 0.0 and (endless or math.isfinite(value))):
                raise ValueError(f"{name}: {value!r}")


class EdgeStore:
    """A table key → bytes in one sqlite file (WAL), safe for several processes.

    Every `put` is committed before it returns: kill −9 loses at most the edge in flight.
    Errors: `InputError` store-damaged, store-version, store-write (disk full, read-only folder);
    what was put before stays.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        with self._coded():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, timeout=30.0)
            version = int(self._db.execute("PRAGMA user_version").fetchone()[0])
            if version > SCHEMA:
                raise self._fault("store-version", f"schema {version}")
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=NORMAL")
            self._db.execute(
                "CREATE TABLE IF NOT EXISTS edges (key TEXT PRIMARY KEY, payload BLOB NOT NULL)"
            )
            columns = [row[1:3] for row in self._db.execute("PRAGMA table_info(edges)")]
            if columns != _COLUMNS:
                raise self._fault("store-damaged", f"columns {columns}")
            if version < SCHEMA:
                self._db.execute(f"PRAGMA user_version={SCHEMA}")
            self._db.commit()

    def get(self, key: str) -> bytes | None:
        """The bytes under `key`, or None where there are none or not those that were put."""
        with self._coded():
            row = self._db.execute("SELECT payload FROM edges WHERE key = ?", (key,)).fetchone()
        if row is None or not isinstance(row[0], bytes):
            return None
        seal, payload = row[0][:32], row[0][32:]
        return payload if seal == _seal(key, payload) else None

    def motion(self, key: str, robot: Robot) -> Motion | None:
        """The motion of `robot` under `key`, or None where there is none that can be one."""
        payload = self.get(key)
        try:
            return None if payload is None else decode_motion(payload, robot)
        except ValueError:
            return None

    def put(self, key: str, payload: bytes) -> None:
        """Write and commit."""
        with self._coded(), self._db:
            sealed = _seal(key, payload) + payload
            self._db.execute("INSERT OR REPLACE INTO edges VALUES (?, ?)", (key, sealed))

    def __len__(self) -> int:
        with self._coded():
            return int(self._db.execute("SELECT COUNT(*) FROM edges").fetchone()[0])

    def damaged(self, value: str) -> InputError:
        """The error store-damaged, to be raised."""
        return self._fault("store-damaged", value)

    def close(self) -> None:
        """Close the file; the store cannot be used afterwards."""
        self._db.close()

    def __enter__(self) -> EdgeStore:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @contextmanager
    def _coded(self) -> Iterator[None]:
        """What sqlite and the file system refuse, as one coded error."""
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            code = getattr(error, "sqlite_errorcode", None)
            writing = isinstance(error, OSError) or (code is not None and code & 0xFF in _NO_ROOM)
            kind = "store-write" if writing else "store-damaged"
            raise self._fault(kind, str(error)) from error

    def _fault(self, code: str, value: str) -> InputError:
        legal, fix = _REMEDIES[code]
        return InputError.of(code, file=str(self.path), value=value, legal=legal, fix=fix)


_NO_ROOM = (
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_BUSY,
)
_REMEDIES = {
    "store-damaged": (
        "a store of solved edges (sqlite)",
        "remove the file; its edges are solved again",
    ),
    "store-version": (
        f"a store of this version (schema {SCHEMA}) or an older one",
        "use the newer version that wrote it, or another folder",
    ),
    "store-write": (
        "a folder that can be written, with room on the disk",
        "make room or choose another --out; edges that were finished before are kept",
    ),
}


def _seal(key: str, payload: bytes) -> bytes:
    return hashlib.sha256(key.encode() + b"|" + payload).digest()
