"""The cost oracle of a station: what every travel costs, as a bound, an estimate, or solved."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.cost import Cost
from dmoc.motion import Motion
from dmoc.refinement.params import Method
from planning.station import Station
from planning.world import CollisionWorld
from sequencing.bounds import power_bound, travel_bound
from sequencing.cycle_types import CycleMotion, Reuse
from sequencing.edge_worker import (
    EdgeJob,
    EdgeResult,
    Quality,
    context_fingerprint,
    solve_edge,
    write_context,
)
from sequencing.estimates import StraightLine, straight_line
from sequencing.learned import LearnedEstimate, edge_features, fit_estimate, training_pairs
from sequencing.nodes import HOME, StationNodes
from sequencing.store import EdgeStore, decode_motion, encode_motion

__all__ = ["Between", "EdgeEvent", "StationEdges"]

Pairs = npt.NDArray[np.int64]

# Configurations of a straight line that are asked yes or no for the estimate's obstacle share.
LINE_SAMPLES = 6


@dataclass(frozen=True)
class EdgeEvent:
    """Progress: edges finished and failed so far in this run, and how many of a batch are left."""

    done: int
    failed: int
    left: int
    reused: int
    quality: Quality


@dataclass
class EdgeCounts:
    """What an oracle has done; `cpu_s` includes the workers."""

    solved: int = 0
    reused: int = 0
    failed: int = 0
    cpu_s: float = 0.0
    reused_edges: set[tuple[int, int]] = field(default_factory=set)
    solved_edges: set[tuple[int, int]] = field(default_factory=set)


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


class StationEdges:
    """`CostOracle` of a station (bound, estimate, evaluate; rows (i, j) of nodes; inf = none).

    Travel costs are symmetric under the quadratic cost without friction: one solve, from the node
    with the smaller number to the other, stands for both directions. Solved edges are written to
    the store as they finish. Results depend on the pair, the station and the seed only, never on
    the executor or on completion order.
    """

    symmetric = True

    def __init__(
        self,
        station: Station,
        world: CollisionWorld,
        nodes: StationNodes,
        store: EdgeStore,
        *,
        seed: int = 0,
        method: Method = "halfspaces",
        executor: Executor | None = None,
        progress: Callable[[EdgeEvent], None] | None = None,
    ) -> None:
        self.station, self.world, self.nodes, self.store = station, world, nodes, store
        self.seed, self.method, self.executor = seed, method, executor
        self.progress = progress
        self.counts = EdgeCounts()
        self.costs: dict[tuple[int, int], float] = {}
        self.learned: LearnedEstimate | None = None
        self.held_out: set[tuple[int, int]] = set()
        self.num_training = 0
        self._bounds: Array | None = None
        self._estimates: Array | None = None
        self._fingerprint = context_fingerprint(station, method)
        self._folder = tempfile.TemporaryDirectory(prefix="dmoc-")
        self._context = write_context(station, Path(self._folder.name))
        self._gravity = station.robot.gravity_torque_nm(nodes.q_rad)
        self._pairs = nodes.usable_pairs()
        self._row = np.full((nodes.num_nodes, nodes.num_nodes), -1, dtype=np.int64)
        self._row[self._pairs[:, 0], self._pairs[:, 1]] = np.arange(len(self._pairs))
        self._row = np.maximum(self._row, self._row.T)
        self._rough = self._straight_lines()
        self._features = self._all_features()

    # ---- the three answers -------------------------------------------------------------------

    def bound(self, pairs: Pairs) -> Array:
        """Proven lower bounds (K,) of docs/bounds.md, through the ends of the departure lines."""
        if self._bounds is None:
            self._bounds = self._all_bounds()
        return self._bounds[self._rows(pairs)]

    def estimate(self, pairs: Pairs) -> Array:
        """Estimates (K,): learned where `train` has run, else the straight line's cost."""
        if self._estimates is None:
            rough = self._rough.cost
            learned = self.learned
            self._estimates = rough if learned is None else learned.predict(self._features, rough)
        return self._estimates[self._rows(pairs)]

    def evaluate(self, pairs: Pairs) -> Array:
        """Solved costs (K,) at screening quality; inf where no certified motion exists."""
        self._solve(pairs, "screen")
        return np.array([self.costs[self._canonical(i, j)] for i, j in pairs])

    # ---- motions -----------------------------------------------------------------------------

    def motions(self, pairs: Pairs, quality: Quality = "screen") -> list[Motion]:
        """The motions of directed pairs, in their direction."""
        self._solve(pairs, "screen")
        if quality == "final":
            self._solve(pairs, "final")
        found = []
        for i, j in pairs:
            low, high = self._canonical(i, j)
            motion = self._read(low, high, quality)
            if (i, j) != (low, high) and motion.trajectory is not None:
                motion = motion.replace(trajectory=motion.trajectory.reversed())
            found.append(motion)
        return found

    def between(self, wanted: Sequence[Between]) -> list[Motion]:
        """Final motions between poses that are no nodes, solved in one batch and stored."""
        jobs = [self._free_job(item) for item in wanted]
        missing = {job.key: job for job in jobs if self.store.get(job.key) is None}
        self.counts.reused += len(jobs) - len(missing)
        for result in self._run(list(missing.values())):
            self.store.put(result.key, result.payload)
            self.counts.solved += 1
            self.counts.cpu_s += result.cpu_s
        found = []
        for job in jobs:
            payload = self.store.get(job.key)
            assert payload is not None
            found.append(decode_motion(payload, self.station.robot))
        return found

    def _free_job(self, item: Between) -> EdgeJob:
        screened = encode_motion(item.like)
        digest = hashlib.sha256(f"{self._fingerprint}|between|{self.seed}|".encode())
        for stud, q in ((item.origin, item.start_rad), (item.target, item.goal_rad)):
            digest.update(np.ascontiguousarray(q, dtype=float).tobytes())
            line = "home" if stud is None else repr(self._stud_geometry(stud))
            digest.update(line.encode())
        digest.update(hashlib.sha256(screened).digest())
        key = digest.hexdigest()
        return EdgeJob(
            context=self._context, key=key, origin=item.origin, target=item.target,
            start_rad=tuple(item.start_rad), goal_rad=tuple(item.goal_rad), quality="final",
            method=self.method, screened=screened,
            seed=int(hashlib.sha256(f"{self.seed}|{key}".encode()).hexdigest()[:8], 16),
        )  # fmt: skip

    def floor_factors(self, quantile: float) -> tuple[Array, float]:
        """(V, V) shares of the estimates that travels are held to cost at least, and the coverage
        of that condition (see `LearnedEstimate.factors`). After `train`.
        """
        assert self.learned is not None
        i, j = self._pairs.T
        factors, coverage = self.learned.factors(self._features, quantile)
        table = np.ones((self.nodes.num_nodes,) * 2)
        table[i, j] = table[j, i] = factors
        return table, coverage

    def forbid(self, pairs: Iterable[tuple[int, int]]) -> None:
        """Take edges out (their final motion was not certified)."""
        for i, j in pairs:
            self.costs[self._canonical(i, j)] = np.inf

    def settle(self, pairs: Sequence[tuple[int, int]], motions: Sequence[CycleMotion]) -> bool:
        """Take over the costs of final motions; True if that changed any."""
        changed = False
        for (i, j), item in zip(pairs, motions):
            pair = self._canonical(i, j)
            changed |= self.costs[pair] != item.motion.cost
            self.costs[pair] = item.motion.cost
        return changed

    def train(self, training: int, held_out: int | None = None) -> LearnedEstimate:
        """Solve a fixed set of edges, fit the estimate to most and judge it by those held out."""
        judges = 200 if held_out is None else held_out
        fit, held = training_pairs(self._pairs, self._rough.cost, self._draws(), training, judges)
        solved = self.evaluate(np.vstack([fit, held]))
        rows, held_rows = self._rows(fit), self._rows(held)
        self.num_training = len(fit)
        self.held_out = {self._canonical(i, j) for i, j in held}
        judged = self._features[held_rows], self._rough.cost[held_rows], solved[len(fit) :]
        self.learned = fit_estimate(
            self._features[rows], self._rough.cost[rows], solved[: len(fit)], judged, self.seed
        )
        self._estimates = None
        return self.learned

    def _draws(self) -> Array:
        """A random number (P,) for every edge, from the seed and its two ends alone."""
        ends = [self._end_digest(node) for node in range(self.nodes.num_nodes)]
        salt = str(self.seed).encode()
        draws = [
            int.from_bytes(hashlib.sha256(salt + ends[i] + ends[j]).digest()[:6], "big")
            for i, j in self._pairs
        ]
        return np.array(draws, dtype=float)

    def _end_digest(self, node: int) -> bytes:
        digest = hashlib.sha256(self.nodes.q_rad[node].tobytes())
        digest.update(self.nodes.line_end_rad[node].tobytes())
        return digest.digest()

    def reuse(self) -> Reuse:
        """Which travels were read from the store and which were solved, so far."""
        counts = self.counts
        return Reuse(
            tuple(self._names(pair) for pair in sorted(counts.reused_edges - counts.solved_edges)),
            tuple(self._names(pair) for pair in sorted(counts.solved_edges)),
        )

    def _names(self, pair: tuple[int, int]) -> tuple[str, str]:
        nodes = self.nodes
        low, high = (
            HOME if node == nodes.home else f"{nodes.stud[node]}/{nodes.alternative[node]}"
            for node in pair
        )
        return low, high

    def close(self) -> None:
        """Remove the workers' context file."""
        self._folder.cleanup()

    # ---- inside ------------------------------------------------------------------------------

    def _quadratic(self) -> Cost:
        cost = self.station.cost
        assert isinstance(cost, Cost)
        return cost

    @staticmethod
    def _canonical(i: int, j: int) -> tuple[int, int]:
        return (int(i), int(j)) if i < j else (int(j), int(i))

    def _rows(self, pairs: Pairs) -> npt.NDArray[np.int64]:
        i, j = np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T
        rows: npt.NDArray[np.int64] = self._row[i, j]
        assert np.all(rows >= 0), "a pair of one cluster has no travel"
        return rows

    def _all_bounds(self) -> Array:
        robot, cost = self.station.robot, self._quadratic()
        waypoints = self.nodes.waypoints(self._pairs)
        bounds = power_bound(robot, cost, waypoints)
        holding = travel_bound(robot, cost, self.nodes.q_rad)
        return bounds if holding is None else np.maximum(bounds, holding(self._pairs, waypoints))

    def _straight_lines(self) -> StraightLine:
        q = self.nodes.q_rad
        i, j = self._pairs[:, 0], self._pairs[:, 1]
        return straight_line(self.station.robot, self._quadratic(), q[i], q[j])

    def _all_features(self) -> Array:
        waypoints = self.nodes.waypoints(self._pairs)
        inner0, inner1 = waypoints[:, 1], waypoints[:, 2]
        hits = np.zeros(len(self._pairs))
        for fraction in np.linspace(0.0, 1.0, LINE_SAMPLES + 2)[1:-1]:
            hits += self.world.collide_batch(inner0 + fraction * (inner1 - inner0))
        rough = self._rough
        parts = np.column_stack(
            [
                rough.cost, rough.duration_s, rough.alpha * rough.duration_s,
                rough.gamma / rough.duration_s**3,
            ]
        )  # fmt: skip
        return edge_features(waypoints, self._gravity, self._pairs, parts, hits / LINE_SAMPLES)

    def _key(self, low: int, high: int, quality: Quality) -> str:
        digest = hashlib.sha256(f"{self._fingerprint}|{quality}|{self.seed}|".encode())
        for node in (low, high):
            digest.update(self.nodes.q_rad[node].tobytes())
            digest.update(self.nodes.line_end_rad[node].tobytes())
            stud = self._stud(node)
            line = "home" if stud is None else repr(self._stud_geometry(stud))
            digest.update(line.encode())
        return digest.hexdigest()

    def _stud_geometry(self, stud_id: str) -> tuple[object, ...]:
        stud = next(s for s in self.station.studs if s.id == stud_id)
        return (
            tuple(stud.position_m), tuple(stud.normal), tuple(stud.depart_direction),
            stud.depart_m, stud.on, self.station.stray_m,
        )  # fmt: skip

    def _stud(self, node: int) -> str | None:
        name = self.nodes.stud[node]
        return None if name == HOME and node == self.nodes.home else name

    def _job(self, low: int, high: int, quality: Quality) -> EdgeJob:
        key = self._key(low, high, quality)
        screened = self.store.get(self._key(low, high, "screen")) if quality == "final" else None
        return EdgeJob(
            context=self._context, key=key, origin=self._stud(low), target=self._stud(high),
            start_rad=tuple(self.nodes.q_rad[low]), goal_rad=tuple(self.nodes.q_rad[high]),
            quality=quality, method=self.method, screened=screened,
            seed=int(hashlib.sha256(f"{self.seed}|{key}".encode()).hexdigest()[:8], 16),
        )  # fmt: skip

    def _read(self, low: int, high: int, quality: Quality) -> Motion:
        payload = self.store.get(self._key(low, high, quality))
        assert payload is not None
        return decode_motion(payload, self.station.robot)

    def _solve(self, pairs: Pairs, quality: Quality) -> None:
        wanted = sorted({self._canonical(i, j) for i, j in pairs})
        if quality == "screen":
            wanted = [pair for pair in wanted if pair not in self.costs]
        jobs, owner = [], {}
        for low, high in wanted:
            key = self._key(low, high, quality)
            payload = self.store.get(key)
            if payload is not None:
                self.counts.reused += 1
                self.counts.reused_edges.add((low, high))
                self._finish((low, high), payload, quality)
            else:
                jobs.append(self._job(low, high, quality))
                owner[key] = (low, high)
        left = len(jobs)
        for result in self._run(jobs):
            left -= 1
            self.store.put(result.key, result.payload)
            self.counts.solved += 1
            self.counts.cpu_s += result.cpu_s
            self.counts.solved_edges.add(owner[result.key])
            self._finish(owner[result.key], result.payload, quality)
            self._tell(left, quality)

    def _run(self, jobs: list[EdgeJob]) -> Iterable[EdgeResult]:
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

    def _finish(self, pair: tuple[int, int], payload: bytes, quality: Quality) -> None:
        if quality != "screen":
            return
        motion = decode_motion(payload, self.station.robot)
        usable = motion.status.ok and motion.certified and motion.trajectory is not None
        self.costs[pair] = motion.cost if usable else np.inf
        self.counts.failed += not usable

    def _tell(self, left: int, quality: Quality) -> None:
        if self.progress is not None:
            counts = self.counts
            self.progress(EdgeEvent(counts.solved, counts.failed, left, counts.reused, quality))
