"""The first level (the DTO paper's SCO): which windows overlap and in which order jobs run.

The energy of a window depends on who brakes while whom accelerates, so which trajectories meet in
a window, and which wait, is worth choosing before the second level times them in detail. A window
is valued by its optimised energy without collisions; a plan whose windows the second level, with
collisions, then finds dearer is valued again with those energies, until the plan stands (lazy
refutation). `proven` is about this sum of windows, not about the energy of the whole schedule.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmoc.errors import ProblemError
from sequencing.timing.search.jobs import Jobs, in_order, jobs_of
from sequencing.timing.search.optimise import DEFAULT_SEARCH, SearchParams
from sequencing.timing.search.order import Orders, align, count_orders, order_exact, order_search
from sequencing.timing.search.prepared import Geometry, PreparedCell
from sequencing.timing.search.windows import (
    Windows,
    make_windows,
    owners,
    standing_of,
    window_result,
)

_QUICK = SearchParams(method="gradient", scattered=96, gradient_starts=3, gradient_iterations=30)
_MOST_WINDOWS = 1200  # valued for one order
_MOST_ORDERS = 5_000  # enumerated; more are searched
_MOST_JOINT = 60  # orders that are each aligned by themselves
_ROUNDS = 25

Groups = tuple[tuple[int, ...], ...]
Key = tuple[tuple[int, ...], tuple[tuple[int, bool], ...]]


@dataclass(frozen=True, eq=False)
class FirstLevel:
    """What the first level chose.

    `order` has each robot's own counts in the order in which they run, `windows` the windows, in
    the numbers of the cell. `estimate_j` is the sum of their energies, `given_j` that of the given
    ones (inf where they do not fit). `method` is exact or search, `proven` as said above; `valued`
    counts the windows looked at. `orders` and `alignments` count what there was to choose from
    (alignments: windows on ways that are quick enough); `changed` is False if nothing is better.
    """

    order: tuple[tuple[int, ...], ...]
    windows: Windows
    estimate_j: float
    given_j: float
    method: str
    proven: bool
    valued: int
    orders: float
    alignments: int
    changed: bool


def first_level(
    prepared: PreparedCell,
    total_s: float,
    seed: int,
    geometry: Geometry | None = None,
    params: SearchParams = DEFAULT_SEARCH,
) -> FirstLevel | None:
    """Order and windows within `total_s`; None where windows cannot be used at all.

    That is where a robot must stand still after a trajectory, where there is one robot only, or
    where no windows are quick enough. The given order and windows are among the candidates.
    """
    cell = prepared.cell
    if len(cell.robots) < 2 or any(t > 0 for robot in cell.robots for t in robot.pause_s):
        return None
    plans = _Plans(prepared, total_s, seed, geometry, params)
    best = plans.best()
    for _ in range(_ROUNDS if geometry is not None else 0):
        if best is None or not plans.values.refute(best.windows):
            break
        best = plans.best()
    return best


class _Plans:
    """All plans of a cell within a time, by the values of windows known so far."""

    def __init__(
        self,
        prepared: PreparedCell,
        total_s: float,
        seed: int,
        geometry: Geometry | None,
        params: SearchParams,
    ) -> None:
        self.prepared, self.total_s, self.seed = prepared, total_s, seed
        self.cell = prepared.cell
        self.owner = owners(self.cell)
        self.jobs: list[Jobs] = [jobs_of(robot) for robot in self.cell.robots]
        self.sizes = [len(item.jobs) for item in self.jobs]
        self.values = _Values(prepared, seed, geometry, params)
        self.last: Orders | None = None

    def best(self) -> FirstLevel | None:
        given: Orders = tuple(tuple(range(n)) for n in self.sizes)
        total = count_orders(self.sizes)
        joint = total <= _MOST_JOINT
        exact = total <= _MOST_ORDERS

        def cost(orders: Orders) -> float:
            return self.aligned(orders)[1] if joint else self.sum_of(self.side_by_side(orders))

        if total <= 1:
            orders = given
        elif exact:
            orders, _ = order_exact(self.sizes, cost)
        else:
            orders, _ = order_search(self.sizes, cost, self.seed, start=self.last)
        self.last = orders
        groups, estimate, proven, choices = self.aligned(orders)
        windows = None if groups is None else make_windows(self.prepared, groups, self.total_s)
        if groups is None or windows is None:
            return None
        plain = self.side_by_side(given)
        return FirstLevel(
            tuple(item.arranged(own) for item, own in zip(self.jobs, orders)),
            windows,
            estimate,
            self.sum_of(plain),
            "exact" if exact and proven else "search",
            joint and proven,
            len(self.values.known),
            total,
            choices,
            groups != plain,
        )

    def numbers(self, orders: Orders) -> list[list[int]]:
        """Trajectory numbers of each robot in order of execution."""
        own = [item.arranged(order) for item, order in zip(self.jobs, orders)]
        flat = in_order(self.cell, own)
        return [flat[a:b] for a, b in itertools.pairwise(self.cell.first)]

    def side_by_side(self, orders: Orders) -> Groups:
        """Windows of the k-th trajectories."""
        rows = self.numbers(orders)
        longest = max(len(row) for row in rows)
        return tuple(tuple(row[k] for row in rows if k < len(row)) for k in range(longest))

    def sum_of(self, groups: Groups) -> float:
        """Sum of the windows' energies; inf if they need more time or break a hand-over."""
        if sum(map(self.values.length_s, groups)) > self.total_s * (1.0 + 1e-9):
            return np.inf
        window_of = {k: w for w, group in enumerate(groups) for k in group}
        if any(window_of[a] >= window_of[b] for a, b in self.cell.handovers):
            return np.inf
        return float(sum(map(self.values.of, zip(groups, standing_of(self.owner, groups)))))

    def aligned(self, orders: Orders) -> tuple[Groups | None, float, bool, int]:
        """The best windows of one order: groups, energy, proven, number of windows to choose."""
        rows = self.numbers(orders)
        place = {k: (r, at) for r, row in enumerate(rows) for at, k in enumerate(row)}
        flat = self.values.flat

        def cost(state: tuple[int, ...], move: tuple[int, ...]) -> float:
            moving = tuple(row[state[r]] for r, row in enumerate(rows) if move[r])
            standing = tuple(
                (row[max(state[r] - 1, 0)], state[r] > 0)
                for r, row in enumerate(rows)
                if not move[r]
            )
            return self.values.of((moving, standing))

        try:
            found = align(
                [[float(flat[k]) for k in row] for row in rows],
                cost,
                [(place[a], place[b]) for a, b in self.cell.handovers],
                self.total_s,
                _MOST_WINDOWS,
            )
        except ProblemError:  # too large a lattice, or no way that is quick enough
            plain = self.side_by_side(orders)
            value = self.sum_of(plain)
            return (plain if np.isfinite(value) else None), value, False, 0
        groups = tuple(
            tuple(rows[r][k] for r, k in enumerate(window) if k is not None)
            for window in found.windows
        )
        # Among equals the windows side by side are the plainer answer.
        plain = self.side_by_side(orders)
        if self.sum_of(plain) <= found.cost_j * (1.0 + 1e-9):
            groups = plain
        return groups, found.cost_j, found.proven, found.valued


