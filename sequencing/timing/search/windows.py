"""Ways to time a cell: as fast as possible, stretched, window by window, and all at once.

A *window* k lets every robot run its k-th trajectory; all begin together, and the next window
begins when the slowest (critical) robot, which is never slowed down, has ended. This is the DTO
paper's sub-problem. The *general* problem has no windows: only each robot's order, the
hand-overs, and the same end of the process.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmoc.swarm import SwarmParams
from sequencing.timing.cell.types import Cell
from sequencing.timing.power.along_path import MIN_OVERRIDE
from sequencing.timing.search.optimise import (
    DEFAULT_SEARCH,
    SearchParams,
    TimingResult,
    optimise_timing,
)
from sequencing.timing.search.prepared import Geometry, PreparedCell
from sequencing.timing.search.slack import SlackGraph, decode, encode, slack_graph

ROUNDS = 4000


def separated_timing(prepared: PreparedCell, geometry: Geometry, fast: Timing) -> Timing:
    """Full speed; of two trajectories that would meet, the one that begins later waits longer.

    Starting from as-early-as-possible, the earliest meeting is mended first, a tenth of a second
    at a time, and everything after it is pushed back; the process gets as much longer as that
    takes. After `ROUNDS`, or when one wait passes a minute (robots that block each other at rest
    cannot be parted by waiting), `fast` is returned as it was: the caller's check decides.
    """
    cell = prepared.cell
    first = cell.first
    pauses = [robot.pause_s for robot in cell.robots]
    size = first[-1]
    flat = np.array([t for row in cell.durations_s for t in row])
    wait = np.zeros(size)
    graph = slack_graph(cell.durations_s, cell.handovers, None, None, pauses)
    step = 0.1
    for _ in range(ROUNDS):
        start, total = _earliest(graph, flat, wait, pauses)
        timing = Timing(start, np.ones(size), total)
        crossings = geometry.crossings(total)
        meeting = crossings.collisions(start, np.ones(size))
        if geometry.sharpen(meeting):
            continue
        if not meeting:
            return timing
        # The earliest meeting is mended first, by delaying the one that begins later.
        a, b = min(meeting, key=lambda pair: max(start[pair[0]], start[pair[1]]))
        late = a if (start[a], a) > (start[b], b) else b
        wait[late] += step
        if wait[late] > 60.0:
            break
    return fast


def _earliest(
    graph: SlackGraph, flat: np.ndarray, wait: np.ndarray, pauses: list[tuple[float, ...]]
) -> tuple[np.ndarray, float]:
    start = np.zeros(flat.size)
    end = np.zeros(flat.size)
    for k in graph.order:
        early = 0.0
        for m in range(graph.pred_at[k], graph.pred_at[k + 1]):
            early = max(early, end[graph.pred[m]] + graph.lag_s[m])
        start[k] = early + wait[k]
        end[k] = start[k] + flat[k]
    after = np.array([t for row in pauses for t in row])
    return start, float((end + after).max())


_SWARM_VARIABLES = 40  # more, and a swarm finds nothing in reasonable time


@dataclass(frozen=True, eq=False)
class Timing:
    """Starts [s] and overrides (S,) of all trajectories, and the end of the process [s]."""

    start_s: np.ndarray
    override: np.ndarray
    total_s: float
    evaluations: int = 0


@dataclass(frozen=True, eq=False)
class Windows:
    """`numbers`: the trajectories of each window, at most one a robot; `edges_s` (W+1,) [s].

    `standing` has, for each window, the robots that wait through it: (trajectory, True if they
    stand at its end, False if at its start).
    """

    numbers: tuple[tuple[int, ...], ...]
    edges_s: np.ndarray
    standing: tuple[tuple[tuple[int, bool], ...], ...]


def make_windows(
    prepared: PreparedCell,
    groups: Sequence[Sequence[int]] | None = None,
    total_s: float | None = None,
) -> Windows | None:
    """Windows of the k-th trajectories, or of given `groups`; None where they do not fit.

    They fit if no robot has to stand still after a trajectory and every hand-over leads from an
    earlier window to a later one. Each is as long as its longest trajectory; what `total_s` leaves
    over is shared out among them in proportion.
    """
    cell = prepared.cell
    first = cell.first
    if any(pause > 0 for robot in cell.robots for pause in robot.pause_s):
        return None
    if groups is None:
        sizes = [len(robot.trajectories) for robot in cell.robots]
        groups = [
            [first[r] + k for r, size in enumerate(sizes) if k < size] for k in range(max(sizes))
        ]
    window_of = {number: w for w, group in enumerate(groups) for number in group}
    if any(window_of[a] >= window_of[b] for a, b in cell.handovers):
        return None
    flat = np.array([t for row in cell.durations_s for t in row])
    edges = np.concatenate([[0.0], np.cumsum([flat[list(group)].max() for group in groups])])
    if total_s is not None and total_s > edges[-1] * (1.0 + 1e-12):
        edges *= total_s / edges[-1]
    return Windows(tuple(map(tuple, groups)), edges, standing_of(owners(cell), groups))


def owners(cell: Cell) -> list[int]:
    """The robot of every trajectory, by number."""
    return [r for r, robot in enumerate(cell.robots) for _ in robot.trajectories]


def standing_of(
    owner: Sequence[int], groups: Sequence[Sequence[int]]
) -> tuple[tuple[tuple[int, bool], ...], ...]:
    """Who waits through each window, and where: at the end of the last, or before the first."""
    place: dict[int, tuple[int, bool]] = {}
    for group in groups:
        for k in group:
            place.setdefault(owner[k], (k, False))
    rows = []
    for group in groups:
        moving = {owner[k]: k for k in group}
        rows.append(tuple(place[r] for r in sorted(place) if r not in moving))
        for r, k in moving.items():
            place[r] = (k, True)
    return tuple(rows)


def whole_graph(
    prepared: PreparedCell,
    total_s: float | None,
    fixed: dict[int, tuple[float, float]] | None = None,
) -> SlackGraph:
    """The general problem's graph."""
    cell = prepared.cell
    pauses = [robot.pause_s for robot in cell.robots]
    return slack_graph(cell.durations_s, cell.handovers, total_s, fixed, pauses)


