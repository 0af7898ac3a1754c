"""The cost oracle of a station: what every travel costs, as a bound, an estimate, or solved."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from sequencing.bounds import power_bound, travel_bound
from sequencing.cycle_types import CycleMotion, Reuse
from sequencing.edges.estimates import StationEstimates
from sequencing.edges.jobs import Between, EdgeJobs, EdgeKeys
from sequencing.edges.learned import LearnedEstimate, training_pairs
from sequencing.edges.nodes import HOME, StationNodes
from sequencing.edges.store import EdgeStore
from sequencing.edges.worker import Quality

Pairs = npt.NDArray[np.int64]


@dataclass(frozen=True)
class EdgeEvent:
    """Progress: edges finished and failed so far in this run, and how many of a batch are left."""

    done: int
    failed: int
    left: int
    reused: int
    quality: Quality


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
        solver: str = DEFAULT_SOLVER,
        executor: Executor | None = None,
        progress: Callable[[EdgeEvent], None] | None = None,
    ) -> None:
        self.station, self.nodes, self.store = station, nodes, store
        self.seed, self.progress = seed, progress
        self.keys = EdgeKeys(station, nodes, method, seed, solver)
        self.jobs = EdgeJobs(self.keys, store, executor)
        self.costs: dict[tuple[int, int], float] = {}
        self.held_out: set[tuple[int, int]] = set()
        self.num_training = 0
        self._bounds: Array | None = None
        self._pairs = nodes.usable_pairs()
        self._row = np.full((nodes.num_nodes, nodes.num_nodes), -1, dtype=np.int64)
        self._row[self._pairs[:, 0], self._pairs[:, 1]] = np.arange(len(self._pairs))
        self._row = np.maximum(self._row, self._row.T)
        self.estimates = StationEstimates(station, world, nodes, self._pairs)

    # ---- the three answers -------------------------------------------------------------------

    def bound(self, pairs: Pairs) -> Array:
        """Proven lower bounds (K,) of docs/bounds.md, through the ends of the departure lines."""
        if self._bounds is None:
            self._bounds = self._all_bounds()
        return self._bounds[self._rows(pairs)]

    def estimate(self, pairs: Pairs) -> Array:
        """Estimates (K,): learned where `train` has run, else the straight line's cost."""
        return self.estimates.cost[self._rows(pairs)]

    def evaluate(self, pairs: Pairs) -> Array:
        """Solved costs (K,) at screening quality; inf where no certified motion exists."""
        self._solve(pairs, "screen")
        return np.array([self.costs[self._canonical(i, j)] for i, j in pairs])

    # ---- motions -----------------------------------------------------------------------------

    def motions(self, pairs: Pairs, quality: Quality = "screen") -> list[Motion]:
        """The motions of directed pairs, in their direction."""
        for pair in {self._canonical(i, j) for i, j in pairs}:
            if self.jobs.motion(self.keys.key(*pair, "screen")) is None:
                self.costs.pop(pair, None)  # not yet solved, or damaged since
        self._solve(pairs, "screen")
        if quality == "final":
            self._solve(pairs, "final")
        found = []
        for i, j in pairs:
            low, high = self._canonical(i, j)
            motion = self._stored(self.keys.key(low, high, quality))
            if (i, j) != (low, high) and motion.trajectory is not None:
                motion = motion.replace(trajectory=motion.trajectory.reversed())
            found.append(motion)
        return found

    def between(self, wanted: Sequence[Between]) -> list[Motion]:
        """Final motions between poses that are no nodes, solved in one batch and stored."""
        jobs = [self.jobs.job_between(item) for item in wanted]
        missing = {job.key: job for job in jobs if self.jobs.motion(job.key) is None}
        self.jobs.counts.reused += len(jobs) - len(missing)
        for _ in self.jobs.solve(list(missing.values())):
            pass
        return [self._stored(job.key) for job in jobs]

    def floor_factors(self, quantile: float) -> tuple[Array, float]:
        """(V, V) shares of the estimates that travels are held to cost at least, and the coverage
        of that condition (see `LearnedEstimate.factors`). After `train`.
        """
        learned = self.estimates.learned
        assert learned is not None
        i, j = self._pairs.T
        factors, coverage = learned.factors(self.estimates.features, quantile)
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
        rough, draws = self.estimates.rough.cost, self.keys.draws(self._pairs)
        fit, held = training_pairs(self._pairs, rough, draws, training, judges)
        solved = self.evaluate(np.vstack([fit, held]))
        self.num_training = len(fit)
        self.held_out = {self._canonical(i, j) for i, j in held}
        return self.estimates.fit(
            self._rows(fit), solved[: len(fit)], self._rows(held), solved[len(fit) :]
        )

    def reuse(self) -> Reuse:
        """Which travels were read from the store and which were solved, so far."""
        counts = self.jobs.counts
        return Reuse(
            tuple(self._names(pair) for pair in sorted(counts.reused_edges - counts.solved_edges)),
            tuple(self._names(pair) for pair in sorted(counts.solved_edges)),
            tuple(motion.note for motion in self.jobs.lost.values()),
        )

    def _names(self, pair: tuple[int, int]) -> tuple[str, str]:
        nodes = self.nodes
        low, high = (
            HOME if node == nodes.home else f"{nodes.stud[node]}/{nodes.alternative[node]}"
            for node in pair
        )
        return low, high

    # ---- inside ------------------------------------------------------------------------------

    @staticmethod
    def _canonical(i: int, j: int) -> tuple[int, int]:
        return (int(i), int(j)) if i < j else (int(j), int(i))

    def _rows(self, pairs: Pairs) -> npt.NDArray[np.int64]:
        i, j = np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T
        rows: npt.NDArray[np.int64] = self._row[i, j]
        assert np.all(rows >= 0), "a pair of one cluster has no travel"
        return rows

    def _all_bounds(self) -> Array:
        robot, cost = self.station.robot, self.station.cost
        assert isinstance(cost, Cost)
        waypoints = self.nodes.waypoints(self._pairs)
        bounds = power_bound(robot, cost, waypoints)
        holding = travel_bound(robot, cost, self.nodes.q_rad)
        return bounds if holding is None else np.maximum(bounds, holding(self._pairs, waypoints))

    def _stored(self, key: str) -> Motion:
        motion = self.jobs.motion(key)
        if motion is None:
            raise self.store.damaged("an edge that was just written cannot be read")
        return motion

    def _solve(self, pairs: Pairs, quality: Quality) -> None:
        wanted = sorted({self._canonical(i, j) for i, j in pairs})
        if quality == "screen":
            wanted = [pair for pair in wanted if pair not in self.costs]
        jobs, owner, counts = [], {}, self.jobs.counts
        for pair in wanted:
            key = self.keys.key(*pair, quality)
            motion = self.jobs.motion(key)
            if motion is not None:
                counts.reused += 1
                counts.reused_edges.add(pair)
                self._finish(pair, motion, quality)
            else:
                jobs.append(self.jobs.job(*pair, quality))
                owner[key] = pair
        left = len(jobs)
        for key in self.jobs.solve(jobs):
            left -= 1
            counts.solved_edges.add(owner[key])
            self._finish(owner[key], self._stored(key), quality)
            if self.progress is not None:
                self.progress(EdgeEvent(counts.solved, counts.failed, left, counts.reused, quality))

    def _finish(self, pair: tuple[int, int], motion: Motion, quality: Quality) -> None:
        if quality != "screen":
            return
        usable = motion.status.ok and motion.certified and motion.trajectory is not None
        self.costs[pair] = motion.cost if usable else np.inf
        self.jobs.counts.failed += not usable