class _Values:
    """Energies of windows, optimised once each; those of refuted ones with collisions."""

    def __init__(
        self, prepared: PreparedCell, seed: int, geometry: Geometry | None, params: SearchParams
    ) -> None:
        self.prepared, self.seed = prepared, seed
        self.geometry, self.params = geometry, params
        self.flat = np.array([t for row in prepared.cell.durations_s for t in row])
        self.known: dict[Key, float] = {}
        self.final: set[Key] = set()

    def of(self, key: Key) -> float:
        """Energy [J] of a window (moving, standing)."""
        if key not in self.known:
            self.known[key] = self._optimise(key, None, _QUICK)
        return self.known[key]

    def refute(self, windows: Windows) -> bool:
        """Value the windows with collisions; True if any became dearer than it was thought."""
        dearer = False
        for key in zip(windows.numbers, windows.standing):
            if key in self.final:
                continue
            self.final.add(key)
            before = self.of(key)
            self.known[key] = self._optimise(key, self.geometry, self.params)
            dearer = dearer or self.known[key] > before * (1.0 + 1e-6)
        return dearer

    def length_s(self, moving: Sequence[int]) -> float:
        """Length of a window: its longest trajectory."""
        return float(max(self.flat[k] for k in moving))

    def _optimise(self, key: Key, geometry: Geometry | None, params: SearchParams) -> float:
        moving, standing = key
        length = self.length_s(moving)
        found = window_result(self.prepared, moving, length, self.seed, geometry, params, standing)
        return found.value_j