def fast_timing(
    prepared: PreparedCell, windows: Windows | None, total_s: float | None = None
) -> Timing:
    """Every trajectory at full speed, as early as its window (or its predecessors) allow.

    Without windows the process ends with its last trajectory, or at `total_s`.
    """
    size = prepared.cell.first[-1]
    if windows is None:
        graph = whole_graph(prepared, total_s)
        start, override = decode(graph, np.zeros((2, size)))
        return Timing(start, override, graph.total_s)
    start = np.zeros(size)
    for w, group in enumerate(windows.numbers):
        start[list(group)] = windows.edges_s[w]
    return Timing(start, np.ones(size), float(windows.edges_s[-1]))


def stretched_timing(prepared: PreparedCell, windows: Windows | None, total_s: float) -> Timing:
    """Slowed down as far as the window allows, without waiting; else evenly over the slack."""
    fast = fast_timing(prepared, windows)
    flat = np.array([t for row in prepared.cell.durations_s for t in row])
    if windows is None:
        graph = whole_graph(prepared, total_s)
        z = np.zeros((2, flat.size))
        # The k-th of n remaining trajectories takes 1/n of the slack that is left.
        first = prepared.cell.first
        for a, b in itertools.pairwise(first):
            z[0, a:b] = 1.0 / np.arange(b - a, 0, -1)
        start, override = decode(graph, z)
        return Timing(start, override, graph.total_s)
    lengths = np.ones(flat.size)
    for w, group in enumerate(windows.numbers):
        lengths[list(group)] = windows.edges_s[w + 1] - windows.edges_s[w]
    override = np.clip(flat / lengths, MIN_OVERRIDE, 1.0)
    return Timing(fast.start_s, override, fast.total_s)


def window_timing(
    prepared: PreparedCell,
    windows: Windows,
    seed: int,
    geometry: Geometry | None,
    params: SearchParams = DEFAULT_SEARCH,
) -> Timing:
    """Each window optimised by itself; `geometry` None ignores collisions.

    A window without an allowed schedule keeps the fast one; the final check will name it.
    """
    fast = fast_timing(prepared, windows)
    start, override = fast.start_s.copy(), fast.override.copy()
    seeds = np.random.default_rng(seed).integers(2**31, size=len(windows.numbers))
    evaluations = 0
    for w, group in enumerate(windows.numbers):
        numbers = list(group)
        length = float(windows.edges_s[w + 1] - windows.edges_s[w])
        result = window_result(
            prepared, numbers, length, int(seeds[w]), geometry, params, windows.standing[w]
        )
        evaluations += result.evaluations
        if np.isfinite(result.value_j):
            start[numbers] = windows.edges_s[w] + result.start_s
            override[numbers] = result.override
    return Timing(start, override, fast.total_s, evaluations)


