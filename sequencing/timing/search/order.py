"""Searches of the first level: which trajectories share a window, and in which order jobs run.

Two freedoms, both over an abstract cost (see `levels` for what a window costs):

* *alignment*: each robot keeps its order; a window advances some robots by one trajectory while
  the others wait. `align` finds the cheapest path through the lattice of counts that needs no more
  time than allowed. Exact, unless more windows would have to be valued than `most_windows`: then
  it is exact within the widest band around the quickest path that stays below.
* *order*: jobs are exchanged within a robot. Few are enumerated, many are searched by exchanges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from dmoc.errors import ProblemError
from sequencing.timing.search.lattice import band, least_times, moves_of, needs_of

Handover = tuple[tuple[int, int], tuple[int, int]]
WindowCost = Callable[[tuple[int, ...], tuple[int, ...]], float]
"""Energy [J] of a window; `state` counts what each robot has done, `move` (0 or 1) who runs now."""

_MOST_LABELS = 64
_MOST_ROBOTS = 6  # a point of the lattice has 2^R - 1 moves


@dataclass(frozen=True)
class Alignment:
    """`windows`: one tuple of own counts (or None: waits) a window; `cost_j` their sum.

    `proven`: no alignment of the same cost function within the time is cheaper. `valued` windows
    were considered.
    """

    windows: tuple[tuple[int | None, ...], ...]
    cost_j: float
    duration_s: float
    proven: bool
    valued: int


MOST_POINTS = 2_000_000  # of a lattice
MOST_ORDERS = 20_000  # that are enumerated
EXCHANGES = 4000


def align(
    durations_s: Sequence[Sequence[float]],
    cost: WindowCost,
    handovers: Sequence[Handover] = (),
    total_s: float | None = None,
    most_windows: int = 1500,
) -> Alignment:
    """The cheapest sequence of windows that lasts at most `total_s` (None: any time).

    A window lasts as long as its longest trajectory. `handovers` are ((robot, k), (robot, k))
    pairs; the second may only run in a later window. Raises `ProblemError` where the lattice has
    more than `MOST_POINTS` points or more than six robots, where no alignment keeps the
    hand-overs, or where none is quick enough.
    """
    counts = tuple(len(row) for row in durations_s)
    points = int(np.prod([n + 1 for n in counts], dtype=float))
    if points > MOST_POINTS or len(counts) > _MOST_ROBOTS:
        raise ProblemError.of(
            "lattice-size",
            "",
            "durations_s",
            f"{points} points, {len(counts)} robots",
            f"<= {MOST_POINTS} points, <= {_MOST_ROBOTS} robots",
            "align fewer trajectories at a time",
        )
    need = needs_of(counts, handovers)
    ahead, behind = least_times(durations_s, need)
    least = float(ahead[counts])
    if not np.isfinite(least):
        raise ProblemError.of(
            "alignment",
            "",
            "handovers",
            "no order keeps them",
            "hand-overs without circle",
            "remove one hand-over of the circle",
        )
    limit = np.inf if total_s is None else total_s * (1.0 + 1e-9)
    if least > limit:
        raise ProblemError.of(
            "alignment-time",
            "",
            "total_s",
            f"{total_s:.6g} s",
            f">= {least:.6g} s",
            "windows need more time than that",
        )
    moves, whole = moves_of(durations_s, need, ahead, behind, limit)
    chosen, proven = band(moves, counts, most_windows)
    return _cheapest(counts, chosen, behind, limit, cost, proven and whole)


def _cheapest(
    counts: tuple[int, ...],
    moves: dict[tuple[int, ...], list[tuple[tuple[int, ...], float]]],
    behind: np.ndarray,
    limit: float,
    cost: WindowCost,
    proven: bool,
) -> Alignment:
    """Label setting over (time, cost): every point keeps the labels that no other one beats."""
    start = (0,) * len(counts)
    # label: time, cost, point before, its label
    labels: dict[tuple[int, ...], list[tuple[float, float, tuple[int, ...] | None, int]]]
    labels = {start: [(0.0, 0.0, None, 0)]}
    valued = 0
    for state in sorted(moves, key=lambda point: (sum(point), point)):
        mine = labels.get(state)
        if not mine:
            continue
        for move, length in moves[state]:
            value = cost(state, move)
            valued += 1
            after = tuple(k + m for k, m in zip(state, move))
            there = labels.setdefault(after, [])
            for index, (time_s, sum_j, _, _) in enumerate(mine):
                found = (time_s + length, sum_j + value, state, index)
                if found[0] + behind[after] <= limit and np.isfinite(value):
                    there.append(found)
            kept = _best_labels(there, np.isinf(limit))
            proven = proven and len(kept) <= _MOST_LABELS
            labels[after] = kept[:_MOST_LABELS]
    if not labels.get(counts):
        raise ProblemError.of(
            "alignment", "", "cost", "every alignment is forbidden", "an allowed one"
        )
    best = min(range(len(labels[counts])), key=lambda k: labels[counts][k][1])
    duration, total, state_before, index = labels[counts][best]
    windows: list[tuple[int | None, ...]] = []
    at = counts
    while state_before is not None:
        windows.append(tuple(k if k < n else None for k, n in zip(state_before, at)))
        at = state_before
        _, _, state_before, index = labels[at][index]
    return Alignment(tuple(windows[::-1]), float(total), float(duration), proven, valued)


def _best_labels(labels: list, any_time: bool) -> list:
    """Those that no other label beats in time and cost; the cheapest first."""
    if any_time:
        return sorted(labels, key=lambda label: label[1])[:1]
    kept: list = []
    quickest = np.inf
    for label in sorted(labels, key=lambda label: (label[1], label[0])):
        if label[0] < quickest - 1e-12:
            kept.append(label)
            quickest = label[0]
    return kept


Orders = tuple[tuple[int, ...], ...]


def order_exact(jobs: Sequence[int], cost: Callable[[Orders], float]) -> tuple[Orders, float]:
    """The cheapest of all orders of each robot's jobs (1 where a robot's order is given).

    `cost` maps one order per robot to joules, inf where it is forbidden; proven by enumeration.
    The given order comes first and is kept among equals. More than `MOST_ORDERS` raise
    `ProblemError`.
    """
    total = count_orders(jobs)
    if total > MOST_ORDERS:
        raise ProblemError.of(
            "orders", "", "jobs", f"{total:.0f} orders", f"<= {MOST_ORDERS}", "use order_search"
        )
    best: Orders = tuple(tuple(range(n)) for n in jobs)
    value = cost(best)
    for orders in product(*(permutations(range(n)) for n in jobs)):
        found = cost(orders)
        if found < value:
            best, value = orders, found
    return best, float(value)


def count_orders(jobs: Sequence[int]) -> float:
    """How many orders there are."""
    return float(np.prod([np.prod(np.arange(1, n + 1), dtype=float) for n in jobs]))


def order_search(
    jobs: Sequence[int],
    cost: Callable[[Orders], float],
    seed: int,
    start: Orders | None = None,
) -> tuple[Orders, float]:
    """Exchanges of two jobs of one robot, accepted like simulated annealing; best order met."""
    rng = np.random.default_rng(seed)
    given = start if start is not None else tuple(tuple(range(n)) for n in jobs)
    orders = [list(row) for row in given]
    value = cost(tuple(map(tuple, orders)))
    best, best_value = tuple(map(tuple, orders)), value
    movable = [r for r, n in enumerate(jobs) if n > 1]
    typical, count = 0.0, 0  # mean change of the cost by an exchange
    for k in range(EXCHANGES if movable else 0):
        r = movable[int(rng.integers(len(movable)))]
        i, j = rng.choice(jobs[r], size=2, replace=False)
        orders[r][i], orders[r][j] = orders[r][j], orders[r][i]
        found = cost(tuple(map(tuple, orders)))
        keep = found <= value
        if not keep and np.isfinite(found):
            count += 1
            typical += (found - value - typical) / count
            heat = typical * (1.0 - k / EXCHANGES) ** 2 + 1e-12
            keep = rng.random() < np.exp((value - found) / heat)
        if keep:
            value = found
            if value < best_value:
                best, best_value = tuple(map(tuple, orders)), value
        else:
            orders[r][i], orders[r][j] = orders[r][j], orders[r][i]
    return best, float(best_value)
