"""Jobs of a robot whose order is free, and a cell with its trajectories in another order.

A job is a run of trajectories from one joint vector back to it, the one that the robot visits most
often. What comes before the first visit and after the last one stays where it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sequencing.timing.cell.types import Cell, CellRobot
from sequencing.timing.search.prepared import PreparedCell
from sequencing.timing.search.windows import Timing

_SAME_RAD = 1e-3


@dataclass(frozen=True)
class Jobs:
    """Own counts of a robot's trajectories: `lead`, then the jobs in any order, then `trail`."""

    lead: tuple[int, ...]
    jobs: tuple[tuple[int, ...], ...]
    trail: tuple[int, ...]

    def arranged(self, order: Sequence[int]) -> tuple[int, ...]:
        """Own counts with the jobs in `order`."""
        return (*self.lead, *itertools.chain(*(self.jobs[k] for k in order)), *self.trail)


def jobs_of(robot: CellRobot) -> Jobs:
    """The jobs of `robot`; a single one where its order is given or it never comes back."""
    size = len(robot.trajectories)
    whole = Jobs((), (tuple(range(size)),), ())
    if not robot.free_order:
        return whole
    stops = np.array([robot.trajectories[0].q_rad[0], *[t.q_rad[-1] for t in robot.trajectories]])
    same = np.abs(stops[:, None] - stops[None]).max(axis=2) <= _SAME_RAD
    visits = np.flatnonzero(same[int(np.argmax(same.sum(axis=1)))])
    if len(visits) < 3:
        return whole
    cuts = [range(a, b) for a, b in itertools.pairwise(visits.tolist())]
    return Jobs(
        tuple(range(visits[0])), tuple(map(tuple, cuts)), tuple(range(int(visits[-1]), size))
    )


def in_order(cell: Cell, order: Sequence[Sequence[int]]) -> list[int]:
    """Numbers of all trajectories, robot by robot, each robot's own counts in `order`."""
    return [first + k for first, own in zip(cell.first, order) for k in own]


def rearranged(prepared: PreparedCell, order: Sequence[Sequence[int]]) -> PreparedCell:
    """The same cell with each robot's trajectories (own counts) in `order`, numbered anew."""
    cell = prepared.cell
    parts = ("trajectories", "loaded", "labels", "pause_s", "wrench")

    def arranged(item: CellRobot, own: Sequence[int]) -> CellRobot:
        changes: dict[str, Any] = {p: tuple(getattr(item, p)[k] for k in own) for p in parts}
        return replace(item, **changes)

    robots = tuple(map(arranged, cell.robots, order))
    numbers = in_order(cell, order)
    new = {old: k for k, old in enumerate(numbers)}
    handovers = tuple((new[a], new[b]) for a, b in cell.handovers)
    return PreparedCell(
        replace(cell, robots=robots, handovers=handovers),
        tuple(prepared.paths[k] for k in numbers),
        tuple(prepared.tables[k] for k in numbers),
    )


def in_given_numbers(timing: Timing, numbers: Sequence[int]) -> Timing:
    """A timing of the rearranged cell in the numbers of the given one."""
    start, override = np.empty_like(timing.start_s), np.empty_like(timing.override)
    start[list(numbers)], override[list(numbers)] = timing.start_s, timing.override
    return replace(timing, start_s=start, override=override)
