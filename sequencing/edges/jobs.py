"""Jobs of edges: what determines one as a key, and solving those that the store lacks."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import Motion
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.station.station import Station
from sequencing.edges.nodes import HOME, StationNodes
from sequencing.edges.store import EdgeStore, encode_motion
from sequencing.edges.worker import (
    EdgeJob,
    EdgeResult,
    Quality,
    context_fingerprint,
    solve_edge,
    write_context,
)


@dataclass(frozen=True)
class Between:
    """A final motion asked for between joint vectors (n,) that are no nodes.

    `origin` and `target` are stud ids, None for home; `like` is the motion it starts from.
    """

    origin: str | None
    target: str | None
    start_rad: Array
    goal_rad: Array
    like: Motion


class EdgeKeys:
    """sha256 of all that determines an edge: robot, shapes, cost, the two ends, seed, quality.

    Studs elsewhere are no part of it: editing one leaves the edges of the others valid.
    """

    def __init__(
        self,
        station: Station,
        nodes: StationNodes,
        method: Method,
        seed: int,
        solver: str = DEFAULT_SOLVER,
    ) -> None:
        self.station, self.nodes, self.seed = station, nodes, seed
        self.method, self.solver = method, solver
        self.fingerprint = context_fingerprint(station, method, solver)

    def key(self, low: int, high: int, quality: Quality) -> str:
        """Of the edge between two nodes."""
        digest = hashlib.sha256(f"{self.fingerprint}|{quality}|{self.seed}|".encode())
        for node in (low, high):
            digest.update(self._pose(node))
            digest.update(self._line(self.stud(node)))
        return digest.hexdigest()

    def key_between(self, item: Between, screened: bytes) -> str:
        """Of a motion between poses that are no nodes."""
        digest = hashlib.sha256(f"{self.fingerprint}|between|{self.seed}|".encode())
        for stud, q in ((item.origin, item.start_rad), (item.target, item.goal_rad)):
            digest.update(np.ascontiguousarray(q, dtype=float).tobytes())
            digest.update(self._line(stud))
        digest.update(hashlib.sha256(screened).digest())
        return digest.hexdigest()

    def draws(self, pairs: np.ndarray) -> Array:
        """A random number (P,) for every pair, from the seed and its two ends alone."""
        count = self.nodes.num_nodes
        ends = [hashlib.sha256(self._pose(node)).digest() for node in range(count)]
        salt = str(self.seed).encode()
        draws = [
            int.from_bytes(hashlib.sha256(salt + ends[i] + ends[j]).digest()[:6], "big")
            for i, j in pairs
        ]
        return np.array(draws, dtype=float)

    def stud(self, node: int) -> str | None:
        """Stud id of a node, None for home."""
        name = self.nodes.stud[node]
        return None if name == HOME and node == self.nodes.home else name

    def _pose(self, node: int) -> bytes:
        return self.nodes.q_rad[node].tobytes() + self.nodes.line_end_rad[node].tobytes()

    def _line(self, stud_id: str | None) -> bytes:
        """The departure line of a stud, in its numbers."""
        if stud_id is None:
            return b"home"
        stud = next(s for s in self.station.studs if s.id == stud_id)
        return repr(
            (
                tuple(stud.position_m),
                tuple(stud.normal),
                tuple(stud.depart_direction),
                stud.depart_m,
                stud.on,
                self.station.stray_m,
            )
        ).encode()


@dataclass
class EdgeCounts:
    """What an oracle has done; `cpu_s` includes the workers."""

    solved: int = 0
    reused: int = 0
    failed: int = 0
    cpu_s: float = 0.0
    reused_edges: set[tuple[int, int]] = field(default_factory=set)
    solved_edges: set[tuple[int, int]] = field(default_factory=set)


class EdgeJobs:
    """Makes the jobs of a station and solves them in `executor`, or here without one.

    Every result is in the store before it is handed on. `close` removes the workers' context.
    """

    def __init__(self, keys: EdgeKeys, store: EdgeStore, executor: Executor | None) -> None:
        self.keys, self.store, self.executor = keys, store, executor
        self.counts = EdgeCounts()
        self._folder = tempfile.TemporaryDirectory(prefix="dmoc-")
        self._context = write_context(keys.station, Path(self._folder.name))

    def job(self, low: int, high: int, quality: Quality) -> EdgeJob:
        """Of the edge between two nodes; a final one starts from the screened motion."""
        keys, q = self.keys, self.keys.nodes.q_rad
        key = keys.key(low, high, quality)
        screened = self.store.get(keys.key(low, high, "screen")) if quality == "final" else None
        ends = (keys.stud(low), keys.stud(high))
        return self._job(key, ends, (q[low], q[high]), quality, screened)

    def job_between(self, item: Between) -> EdgeJob:
        """Of a final motion between poses that are no nodes."""
        screened = encode_motion(item.like)
        key = self.keys.key_between(item, screened)
        ends = (item.origin, item.target)
        return self._job(key, ends, (item.start_rad, item.goal_rad), "final", screened)

    def solve(self, jobs: list[EdgeJob]) -> Iterator[EdgeResult]:
        """Results as they finish, stored and counted."""
        for result in self._results(jobs):
            self.store.put(result.key, result.payload)
            self.counts.solved += 1
            self.counts.cpu_s += result.cpu_s
            yield result

    def close(self) -> None:
        """Remove the workers' context file."""
        self._folder.cleanup()

    def _job(
        self,
        key: str,
        ends: tuple[str | None, str | None],
        poses: tuple[Array, Array],
        quality: Quality,
        screened: bytes | None,
    ) -> EdgeJob:
        digest = hashlib.sha256(f"{self.keys.seed}|{key}".encode())
        return EdgeJob(
            context=self._context,
            key=key,
            origin=ends[0],
            target=ends[1],
            start_rad=tuple(poses[0]),
            goal_rad=tuple(poses[1]),
            quality=quality,
            method=self.keys.method,
            solver=self.keys.solver,
            screened=screened,
            seed=int(digest.hexdigest()[:8], 16),
        )

    def _results(self, jobs: list[EdgeJob]) -> Iterator[EdgeResult]:
        if self.executor is None:
            yield from map(solve_edge, jobs)
            return
        futures: list[Future[EdgeResult]] = [self.executor.submit(solve_edge, job) for job in jobs]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            for future in futures:
                future.cancel()
