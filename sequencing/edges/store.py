"""The store of finished edges: sqlite, written as they finish, keyed by what determines them.

A second run reads instead of solving; an interrupted run resumes. Values are plain numpy archives
and JSON, never pickles, so a store from elsewhere cannot run code.
"""

from __future__ import annotations

import io
import json
import sqlite3
from pathlib import Path
from types import TracebackType

import numpy as np

from dmoc.errors import Fault, InputError
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot

_SCALARS = (
    "cost",
    "smoothing_cost",
    "iterations",
    "max_defect",
    "replay_error_rad",
    "min_clearance_m",
    "proven_clearance_m",
    "certified",
    "note",
    "solver",
    "planner",
    "method",
)
_ARRAYS = ("t_s", "q_rad", "velocity_rad_s", "torque_nm")


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

    Raises ValueError, KeyError or OSError for bytes that `encode_motion` did not write.
    """
    with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
        meta = json.loads(str(archive["meta"]))
        trajectory = None
        if "t_s" in archive:
            trajectory = JointTrajectory(**{name: archive[name] for name in _ARRAYS}, robot=robot)
    status, source = Status(meta.pop("status")), meta.pop("source")
    return Motion(status=status, source=source, trajectory=trajectory, **meta)


class EdgeStore:
    """A table key → bytes in one sqlite file (WAL), safe for several processes.

    Every `put` is committed before it returns: kill −9 loses at most the edge in flight.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._db = sqlite3.connect(self.path, timeout=30.0)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=NORMAL")
            self._db.execute(
                "CREATE TABLE IF NOT EXISTS edges (key TEXT PRIMARY KEY, payload BLOB NOT NULL)"
            )
            self._db.commit()
        except sqlite3.DatabaseError as error:
            raise InputError(
                Fault(
                    "store-damaged",
                    file=str(self.path),
                    value=str(error),
                    legal="a store of solved edges (sqlite)",
                    fix="remove the file; its edges are solved again",
                )
            ) from error

    def get(self, key: str) -> bytes | None:
        """The bytes under `key`, or None."""
        row = self._db.execute("SELECT payload FROM edges WHERE key = ?", (key,)).fetchone()
        return None if row is None else bytes(row[0])

    def put(self, key: str, payload: bytes) -> None:
        """Write and commit."""
        with self._db:
            self._db.execute("INSERT OR REPLACE INTO edges VALUES (?, ?)", (key, payload))

    def __len__(self) -> int:
        return int(self._db.execute("SELECT COUNT(*) FROM edges").fetchone()[0])

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
