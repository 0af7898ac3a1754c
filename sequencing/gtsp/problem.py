"""The generalised travelling salesman problem and its answer.

V nodes lie in M clusters; a tour visits exactly one node of every cluster. A node is one way of
doing a task (a robot configuration at a weld), a cluster is the task. The cost of a tour
v_1 … v_M is

    Σ_k node_cost[v_k] + Σ_k cost[exit_of[v_k], v_{k+1}]

where the last edge leads back to v_1 unless the problem is a path.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sequencing.gtsp.validation import (
    check_problem,
    cluster_labels,
    faults_of_tour,
    frozen_array,
    precedence_pairs,
)


@dataclass(frozen=True, eq=False)
class GtspProblem:
    """A GTSP, checked when built. Raises `ProblemError` with every fault found.

    cost        (V, V) travel cost from row to column; any finite unit, inf = forbidden. Entries
                between nodes of one cluster and the diagonal are never used.
    cluster_of  (V,) cluster of each node, 0 … M−1, none empty.
    node_cost   (V,) cost of visiting a node (default 0), inf = the node is not available.
    home        node where the cycle begins and ends; the other nodes of its cluster are unused.
    start, end  nodes where a path begins and ends; giving one makes the problem a path.
    path        True: open path (with free ends unless `start` or `end` is given).
    precedence  pairs (a, b) or a networkx DiGraph over clusters: a is visited before b. In a cycle
                without home this means: there is a first cluster from which it holds.
    exit_of     (V,) node at which a visit that enters at v leaves; in v's own cluster. Default v.
                A seam with ends A and B: one cluster {A, B}, exit_of[A] = B, exit_of[B] = A.
    name        for reports.
    """

    cost: np.ndarray
    cluster_of: np.ndarray
    node_cost: np.ndarray = None  # type: ignore[assignment]  # replaced by zeros when not given
    home: int | None = None
    start: int | None = None
    end: int | None = None
    precedence: Any = ()
    exit_of: np.ndarray = None  # type: ignore[assignment]  # replaced by 0 … V−1 when not given
    path: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "cost", frozen_array(self.cost, "cost", np.float64, 2))
        size = self.cost.shape[0]
        put(self, "cluster_of", frozen_array(self.cluster_of, "cluster_of", np.int64, 1))
        zero = np.zeros(size) if self.node_cost is None else self.node_cost
        put(self, "node_cost", frozen_array(zero, "node_cost", np.float64, 1))
        same = np.arange(size) if self.exit_of is None else self.exit_of
        put(self, "exit_of", frozen_array(same, "exit_of", np.int64, 1))
        put(self, "precedence", precedence_pairs(self.precedence))
        for key in ("home", "start", "end"):
            value = getattr(self, key)
            put(self, key, None if value is None else int(value))
        put(self, "path", self.path or self.start is not None or self.end is not None)
        check_problem(self)

    @classmethod
    def from_clusters(
        cls, cost: np.ndarray, clusters: Sequence[Sequence[int]], **fields: Any
    ) -> GtspProblem:
        """Build from lists of nodes, one list a cluster; a node in two lists or none is a fault."""
        labels = cluster_labels(clusters, np.asarray(cost).shape[0])
        return cls(cost=cost, cluster_of=labels, **fields)

    @property
    def num_nodes(self) -> int:
        return int(self.cost.shape[0])

    @property
    def num_clusters(self) -> int:
        return int(self.cluster_of.max()) + 1

    @property
    def clusters(self) -> tuple[tuple[int, ...], ...]:
        """The nodes of each cluster."""
        lists: list[list[int]] = [[] for _ in range(self.num_clusters)]
        for node, cluster in enumerate(self.cluster_of):
            lists[cluster].append(node)
        return tuple(tuple(nodes) for nodes in lists)

    def replace(self, **changes: Any) -> GtspProblem:
        """A copy with some fields changed, checked again (a path stays one: give `path=False`)."""
        return dataclasses.replace(self, **changes)

    def edges(self, nodes: Sequence[int]) -> np.ndarray:
        """Travels (K, 2) of a tour as (exit node, entry node): what an edge oracle is asked."""
        entry = np.asarray(nodes, dtype=np.int64)
        if entry.size == 0:
            return np.empty((0, 2), dtype=np.int64)
        leave = self.exit_of[entry]
        arrive = np.roll(entry, -1)
        pairs = np.stack([leave, arrive], axis=1)
        if self.path:
            pairs = pairs[:-1]
        return pairs[pairs[:, 0] != pairs[:, 1]]  # a cycle of one node does not travel

    def tour_cost(self, nodes: Sequence[int]) -> float:
        """Cost of a sequence of nodes, recomputed from the problem; inf if it uses inf."""
        pairs = self.edges(nodes)
        index = np.asarray(nodes, dtype=np.int64)
        parts = [*self.node_cost[index], *self.cost[pairs[:, 0], pairs[:, 1]]]
        return math.inf if math.inf in parts else math.fsum(parts)

    def tour_magnitude(self, nodes: Sequence[int]) -> float:
        """Σ |cost| over the parts of a tour: the scale of its rounding errors."""
        pairs = self.edges(nodes)
        index = np.asarray(nodes, dtype=np.int64)
        travel = np.abs(self.cost[pairs[:, 0], pairs[:, 1]]).sum()
        finite = self.cost[np.isfinite(self.cost)]
        shift = max(0.0, -float(finite.min())) if finite.size else 0.0
        return float(np.abs(self.node_cost[index]).sum() + travel + len(index) * shift)

    def faults(self, nodes: Sequence[int]) -> tuple[str, ...]:
        """Why a sequence of nodes is not an admissible tour (empty: it is)."""
        return faults_of_tour(self, nodes)


@dataclass(frozen=True)
class Tour:
    """Answer of a solver: nodes in order (the closing edge of a cycle is implied).

    cost         cost of `nodes` recomputed from the problem; inf when no tour was found.
    lower_bound  proven lower bound of every admissible tour; −inf when nothing was proven.
    proven       True: `cost` is optimal within 1e-7 of the sum of its parts' magnitudes (exact for
                 whole numbers); with no nodes: the problem is proven to have no tour.
    method       how it was found, in words.
    pool         other good tours, best first, `nodes` itself first (only when asked for).
    """

    nodes: tuple[int, ...]
    cost: float
    lower_bound: float = -math.inf
    proven: bool = False
    method: str = ""
    pool: tuple[tuple[int, ...], ...] = field(default=(), compare=False)

    @property
    def found(self) -> bool:
        """True if there is a tour to drive."""
        return bool(self.nodes) and math.isfinite(self.cost)

    @property
    def gap(self) -> float:
        """(cost − lower_bound) / |cost|; inf when nothing was proven, 0 when proven."""
        if self.proven:
            return 0.0
        if not math.isfinite(self.cost) or not math.isfinite(self.lower_bound):
            return math.inf
        scale = max(abs(self.cost), 1e-300)
        return max(0.0, self.cost - self.lower_bound) / scale

    def clusters(self, problem: GtspProblem) -> tuple[int, ...]:
        """The clusters in the order of the visit."""
        return tuple(int(problem.cluster_of[node]) for node in self.nodes)


def as_tours(tours: Iterable[Tour | Sequence[int]]) -> list[tuple[int, ...]]:
    """Node tuples of tours or sequences, for warm starts."""
    return [tour.nodes if isinstance(tour, Tour) else tuple(int(v) for v in tour) for tour in tours]
