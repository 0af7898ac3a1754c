"""The first level (the DTO paper's SCO): which trajectories share a window, and in which order.

The overall energy of a window depends on who brakes while whom accelerates. Two freedoms:

* *alignment*: each robot keeps its order; a window advances some robots by one trajectory and lets
  the others wait. A cheapest path through the lattice of counts is found exactly.
* *order*: jobs (runs of trajectories that begin and end at one joint vector) are exchanged within a
  robot. Few jobs are enumerated, many are searched by exchanges, always within hand-overs.

Windows are valued by their optimised energy without collisions (an estimate of the second level)
plus the cost of time. Memory and work grow with the product of the robots' counts: a few hundred
lattice points are exact in seconds, the search is meant for the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from dmoc.errors import Fault, ProblemError

__all__ = ["Alignment", "align_exact", "order_exact", "order_search"]

WindowCost = Callable[[tuple[int | None, ...]], float]
"""Energy [J] of a window; entry r is robot r's trajectory (its own count) or None if it waits."""


@dataclass(frozen=True)
class Alignment:
    """`windows`: one tuple of own counts (or None) a window; `cost_j` their sum."""

    windows: tuple[tuple[int | None, ...], ...]
    cost_j: float


def align_exact(
    counts: Sequence[int],
    cost: WindowCost,
    handovers: Sequence[tuple[tuple[int, int], tuple[int, int]]] = (),
    most_points: int = 20_000,
) -> Alignment:
    """The cheapest alignment, proven: shortest path over all (k_1, .., k_R), k_r <= counts[r].

    `handovers` are ((robot, k), (robot, k)) pairs; the second may only run in a later window.
    Raises `ProblemError` where the lattice is larger than `most_points`.
    """
    shape = tuple(n + 1 for n in counts)
    points = int(np.prod(shape))
    if points > most_points:
        raise ProblemError(
            Fault("lattice-size", "", "counts", f"{points} points", f"<= {most_points}",
                  "use order_search, or align fewer trajectories at a time")
        )  # fmt: skip
    best = np.full(shape, np.inf)
    best[(0,) * len(counts)] = 0.0
    came: dict[tuple[int, ...], tuple[int, ...]] = {}
    moves = [m for m in product((0, 1), repeat=len(counts)) if any(m)]
    # Every move raises the sum of the counts, so this order visits predecessors first.
    for state in sorted(product(*(range(n) for n in shape)), key=sum):
        if not np.isfinite(best[state]):
            continue
        for move in moves:
            after = tuple(k + m for k, m in zip(state, move))
            if any(k > n for k, n in zip(after, counts)) or not _allowed(state, move, handovers):
                continue
            window = tuple(k if m else None for k, m in zip(state, move))
            value = best[state] + cost(window)
            if value < best[after]:
                best[after] = value
                came[after] = state
    end = tuple(counts)
    if not np.isfinite(best[end]):
        raise ProblemError(
            Fault(
                "alignment", "", "handovers", "no order keeps them", "hand-overs without a circle"
            )
        )
    windows: list[tuple[int | None, ...]] = []
    at = end
    while any(at):
        before = came[at]
        windows.append(tuple(k if k < n else None for k, n in zip(before, at)))
        at = before
    return Alignment(tuple(windows[::-1]), float(best[end]))


def _allowed(
    state: tuple[int, ...],
    move: tuple[int, ...],
    handovers: Sequence[tuple[tuple[int, int], tuple[int, int]]],
) -> bool:
    """The window runs no target of a hand-over whose source is not yet done."""
    for (source, k), (target, later) in handovers:
        if move[target] and state[target] == later and state[source] <= k:
            return False
    return True


def order_exact(
    jobs: Sequence[int], cost: Callable[[tuple[tuple[int, ...], ...]], float], most: int = 50_000
) -> tuple[tuple[tuple[int, ...], ...], float]:
    """All orders of each robot's jobs, the first robot's kept (only the relative order counts).

    `cost` maps one order per robot to joules, inf where a hand-over breaks; proven by enumeration.
    """
    total = int(np.prod([_factorial(n) for n in jobs[1:]]))
    if total > most:
        raise ProblemError(
            Fault("orders", "", "jobs", f"{total} orders", f"<= {most}", "use order_search")
        )
    first = tuple(range(jobs[0]))
    best, value = (first,) * len(jobs), np.inf
    for rest in product(*(permutations(range(n)) for n in jobs[1:])):
        found = cost((first, *rest))
        if found < value:
            best, value = (first, *rest), found
    return best, float(value)


def order_search(
    jobs: Sequence[int],
    cost: Callable[[tuple[tuple[int, ...], ...]], float],
    seed: int,
    rounds: int = 4000,
) -> tuple[tuple[tuple[int, ...], ...], float]:
    """Exchanges of two jobs of one robot, accepted like simulated annealing; best order met."""
    rng = np.random.default_rng(seed)
    orders = [list(range(n)) for n in jobs]
    value = cost(tuple(map(tuple, orders)))
    best, best_value = tuple(map(tuple, orders)), value
    movable = [r for r, n in enumerate(jobs) if n > 1]
    scale = 0.1 * abs(value) if np.isfinite(value) else 1.0
    for k in range(rounds if movable else 0):
        r = movable[int(rng.integers(len(movable)))]
        i, j = rng.choice(jobs[r], size=2, replace=False)
        orders[r][i], orders[r][j] = orders[r][j], orders[r][i]
        found = cost(tuple(map(tuple, orders)))
        heat = scale * (1.0 - k / rounds) + 1e-12
        if found <= value or rng.random() < np.exp(min(0.0, (value - found) / heat)):
            value = found
            if value < best_value:
                best, best_value = tuple(map(tuple, orders)), value
        else:
            orders[r][i], orders[r][j] = orders[r][j], orders[r][i]
    return best, float(best_value)


def _factorial(n: int) -> int:
    return int(np.prod(np.arange(1, n + 1), dtype=float))
