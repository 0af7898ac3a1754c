"""When what happens in a cycle: motions and welds on one clock, and the state at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from sequencing.cycle_types import CycleMotion, Weld


@dataclass(frozen=True)
class Segment:
    """A stretch of the cycle from `start_s` to `end_s`: number `index` of its motions or welds."""

    start_s: float
    end_s: float
    kind: Literal["motion", "weld"]
    index: int
    label: str

    @property
    def duration_s(self) -> float:
        """Length [s]."""
        return self.end_s - self.start_s


class CycleState(NamedTuple):
    """State at K times: (K, n) each; `torque_nm` is None without a robot."""

    q_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array | None


@dataclass(frozen=True)
class CycleTimeline:
    """The segments of a cycle in order, without holes, starting at 0 s."""

    segments: tuple[Segment, ...]
    welds: tuple[Weld, ...]
    motions: tuple[CycleMotion, ...]

    @property
    def duration_s(self) -> float:
        """Cycle time [s]."""
        return self.segments[-1].end_s if self.segments else 0.0

    def weld_number(self) -> dict[str, int]:
        """Place of every stud in the order of welding, from 1."""
        return {weld.stud: place for place, weld in enumerate(self.welds, start=1)}

    def segment_at(self, t_s: float) -> int:
        """Number of the segment at time `t_s` [s]; the later one where two meet."""
        starts = [segment.start_s for segment in self.segments]
        return max(0, int(np.searchsorted(starts, t_s, side="right")) - 1)

    def at(self, t_s: Array, robot: Robot | None = None) -> CycleState:
        """State at times `t_s` (K,) [s]: the motions' interpolant, welds held still.

        Torques are inverse dynamics of the interpolant for `robot` (gravity while welding).
        """
        times = np.atleast_1d(np.asarray(t_s, dtype=float))
        starts = np.array([s.start_s for s in self.segments])
        which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        n = _joints(self)
        q, v, a = (np.zeros((len(times), n)) for _ in range(3))
        torque = None if robot is None else np.zeros((len(times), n))
        for number in np.unique(which):
            segment, rows = self.segments[number], which == number
            if segment.kind == "weld":
                held = self.welds[segment.index].q_rad
                q[rows] = held
                if robot is not None and torque is not None:
                    torque[rows] = robot.gravity_torque_nm(held)
                continue
            curve = trajectory_of(self.motions[segment.index]).on(robot)
            sample = curve.sample(times[rows] - segment.start_s + curve.t_s[0])
            q[rows], v[rows], a[rows] = sample[:3]
            if torque is not None:
                torque[rows] = sample.torque_nm
        return CycleState(q, v, a, torque)


def trajectory_of(item: CycleMotion) -> JointTrajectory:
    """The trajectory of a motion that is in a cycle; raises `MotionNotSolved` if it has none."""
    trajectory = item.motion.trajectory
    if trajectory is None:
        trajectory = item.motion.require().trajectory
        assert trajectory is not None
    return trajectory


def timeline(welds: Sequence[Weld], motions: Sequence[CycleMotion]) -> CycleTimeline:
    """Welds and motions in order of execution.

    One motion more than welds: the cycle begins with the motion from home. Otherwise it begins
    with the first weld, and motion k leaves weld k.
    """
    order: list[tuple[Literal["motion", "weld"], int]] = []
    starts_with_motion = len(motions) > len(welds)
    for k in range(max(len(motions), len(welds))):
        pair: list[tuple[Literal["motion", "weld"], int]] = [("weld", k), ("motion", k)]
        if starts_with_motion:
            pair.reverse()
        order += [(kind, i) for kind, i in pair if i < len(motions if kind == "motion" else welds)]
    segments, clock = [], 0.0
    for kind, index in order:
        if kind == "weld":
            length, label = welds[index].time_s, welds[index].stud
        else:
            item = motions[index]
            length, label = trajectory_of(item).duration_s, f"{item.origin} → {item.target}"
        if length > 0:
            segments.append(Segment(clock, clock + length, kind, index, label))
        clock += length
    return CycleTimeline(tuple(segments), tuple(welds), tuple(motions))


def _joints(line: CycleTimeline) -> int:
    if line.motions:
        return int(trajectory_of(line.motions[0]).q_rad.shape[1])
    return len(line.welds[0].q_rad)
