"""The lattice of counts on which windows are aligned: who may run when, and the least times.

A point counts the trajectories that each robot has finished; a move is one window and advances
some of the robots by one. Robot r may run its k-th trajectory only where every robot s has
finished at least need[r, k, s] (hand-overs).
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from dmoc.jit import njit

Point = tuple[int, ...]
Moves = dict[Point, list[tuple[Point, float]]]


def needs_of(
    counts: Sequence[int], handovers: Sequence[tuple[tuple[int, int], tuple[int, int]]]
) -> np.ndarray:
    """need (R, longest, R) of hand-overs ((robot, k), (robot, k))."""
    need = np.zeros((len(counts), max(counts), len(counts)), dtype=np.int64)
    for (source, k), (target, later) in handovers:
        need[target, later, source] = max(need[target, later, source], k + 1)
    return need


@njit
def _sweep(counts, padded, need, forward, out):
    """Least time from the first point to each (forward) or from each to the last: out (points,)."""
    robots = counts.shape[0]
    strides = np.ones(robots, dtype=np.int64)
    for r in range(robots - 2, -1, -1):
        strides[r] = strides[r + 1] * (counts[r + 1] + 1)
    points = out.shape[0]
    out[:] = np.inf
    out[0 if forward else points - 1] = 0.0
    state = np.zeros(robots, dtype=np.int64)
    for index in range(points):
        at = index if forward else points - 1 - index
        rest = at
        for r in range(robots):
            state[r] = rest // strides[r]
            rest -= state[r] * strides[r]
        for move in range(1, 1 << robots):
            after = at
            length = 0.0
            allowed = True
            for r in range(robots):
                if not (move >> r) & 1:
                    continue
                if state[r] >= counts[r]:
                    allowed = False
                    break
                length = max(length, padded[r, state[r]])
                after += strides[r]
                for s in range(robots):
                    if state[s] < need[r, state[r], s]:
                        allowed = False
            if not allowed:
                continue
            if forward:
                out[after] = min(out[after], out[at] + length)
            else:
                out[at] = min(out[at], out[after] + length)


def least_times(
    durations_s: Sequence[Sequence[float]], need: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least time to every point and from every point to the end, inf where there is no way."""
    counts = np.array([len(row) for row in durations_s], dtype=np.int64)
    padded = np.zeros((len(counts), int(counts.max())))
    for r, row in enumerate(durations_s):
        padded[r, : len(row)] = row
    found = []
    for forward in (True, False):
        out = np.empty(int(np.prod(counts + 1)))
        _sweep(counts, padded, need, forward, out)
        found.append(out.reshape(tuple(counts + 1)))
    return found[0], found[1]


MOST_MOVES = 150_000


def moves_of(
    durations_s: Sequence[Sequence[float]],
    need: np.ndarray,
    ahead: np.ndarray,
    behind: np.ndarray,
    limit: float,
) -> tuple[Moves, bool]:
    """Every point on some way of at most `limit` seconds, with its moves on such ways; True.

    Where that may be more than `MOST_MOVES`, only points next to one quickest way; False.
    """
    counts = tuple(len(row) for row in durations_s)
    robots = range(len(counts))
    steps = [m for m in product((0, 1), repeat=len(counts)) if any(m)]

    def rows_at(state: Point) -> list[tuple[Point, float]]:
        rows = []
        for step in steps:
            running = [r for r in robots if step[r]]
            if any(state[r] >= counts[r] for r in running):
                continue
            if any(state[s] < need[r, state[r], s] for r in running for s in robots):
                continue
            length = max(float(durations_s[r][state[r]]) for r in running)
            after = tuple(k + m for k, m in zip(state, step))
            if ahead[state] + length + behind[after] <= limit:
                rows.append((step, length))
        return rows

    useful = np.flatnonzero(ahead + behind <= limit)
    whole = useful.size * len(steps) <= MOST_MOVES
    if whole:
        points = [tuple(map(int, np.unravel_index(k, ahead.shape))) for k in useful]
    else:
        near = set()
        shifts = [
            shift
            for shift in product((-1, 0, 1), repeat=len(counts))
            if len(counts) <= 3 or sum(map(abs, shift)) <= 1
        ]
        at: Point = (0,) * len(counts)
        while at != counts:
            for shift in shifts:
                point = tuple(k + d for k, d in zip(at, shift))
                if all(0 <= k <= n for k, n in zip(point, counts)):
                    near.add(point)
            at = min(
                (tuple(k + m for k, m in zip(at, step)) for step, _ in rows_at(at)),
                key=lambda after: (ahead[after] + behind[after], behind[after]),
            )
        points = sorted(point for point in near if ahead[point] + behind[point] <= limit)
    found = {point: rows for point in points if (rows := rows_at(point))}
    return found, whole


def band(moves: Moves, counts: Point, most: int) -> tuple[Moves, bool]:
    """All moves if they are at most `most`, else those near the quickest way; True if all."""
    total = sum(len(rows) for rows in moves.values())
    if total <= most:
        return moves, True
    path, states = np.array(_quickest(moves, counts)), np.array(list(moves))
    gap = np.abs(path[0] - states).max(axis=1)
    for point in path[1:]:
        gap = np.minimum(gap, np.abs(point - states).max(axis=1))
    far = dict(zip(moves, gap.tolist()))
    chosen: Moves = {}
    for width in range(max(far.values()) + 1):
        inside = {state: moves[state] for state in moves if far[state] <= width}
        if chosen and sum(len(rows) for rows in inside.values()) > most:
            break
        chosen = inside
    return chosen, False


def _quickest(moves: Moves, counts: Point) -> list[Point]:
    best: dict[Point, tuple[float, Point | None]] = {(0,) * len(counts): (0.0, None)}
    for state in sorted(moves, key=lambda point: (sum(point), point)):
        if state not in best:
            continue
        for step, length in moves[state]:
            after = tuple(k + m for k, m in zip(state, step))
            value = best[state][0] + length
            if after not in best or value < best[after][0] - 1e-12:
                best[after] = (value, state)
    path: list[Point] = []
    at: Point | None = counts
    while at is not None:
        path.append(at)
        at = best[at][1]
    return path[::-1]
