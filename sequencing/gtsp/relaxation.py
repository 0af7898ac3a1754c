"""Lagrangian lower bounds of a rooted problem, and what they rule out.

The multipliers are improved by Polyak's subgradient steps. Nodes and arcs through which no
relaxed route can beat the cut are removed for good: they are in no better tour.
"""

from __future__ import annotations

import math

import numpy as np

from sequencing.gtsp.relaxation_kernels import (
    Arcs,
    Memory,
    memory_rows,
    ng_arcs,
    ng_backward,
    ng_trace,
    walk_backward,
    walk_forward,
    walk_trace,
)
from sequencing.gtsp.rooted import Rooted

WALK_STEPS = 60
NG_STEPS = 60
FIRST_MEMORY = 3
LARGEST_MEMORY = 11
LARGEST_TABLE = 24_000_000  # states × positions of the ng table (8 bytes each)
LARGEST_WORK = 300_000_000  # arcs run through in one evaluation: some half a second
PHASE_WORK = 5_000_000_000  # in one phase: some ten seconds


class Relaxation:
    """A rooted problem that shrinks while its bound grows.

    `cut`: only tours that cost less are of interest. `bound`: proven for the original problem
    (or ≥ cut: there is no better tour). `node`: nodes of the rooted problem that are left.
    """

    def __init__(self, rooted: Rooted, cut: float, multipliers: np.ndarray | None) -> None:
        self.m = len(rooted.ptr) - 1
        self.cut = cut
        self.bound = -math.inf
        self.cost = rooted.cost.copy()
        self.leave = rooted.leave.copy()
        self.back = rooted.back.copy()
        self.ptr = rooted.ptr
        self.needs = rooted.needs
        self.node = np.arange(len(rooted.node))
        self.lam = np.zeros(self.m) if multipliers is None else multipliers.copy()
        masks = [int(x) for x in rooted.needs]
        self.early = np.array([1 + bin(x).count("1") for x in masks], dtype=np.int64)
        followers = [sum((x >> g) & 1 for x in masks) for g in range(self.m)]
        self.late = np.array([self.m - f for f in followers], dtype=np.int64)
        self.route = np.zeros(self.m, dtype=np.int64)
        self.phases = 0
        self._index()
        self.memory = self._nearest_memory(FIRST_MEMORY)

    @property
    def closed(self) -> bool:
        """True if no tour is cheaper than the cut."""
        return self.bound >= self.cut

    def walk_phase(self) -> None:
        """Subgradient steps on the walk relaxation, then arc and node removal."""
        visits = np.zeros(self.m, dtype=np.int64)

        def evaluate(lam: np.ndarray) -> tuple[float, np.ndarray]:
            cost, _, forward = self._forward(lam)
            value = walk_trace(cost, self.ptr, self.cluster, forward, self.back, visits)
            return value + lam.sum(), visits.copy()

        self._ascend(evaluate, WALK_STEPS)
        self._drop_by_walks()

    def ng_phase(self, steps: int = NG_STEPS) -> None:
        """Subgradient steps on the ng-route relaxation, then arc and node removal."""
        if self.closed:
            return
        self.phases += 1
        steps = max(4, min(steps, PHASE_WORK // max(self._work(), 1)))
        self.fill_memory()
        path = np.zeros(self.m, dtype=np.int64)
        top = [-math.inf]

        def evaluate(lam: np.ndarray) -> tuple[float, np.ndarray]:
            price, leave = self.backward(lam)
            value = ng_trace(self.arcs, price, leave, self.ptr, self.tables, self.togo, path)
            if value == math.inf:
                return math.inf, np.ones(self.m, dtype=np.int64)
            visits = np.bincount(path, minlength=self.m)
            if value + lam.sum() > top[0]:
                top[0] = value + lam.sum()
                self.route = path.copy()
            return value + lam.sum(), visits

        self._ascend(evaluate, steps)
        if not self.closed:
            self._drop_by_ng()

    def enlarge_memory(self) -> bool:
        """Let clusters remember more of the others; False if the table is as large as it may be.

        First those the best route came back to, then those with the cheapest way there and back.
        """
        size = min(FIRST_MEMORY - 2 + self.phases, LARGEST_MEMORY, self.m - 1)
        before = [list(known) for known in self.memory]
        last: dict[int, int] = {}
        for k, cluster in enumerate(self.route):
            g = int(cluster)
            for h in map(int, self.route[last.get(g, k) + 1 : k]):
                if h != g and g not in self.memory[h] and len(self.memory[h]) < size:
                    self.memory[h].append(g)
            last[g] = k
        for known, more in zip(self.memory, self._nearest_memory(self.m - 1)):
            known += [h for h in more if h not in known][: max(0, size - len(known))]
        if self.rows_a_position * (self.m + 1) > LARGEST_TABLE or self._work() > LARGEST_WORK:
            self.memory = before
        return self.memory != before

    @property
    def limit(self) -> float:
        """The cut in terms of costs with multipliers."""
        return self.cut - float(self.lam.sum())

    def _index(self) -> None:
        """Cluster of each node, and the arcs that are left, by the node they leave."""
        self.cluster = np.repeat(np.arange(self.m), np.diff(self.ptr))
        leaves, to = np.nonzero(np.isfinite(self.cost))
        link = np.searchsorted(leaves, np.arange(len(self.node) + 1))
        self.arcs = Arcs(link, to, self.cluster[to])
        self.length = self.cost[leaves, to]

    def _nearest_memory(self, count: int) -> list[list[int]]:
        """For each cluster those with the least cost of going there and back, at most `count`."""
        pay = self.lam[self.cluster] / 2
        reduced = self.cost - pay[:, None] - pay[None, :]
        way = np.minimum.reduceat(reduced, self.ptr[:-1], axis=1)
        way = np.minimum.reduceat(way, self.ptr[:-1], axis=0)
        order = np.argsort(way + way.T, axis=1, kind="stable")
        return [[int(h) for h in row if h != g][:count] for g, row in enumerate(order)]

    def _forward(self, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        pay = lam[self.cluster]
        cost = self.cost - pay[None, :]
        leave = self.leave - pay
        forward = np.empty((self.m + 1, len(self.node)))
        walk_forward(cost, leave, self.ptr, self.early, self.late, forward)
        return cost, leave, forward

    def backward(self, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Arc costs and first costs with multipliers; fills the cost-to-go table."""
        _, leave, forward = self._forward(lam)
        price = self.length - lam[self.arcs.group]
        when, cut = (self.early, self.late), self.cut - lam.sum()
        ng_backward(
            self.arcs, price, self.back, self.ptr, *when, self.tables, forward, cut, self.togo
        )
        return price, leave

    def _work(self) -> int:
        """Arcs that one evaluation of the ng relaxation runs through."""
        known = np.array([len(n) for n in self.memory])
        return int((np.diff(self.arcs.link) << known[self.cluster]).sum()) * self.m

    @property
    def rows_a_position(self) -> int:
        """States (node, memory) of the ng relaxation at one position."""
        return int(sum(int(s) << len(n) for s, n in zip(np.diff(self.ptr), self.memory)))

    def fill_memory(self) -> None:
        widest = max((len(n) for n in self.memory), default=0)
        bits = np.array([len(n) for n in self.memory], dtype=np.int64)
        members = np.zeros((self.m, max(widest, 1)), dtype=np.int64)
        for g, known in enumerate(self.memory):
            members[g, : len(known)] = known
        counts = np.diff(self.ptr) << bits
        offset = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
        total = int(counts.sum())
        rows = np.empty((self.m, 1 << widest, self.m), dtype=np.int32)
        self.tables = Memory(members, bits, offset, rows)
        memory_rows(self.tables, self.needs, self.ptr, total)
        self.togo = np.full((self.m + 1, total + len(self.node)), np.inf)

    def _ascend(self, evaluate, steps: int) -> None:  # type: ignore[no-untyped-def]
        """Polyak steps from the best multipliers; keeps the best bound and its multipliers."""
        lam = self.lam.copy()
        theta = 1.0
        since = 0
        best = -math.inf
        for _ in range(steps):
            value, visits = evaluate(lam)
            if value >= self.cut:
                self.bound = math.inf if value == math.inf else max(self.bound, value)
                self.bound = max(self.bound, self.cut)
                self.lam = lam
                return
            if value > best + 1e-4 * max(self._room(value), 1e-12):
                best, since = value, 0
            else:
                since += 1
            if value > self.bound:
                self.bound, self.lam = value, lam.copy()
            slope = 1.0 - visits
            norm = float(slope @ slope)
            if norm == 0.0:  # the relaxed route is a tour: its cost is the optimum
                return
            if since >= 6:
                theta *= 0.6
                since = 0
                lam = self.lam.copy() if best <= self.bound else lam
                if theta < 0.05:
                    return
            lam = lam + theta * self._room(value) / norm * slope

    def _room(self, value: float) -> float:
        """Distance to aim for: to the cut, or 5 % where there is none."""
        return self.cut - value if math.isfinite(self.cut) else 0.05 * abs(value) + 1e-9

    def _drop_by_walks(self) -> None:
        if self.closed:
            return
        cost, _, forward = self._forward(self.lam)
        rest = np.empty_like(forward)
        turned = np.ascontiguousarray(cost.T)
        walk_backward(turned, self.back, self.ptr, self.early, self.late, rest)
        least = np.full_like(cost, np.inf)
        for come, go in zip(forward[1:-1], rest[2:]):
            np.minimum(least, come[:, None] + go[None, :], out=least)
        self.cost[~(least + cost < self.limit)] = np.inf
        self.leave[~(self.leave - self.lam[self.cluster] + rest[1] < self.limit)] = np.inf
        self._keep((forward + rest)[1:].min(axis=0) < self.limit)

    def _drop_by_ng(self) -> None:
        price, leave = self.backward(self.lam)
        through = np.empty_like(price)
        first = np.empty_like(leave)
        known = (self.arcs, price, leave, self.ptr, self.tables, self.togo)
        ng_arcs(*known, self.limit, through, first)
        dead = ~(through < self.limit)
        to = self.arcs.to
        leaves = np.repeat(np.arange(len(self.node)), np.diff(self.arcs.link))
        self.cost[leaves[dead], to[dead]] = np.inf
        self.leave[~(first < self.limit)] = np.inf
        used = first < self.limit
        used[to[~dead]] = True
        self._keep(used)

    def _keep(self, keep: np.ndarray) -> None:
        """Remove nodes; a cluster without nodes means that no tour beats the cut."""
        counts = np.bincount(self.cluster[keep], minlength=self.m)
        if (counts == 0).any():
            self.bound = max(self.bound, self.cut)
            return
        if keep.all():
            self._index()
            return
        self.cost = np.ascontiguousarray(self.cost[np.ix_(keep, keep)])
        self.leave = self.leave[keep]
        self.back = self.back[keep]
        self.node = self.node[keep]
        self.ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._index()
