"""The last word on collisions: exact solids, continuous time, independent of coordination maps.

Two arms between two instants: if their solids at the middle are further apart than both can have
moved since (chain lengths times joint travel), no instant in between collides; otherwise the
interval is halved. An interval that shrinks below `_SHORTEST_S` is reported.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from planning.geometry.shapes import Body
from sequencing.timing.cell.types import Cell
from sequencing.timing.clearance.arms import ArmShapes, arm_shapes, body_shapes
from sequencing.timing.clearance.segments import segment_distances
from sequencing.timing.clearance.swept import joint_travel, reaches

_SHORTEST_S = 2e-4


@dataclass(frozen=True)
class Contact:
    """Two things that meet or cannot be proven apart at `time_s`; trajectories by number.

    `distance_m` is the exact distance there (<= 0: they overlap); `second` names the other robot or
    the obstacle.
    """

    time_s: float
    first: str
    second: str
    solids: tuple[str, str]
    distance_m: float

    def __str__(self) -> str:
        one, two = self.solids
        other = two if two == self.second else f"{self.second} {two}"
        return f"{self.time_s:.3f} s: {self.first} {one} and {other}"


class _Actor:
    """One arm on its schedule, or a set of obstacles that never move."""

    def __init__(self, name: str, robot: Robot | None, shapes: ArmShapes) -> None:
        self.name, self.robot, self.shapes = name, robot, shapes
        self.trajectories: Sequence[JointTrajectory] = ()
        self.start: np.ndarray = np.zeros(0)
        self.override: np.ndarray = np.ones(0)
        self._made: dict[int, coal.Transform3s] = {}
        if robot is not None:
            self.data = robot.model.createData()
            self.reach = reaches(robot, shapes)
        else:
            self.ends = shapes.ends_m

    def events(self) -> list[float]:
        ends = self.start + np.array([t.duration_s for t in self.trajectories]) / self.override
        return [*self.start, *ends] if len(self.start) else []

    def phase(self, t: float, k: int) -> float:
        s = (t - self.start[k]) * self.override[k]
        return float(min(max(s, 0.0), self.trajectories[k].duration_s))

    def active(self, t: float) -> int:
        return max(0, int(np.searchsorted(self.start, t, side="right")) - 1)

    def place(self, t: float) -> np.ndarray:
        """Capsule ends (C, 2, 3) in the world at time t."""
        self._made.clear()
        if self.robot is None:
            return self.ends
        k = self.active(t)
        trajectory = self.trajectories[k]
        bare = trajectory.on(None)
        q = bare.sample(trajectory.t_s[0] + self.phase(t, k)).q_rad[0]
        pin.forwardKinematics(self.robot.model, self.data, q)
        out = np.empty_like(self.shapes.ends_m)
        for c, j in enumerate(self.shapes.joint):
            pose = self.data.oMi[int(j)]
            out[c] = self.shapes.ends_m[c] @ pose.rotation.T + pose.translation
        return out

    def way(self, t0: float, t1: float) -> np.ndarray:
        """Bound (C,) on the way of any point between two times of one active trajectory."""
        if self.robot is None:
            return np.zeros(len(self.shapes.joint))
        k = self.active(0.5 * (t0 + t1))
        trajectory = self.trajectories[k]
        s0, s1 = self.phase(t0, k), self.phase(t1, k)
        if s1 - s0 <= 0.0:
            return np.zeros(len(self.shapes.joint))
        turn = joint_travel(trajectory.on(None), trajectory.t_s[0] + np.array([s0, s1]))
        return self.reach @ turn[0]

    def transform(self, c: int) -> coal.Transform3s:
        """World placement of a solid at the time of the last `place`."""
        if c not in self._made:
            self._made[c] = self._transform(c)
        return self._made[c]

    def _transform(self, c: int) -> coal.Transform3s:
        pose = self.shapes.pose[c]
        if self.robot is None:
            return coal.Transform3s(pose[:3, :3], pose[:3, 3])
        frame = self.data.oMi[int(self.shapes.joint[c])]
        return coal.Transform3s(
            frame.rotation @ pose[:3, :3], frame.rotation @ pose[:3, 3] + frame.translation
        )


def check_schedule(
    cell: Cell, start_s: np.ndarray, override: np.ndarray, most: int = 1000
) -> list[Contact]:
    """Contacts between robots, one for each unproven interval, at most `most`; [] is a proof."""
    actors = []
    for r, item in enumerate(cell.robots):
        part = slice(cell.first[r], cell.first[r + 1])
        actor = _Actor(item.name, item.robot, arm_shapes(item.robot, item.tool_bodies))
        start, speed = np.asarray(start_s)[part], np.asarray(override)[part]
        order = np.argsort(start, kind="stable")  # jobs may run in another order than given
        actor.trajectories = [item.trajectories[k].on(None) for k in order]
        actor.start, actor.override = start[order], speed[order]
        actors.append(actor)
    found: list[Contact] = []
    for i, a in enumerate(actors):
        for b in actors[i + 1 :]:
            times = sorted({0.0, *a.events(), *b.events()})
            found += _between(a, b, [t for t in times if t >= 0.0], most - len(found))
    return found


def check_obstacles(cell: Cell) -> list[Contact]:
    """Contacts of each robot's paths with the obstacles, at full speed; time does not matter.

    Solids that never move (bases, which stand on the floor) are left out.
    """
    return _against(cell, [tuple(cell.obstacles)] * len(cell.robots))


def check_fixtures(cell: Cell) -> list[Contact]:
    """Contacts of each robot's paths with part and fixtures of the other robots' stations."""
    scenes = [
        tuple(body for s, other in enumerate(cell.robots) if s != r for body in other.fixtures)
        for r in range(len(cell.robots))
    ]
    return _against(cell, scenes)


def _against(cell: Cell, scenes: Sequence[tuple[Body, ...]]) -> list[Contact]:
    found: list[Contact] = []
    for item, bodies in zip(cell.robots, scenes):
        if not bodies:
            continue
        shapes = arm_shapes(item.robot, item.tool_bodies, first_joint=1)
        actor = _Actor(item.name, item.robot, shapes)
        actor.trajectories = [t.on(None) for t in item.trajectories]
        lengths = [t.duration_s for t in item.trajectories]
        actor.start = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
        actor.override = np.ones(len(lengths))
        times = sorted({0.0, *actor.events()})
        scene = _Actor("obstacles", None, body_shapes(bodies))
        found += _between(actor, scene, times, 1000)
    return found


def _between(a: _Actor, b: _Actor, times: list[float], most: int) -> list[Contact]:
    found: list[Contact] = []
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    stack = [(t0, t1) for t0, t1 in itertools.pairwise(times) if t1 > t0][::-1]
    while stack and len(found) < most:
        t0, t1 = stack.pop()
        middle = 0.5 * (t0 + t1)
        ends_a, ends_b = a.place(middle), b.place(middle)
        way = a.way(t0, t1)[:, None] + b.way(t0, t1)[None, :]
        rough = segment_distances(ends_a, ends_b)
        rough -= a.shapes.radius_m[:, None] + b.shapes.radius_m[None, :]
        worst: Contact | None = None
        for c, d in np.argwhere(rough <= way):
            result.clear()
            distance = coal.distance(
                a.shapes.solids[c],
                a.transform(c),
                b.shapes.solids[d],
                b.transform(d),
                request,
                result,
            )
            if distance <= way[c, d] and (worst is None or distance < worst.distance_m):
                names = (a.shapes.names[c], b.shapes.names[d])
                second = b.name if b.robot is not None else names[1]
                worst = Contact(middle, a.name, second, names, float(distance))
        if worst is None:
            continue
        if (worst.distance_m <= 0.0 and t1 - t0 < 0.05) or t1 - t0 < _SHORTEST_S:
            found.append(worst)
        else:
            stack += [(middle, t1), (t0, middle)]
    return found
