"""Do two robots' schedules cross a blocked cell? An exact walk through coordination maps.

Between events (a start or an end of a trajectory) both path times grow linearly, so the schedule
is a polyline through the maps; every cell that it touches is looked up. A robot that waits stays
at the end of its last trajectory (at the start of the first before it begins).
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dmoc.jit import njit
from sequencing.timing.clearance.coordination import CoordinationMap

FREE, UNKNOWN = -1, -2


@njit
def _walk(blocked, u0, v0, u1, v1):
    """True if the segment (u0, v0)-(u1, v1), in cells and growing, touches only free cells."""
    cells = blocked.shape[0]
    i = min(int(u0), cells - 1)
    j = min(int(v0), cells - 1)
    i_end = min(int(u1), cells - 1)
    j_end = min(int(v1), cells - 1)
    du = u1 - u0
    dv = v1 - v0
    while True:
        if blocked[i, j]:
            return False
        if i >= i_end and j >= j_end:
            return True
        at_u = (i + 1 - u0) / du if i < i_end else np.inf
        at_v = (j + 1 - v0) / dv if j < j_end else np.inf
        if at_u <= at_v:
            i += 1
        else:
            j += 1


@njit
def _phase(t, start, override, duration):
    return min(max((t - start) * override, 0.0), duration)


@njit
def pair_kernel(start, override, duration, maps, total, found):
    """Count of colliding pairs put into `found` (most, 2), or -1 if found[0] has no map yet."""
    a0, a1, b0, b1, index, blocks = maps
    a, b = a0, b0
    count = 0
    t = 0.0
    edges = np.empty(6)
    while True:
        until = total
        if a + 1 < a1:
            until = min(until, start[a + 1])
        if b + 1 < b1:
            until = min(until, start[b + 1])
        which = index[a - a0, b - b0]
        if which == -2:
            found[0, 0], found[0, 1] = a, b
            return -1
        if which >= 0 and until > t:
            edges[0] = t
            edges[1] = start[a]
            edges[2] = start[a] + duration[a] / override[a]
            edges[3] = start[b]
            edges[4] = start[b] + duration[b] / override[b]
            edges[5] = until
            for m in range(6):
                edges[m] = min(max(edges[m], t), until)
            for m in range(1, 6):  # six numbers: sorted by insertion
                value = edges[m]
                k = m
                while k > 0 and edges[k - 1] > value:
                    edges[k] = edges[k - 1]
                    k -= 1
                edges[k] = value
            block = blocks[which]
            cells = block.shape[0]
            for m in range(5):
                if edges[m + 1] <= edges[m] and m > 0:
                    continue
                u0 = _phase(edges[m], start[a], override[a], duration[a]) * cells / duration[a]
                u1 = _phase(edges[m + 1], start[a], override[a], duration[a]) * cells / duration[a]
                v0 = _phase(edges[m], start[b], override[b], duration[b]) * cells / duration[b]
                v1 = _phase(edges[m + 1], start[b], override[b], duration[b]) * cells / duration[b]
                if not _walk(block, u0, v0, u1, v1):
                    found[count, 0], found[count, 1] = a, b
                    count += 1
                    break
        if until >= total or count == found.shape[0]:
            return count
        if a + 1 < a1 and start[a + 1] <= until:
            a += 1
        if b + 1 < b1 and start[b + 1] <= until:
            b += 1
        t = max(t, until)


@njit
def many_kernel(timing, duration, maps, total, begin, free, found):
    """Clear `free` (P,) where timing (P, 2, S) collides; P, or the one that lacks the map found."""
    for p in range(begin, timing.shape[0]):
        if not free[p]:
            continue
        start, override = timing[p, 0], timing[p, 1]
        count = pair_kernel(start, override, duration, maps, total, found)
        if count < 0:
            return p
        free[p] = count == 0
    return timing.shape[0]


@dataclass(eq=False)
class PairMaps:
    """Maps of one pair of robots, filled on demand: trajectory k of the one, l of the other."""

    first: tuple[int, int]
    second: tuple[int, int]
    build: Callable[[int, int], CoordinationMap]
    index: np.ndarray = field(init=False)
    blocks: list[np.ndarray] = field(default_factory=list)
    stacked: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        shape = (self.first[1] - self.first[0], self.second[1] - self.second[0])
        self.index = np.full(shape, UNKNOWN, dtype=np.int64)
        self.stacked = np.zeros((0, 2, 2), dtype=np.uint8)

    @property
    def arrays(self) -> tuple[int | np.ndarray, ...]:
        """What the kernels read."""
        return (*self.first, *self.second, self.index, self.stacked)

    def fill(self, a: int, b: int) -> None:
        """Build the map of trajectories a and b (flat indices)."""
        found = self.build(a, b)
        key = (a - self.first[0], b - self.second[0])
        if found.blocked is None:
            self.index[key] = FREE
            return
        self.index[key] = len(self.blocks)
        self.blocks.append(found.blocked)
        self.stacked = np.stack(self.blocks)


class Crossings:
    """All pairs of robots of a cell; `free` is a `FreeCheck` for the search.

    `held_s` gives the columns of trajectories that nobody runs (a robot that waits through a
    window) a start before or after everything, which keeps them at their end or at their start.
    """

    def __init__(
        self,
        pairs: list[PairMaps],
        duration_s: np.ndarray,
        total_s: float,
        held_s: Mapping[int, float] | None = None,
    ) -> None:
        self.pairs, self.duration_s, self.total_s = pairs, duration_s, total_s
        self.held_s = dict(held_s or {})

    def collisions(self, start_s: np.ndarray, override: np.ndarray) -> list[tuple[int, int]]:
        """Pairs of trajectories (a, b), of two robots, that may meet; [] proves the timing free."""
        start, speed = self._hold(np.array([[start_s, override]], dtype=float))[0]
        pairs: set[tuple[int, int]] = set()
        for pair in self.pairs:
            found = np.empty((pair.index.size, 2), dtype=np.int64)
            count = self._check(pair, start, speed, found)
            pairs |= {(int(a), int(b)) for a, b in found[:count]}
        return sorted(pairs)[:10_000]

    def free(self, timing: np.ndarray) -> np.ndarray:
        """(P,) True where timing (P, 2, S) touches free cells only."""
        held = self._hold(np.ascontiguousarray(timing, dtype=float))
        out = np.ones(len(held), dtype=np.bool_)
        found = np.empty((1, 2), dtype=np.int64)
        for pair in self.pairs:
            at = 0
            while at < len(held):
                at = many_kernel(held, self.duration_s, pair.arrays, self.total_s, at, out, found)
                if at < len(held):
                    pair.fill(int(found[0, 0]), int(found[0, 1]))
        return out

    def _hold(self, timing: np.ndarray) -> np.ndarray:
        if not self.held_s:
            return timing
        held = timing.copy()
        for k, begin in self.held_s.items():
            held[:, 0, k], held[:, 1, k] = begin, 1.0
        return held

    def _check(
        self, pair: PairMaps, start: np.ndarray, speed: np.ndarray, found: np.ndarray
    ) -> int:
        while True:
            count = pair_kernel(start, speed, self.duration_s, pair.arrays, self.total_s, found)
            if count >= 0:
                return int(count)
            pair.fill(int(found[0, 0]), int(found[0, 1]))
