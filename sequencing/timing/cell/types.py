"""What a cell is: robots with their fixed paths, what surrounds them, hand-overs, DC links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmoc.errors import ProblemError
from dmoc.motion.trajectory import JointTrajectory
from dmoc.order_graph import circle_of, in_order
from dmoc.robot.robot import Robot
from planning.geometry.shapes import Body
from sequencing.timing.power.dc_link import LinkParams


@dataclass(frozen=True, eq=False)
class CellRobot:
    """One robot of a cell and its trajectories in order.

    `loaded` holds the robot with the payload that it carries on each trajectory, `wrench` the
    external force and torque (6,) [N, Nm] on its flange (world axes, None: nothing), `pause_s` how
    long it stands still after each (welding). All tuples have one entry a trajectory; `wrench` may
    be left out. `free_order`: its jobs may be exchanged (see `jobs`). `fixtures` are the solids of
    its own station, which its paths keep clear of, and which the other robots must too.
    """

    name: str
    robot: Robot
    tool_bodies: tuple[Body, ...]
    trajectories: tuple[JointTrajectory, ...]
    loaded: tuple[Robot, ...]
    labels: tuple[str, ...]
    pause_s: tuple[float, ...]
    wrench: tuple[np.ndarray | None, ...] = ()
    free_order: bool = False
    fixtures: tuple[Body, ...] = ()

    def __post_init__(self) -> None:
        if not self.wrench:
            object.__setattr__(self, "wrench", (None,) * len(self.trajectories))


@dataclass(frozen=True, eq=False)
class Cell:
    """A frozen scheduling problem; trajectories are numbered through, robot by robot.

    `handovers` are pairs (from, to) of these numbers; `link_of` names each robot's entry in
    `links`. `base_load_w` is a constant consumption on the grid side.
    """

    name: str
    robots: tuple[CellRobot, ...]
    obstacles: tuple[Body, ...]
    handovers: tuple[tuple[int, int], ...]
    links: tuple[LinkParams, ...]
    link_of: tuple[int, ...]
    base_load_w: float
    clearance_m: float

    @property
    def first(self) -> tuple[int, ...]:
        """Number of each robot's first trajectory, and the number of all at the end."""
        edges = [0]
        for robot in self.robots:
            edges.append(edges[-1] + len(robot.trajectories))
        return tuple(edges)

    @property
    def durations_s(self) -> list[list[float]]:
        """Nominal durations [s], robot by robot."""
        return [[t.duration_s for t in robot.trajectories] for robot in self.robots]

    def owner(self, number: int) -> tuple[int, int]:
        """(robot, its own count) of a trajectory's number."""
        robot = max(r for r, first in enumerate(self.first[:-1]) if first <= number)
        return robot, number - self.first[robot]


def predecessors(sizes: Sequence[int], handovers: Sequence[tuple[int, int]]) -> list[list[int]]:
    """What each trajectory waits for: the one before it of its robot, and hand-overs to it."""
    preds: list[list[int]] = [[] for _ in range(sum(sizes))]
    at = 0
    for size in sizes:
        for k in range(at + 1, at + size):
            preds[k].append(k - 1)
        at += size
    for source, target in handovers:
        if source not in preds[target]:
            preds[target].append(source)
    return preds


def waiting_order(preds: list[list[int]], names: Sequence[str] = ()) -> list[int]:
    """The trajectories, each after what it waits for; a circle raises `ProblemError` naming it."""
    pairs = [(p, k) for k, row in enumerate(preds) for p in row]
    circle = circle_of(pairs)
    if circle:
        raise ProblemError.of(
            "handover-circle",
            "",
            "handovers",
            " -> ".join(names[k] if names else str(k) for k in circle),
            "no circle of waiting",
            "remove one hand-over of the circle",
        )
    return in_order(range(len(preds)), pairs)
