"""Jobs of edges: what determines one as a key, and solving those that the store lacks."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterator, Sized
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.station.station import Station
from sequencing.edges.nodes import HOME, StationNodes
from sequencing.edges.store import EdgeStore, encode_motion
from sequencing.edges.worker import (
    EdgeJob,
    EdgeResult,
    Quality,
    bundle_of,
    context_fingerprint,
    solve_edge,
)

# Edges that are handed out at once: a worker more than it can do, and all together.
PER_WORKER, MOST_FLYING = 4, 64


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
        return self._key(quality, self.ends(low, high))

    def key_between(self, item: Between, screened: bytes) -> str:
        """Of a motion between poses that are no nodes."""
        return self._key("between", self.ends_between(item) + hashlib.sha256(screened).digest())

    def ends(self, low: int, high: int) -> bytes:
        """Poses and departure lines of the edge between two nodes."""
        return b"".join(self._pose(v) + self._line(self.stud(v)) for v in (low, high))

    def ends_between(self, item: Between) -> bytes:
        """Poses and departure lines of a motion between poses that are no nodes."""
        ends = ((item.origin, item.start_rad), (item.target, item.goal_rad))
        return b"".join(np.array(q, dtype=float).tobytes() + self._line(stud) for stud, q in ends)

    def _key(self, kind: str, ends: bytes) -> str:
        head = f"{self.fingerprint}|{kind}|{self.seed}|".encode()
        return hashlib.sha256(head + ends).hexdigest()

    def draws(self, pairs: np.ndarray) -> Array:
        """A random number (P,) for every pair, from the seed and its two ends alone."""
        count = self.nodes.num_nodes
        ends = [hashlib.sha256(self._pose(node)).digest() for node in range(count)]
        salt = str(self.seed).encode()
        ahead = [hashlib.sha256(salt + end) for end in ends]
        draws = np.empty(len(pairs))
        for row, (i, j) in enumerate(pairs.tolist()):
            digest = ahead[i].copy()
            digest.update(ends[j])
            draws[row] = int.from_bytes(digest.digest()[:6], "big")
        return draws

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

    Every result is in the store before it is handed on. A worker that is killed costs the time of
    the edges in flight: they are solved again, one at a time, in fresh workers, and one that kills
    its worker once more is `lost`: it has no motion in this run, and is not stored.
    """

    def __init__(self, keys: EdgeKeys, store: EdgeStore, executor: Executor | None) -> None:
        self.keys, self.store, self.executor = keys, store, executor
        self.counts = EdgeCounts()
        self.lost: dict[str, Motion] = {}
        self._context, self._bundle = bundle_of(keys.station)

    def job(self, low: int, high: int, quality: Quality) -> EdgeJob:
        """Of the edge between two nodes; a final one starts from the screened motion."""
        keys, q = self.keys, self.keys.nodes.q_rad
        screened = self.store.get(keys.key(low, high, "screen")) if quality == "final" else None
        return EdgeJob(
            context=self._context,
            key=keys.key(low, high, quality),
            origin=keys.stud(low),
            target=keys.stud(high),
            start_rad=tuple(q[low]),
            goal_rad=tuple(q[high]),
            quality=quality,
            method=self.keys.method,
            solver=self.keys.solver,
            screened=screened,
            seed=self._seed(keys.ends(low, high)),
        )

    def job_between(self, item: Between) -> EdgeJob:
        """Of a final motion between poses that are no nodes."""
        screened = encode_motion(item.like)
        return EdgeJob(
            context=self._context,
            key=self.keys.key_between(item, screened),
            origin=item.origin,
            target=item.target,
            start_rad=tuple(item.start_rad),
            goal_rad=tuple(item.goal_rad),
            quality="final",
            method=self.keys.method,
            solver=self.keys.solver,
            screened=screened,
            seed=self._seed(self.keys.ends_between(item)),
        )

    def solve(self, jobs: list[EdgeJob]) -> Iterator[str]:
        """Keys as their edges are solved, stored and counted."""
        for result in self._results(jobs):
            if result.payload is not None:
                self.store.put(result.key, result.payload)
            self.counts.solved += 1
            self.counts.cpu_s += result.cpu_s
            yield result.key

    def motion(self, key: str) -> Motion | None:
        """What is known of an edge: from the store, or that it was lost."""
        return self.lost.get(key) or self.store.motion(key, self.keys.station.robot)

    def _seed(self, ends: bytes) -> int:
        """From the run's seed and the ends alone: another version plans by the same numbers."""
        return int(hashlib.sha256(f"{self.keys.seed}|".encode() + ends).hexdigest()[:8], 16)

    def _results(self, jobs: list[EdgeJob]) -> Iterator[EdgeResult]:
        if self.executor is None:
            yield from (solve_edge(replace(job, bundle=self._bundle)) for job in jobs)
            return
        waiting, suspects = deque(jobs), deque[EdgeJob]()
        flying: dict[Future[EdgeResult], EdgeJob] = {}
        alone = False  # one suspect is being tried by itself
        try:
            while waiting or suspects or flying:
                try:
                    while (suspects and not flying) or (waiting and self._room(flying, alone)):
                        alone = bool(suspects)
                        job = (suspects or waiting)[0]
                        flying[self.executor.submit(solve_edge, job)] = job
                        (suspects or waiting).popleft()
                    for future in wait(flying, return_when=FIRST_COMPLETED).done:
                        result, job = future.result(), flying.pop(future)
                        if result.payload is None:  # that worker has not seen the station
                            waiting.appendleft(replace(job, bundle=self._bundle))
                        else:
                            yield result
                    alone = alone and bool(flying)
                except BrokenExecutor as error:
                    broken = list(flying.values())
                    flying.clear()
                    self._renew(broken, error)
                    if alone and broken:
                        yield self._give_up(broken[0])
                    else:
                        suspects += [replace(job, bundle=self._bundle) for job in broken]
                    alone = False
        finally:
            for future in flying:
                future.cancel()

    def _room(self, flying: Sized, alone: bool) -> bool:
        """Few edges are handed out at once, so that few are suspect when a worker dies."""
        workers = getattr(self.executor, "_max_workers", None) or MOST_FLYING // PER_WORKER
        return not alone and len(flying) < min(MOST_FLYING, PER_WORKER * workers)

    def _renew(self, broken: list[EdgeJob], error: BrokenExecutor) -> None:
        renew = getattr(self.executor, "renew", None)
        if renew is None:
            ends = ", ".join(f"{job.origin or HOME} → {job.target or HOME}" for job in broken)
            raise ProblemError.of(
                "workers-gone",
                field="executor",
                value=f"{error}; in flight: {ends}"[:400],
                legal="workers that stay, or an executor with `renew`",
                fix="run again: finished edges are kept",
            ) from error
        renew()

    def _give_up(self, job: EdgeJob) -> EdgeResult:
        """An edge that has killed its worker twice."""
        note = f"{job.origin or HOME} → {job.target or HOME} killed its worker twice"
        self.lost[job.key] = Motion(
            Status.NUMERICAL_FAILURE, "fallback", None, float("inf"), note=note
        )
        return EdgeResult(job.key, None, 0.0)