def window_result(
    prepared: PreparedCell,
    numbers: Sequence[int],
    length_s: float,
    seed: int,
    geometry: Geometry | None,
    params: SearchParams,
    standing: Sequence[tuple[int, bool]] = (),
) -> TimingResult:
    """One window: the trajectories `numbers`, one a robot, within `length_s`.

    The robots of `standing` wait through it; starts and overrides (S,) are those of `numbers`.
    """
    every = [*numbers, *(k for k, _ in standing)]
    line = prepared.window(numbers, length_s, standing=standing)
    graph = window_graph([prepared.tables[k].duration_s for k in numbers], len(standing), length_s)
    relaxed = optimise_timing(line, graph, seed, None, params)
    if geometry is None:
        return _without_standing(relaxed, len(numbers))
    # Where capsules are in the way of the best timing, see whether the solids are.
    check = geometry.window(numbers, length_s, standing)
    meeting = check.collisions(relaxed.start_s, relaxed.override)
    while meeting and geometry.sharpen(
        [(min(every[a], every[b]), max(every[a], every[b])) for a, b in meeting]
    ):
        check = geometry.window(numbers, length_s, standing)
        meeting = check.collisions(relaxed.start_s, relaxed.override)
    if meeting:
        relaxed = optimise_timing(line, graph, seed, check.free, params)
    return _without_standing(relaxed, len(numbers))


def window_graph(durations_s: Sequence[float], standing: int, length_s: float) -> SlackGraph:
    """The box of one window: trajectories without slack and robots that stand are not variables."""
    lengths = [*durations_s, *([length_s] * standing)]
    tight = {k: (0.0, t) for k, t in enumerate(lengths) if length_s - t <= 1e-12 * length_s}
    return slack_graph([[t] for t in lengths], (), length_s, tight)


def _without_standing(found: TimingResult, moving: int) -> TimingResult:
    return replace(found, start_s=found.start_s[:moving], override=found.override[:moving])


_THAWS = 12  # rounds of optimising, putting back and freezing


def general_timing(
    prepared: PreparedCell,
    start: Timing,
    seed: int,
    geometry: Geometry | None,
    others: Sequence[Timing] = (),
) -> Timing:
    """The general problem, from an allowed schedule that it never becomes worse than.

    Gradient descent over everything from `start` and from `others` (any schedules of the same total
    time); trajectories that then meet are put back to where `start` has them and frozen, and the
    rest is optimised again, until what remains is an allowed schedule. Where that froze something
    and the cell is small, the swarm then looks for a way round the collisions.
    """
    found, frozen = _thawed(prepared, start, seed, geometry, others)
    size = prepared.cell.first[-1]
    if geometry is None or not frozen or 2 * size > _SWARM_VARIABLES:
        return found
    graph = whole_graph(prepared, start.total_s)
    line, crossings = prepared.timeline(start.total_s), geometry.crossings(start.total_s)
    begin = [encode(graph, t.start_s, t.override) for t in (found, start)]
    params = replace(DEFAULT_SEARCH, method="swarm", swarm=SwarmParams(particles=24, iterations=60))
    around = optimise_timing(line, graph, seed, crossings.free, params, np.array(begin))
    spent = found.evaluations + around.evaluations
    if not np.isfinite(around.value_j):
        return replace(found, evaluations=spent)
    return Timing(around.start_s, around.override, start.total_s, spent)


def _thawed(
    prepared: PreparedCell,
    start: Timing,
    seed: int,
    geometry: Geometry | None,
    others: Sequence[Timing],
) -> tuple[Timing, int]:
    """Gradient descent with freezing, see `general_timing`: an allowed schedule and how many
    trajectories it had to hold in place."""
    first = SearchParams(method="gradient", gradient_starts=6, gradient_iterations=150)
    later = replace(first, gradient_starts=1)
    line = prepared.timeline(start.total_s)
    crossings = None if geometry is None else geometry.crossings(start.total_s)
    flat = np.array([t for row in prepared.cell.durations_s for t in row])
    frozen: dict[int, tuple[float, float]] = {}
    best = start
    spent = 0
    for k in range(_THAWS):
        graph = whole_graph(prepared, start.total_s, frozen)
        # Once somebody is frozen, the last answer is the start that it is worth going on from.
        tried = (start, *others) if k == 0 else (start, best)
        begin = [encode(graph, t.start_s, t.override) for t in tried]
        params = first if k == 0 else later
        found = optimise_timing(line, graph, seed, None, params, np.array(begin))
        spent += found.evaluations
        best = Timing(found.start_s, found.override, start.total_s, spent)
        meeting = [] if crossings is None else crossings.collisions(best.start_s, best.override)
        if geometry is not None and geometry.sharpen(meeting):
            crossings = geometry.crossings(start.total_s)
            meeting = crossings.collisions(best.start_s, best.override)
        if not meeting:
            return best, len(frozen)
        grown = {k for pair in meeting for k in pair}
        if grown <= set(frozen):
            # They stand where they did, so somebody left earlier or later: hold the neighbours too.
            grown |= {k + d for k in grown for d in (-1, 1) if 0 <= k + d < flat.size}
        if grown <= set(frozen):
            break
        for k in grown:
            frozen[k] = (float(start.start_s[k]), float(flat[k] / start.override[k]))
    return replace(start, evaluations=spent), len(frozen)
