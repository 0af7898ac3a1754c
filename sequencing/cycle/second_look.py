"""The second engine's word on the motions of a cycle, before the cycle counts as found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version

from dmoc.motion.status import Status
from planning.collision.second_look import SecondLook, Touch, samples_of
from planning.station.station import Station
from planning.welds.poses import weld_line
from sequencing.cycle_types import CycleMotion, Look


class MotionLooks:
    """Looks at motions of one station, each once, and remembers what was refused."""

    def __init__(self, station: Station) -> None:
        self._look = SecondLook(station)
        self._lines = {s.id: (weld_line(station, s),) if s.on else () for s in station.studs}
        self._known: dict[tuple[str, str, bytes], Touch | None] = {}
        self.refused: list[str] = []

    def touch(self, item: CycleMotion) -> Touch | None:
        """The contact that a motion makes, or None."""
        trajectory = item.motion.trajectory
        assert trajectory is not None
        numbers = (trajectory.t_s, trajectory.q_rad, trajectory.velocity_rad_s)
        key = (item.origin, item.target, b"".join(array.tobytes() for array in numbers))
        if key not in self._known:
            lines = (*self._lines.get(item.origin, ()), *self._lines.get(item.target, ()))
            touch = self._known[key] = self._look.touch(trajectory, lines)
            if touch is not None:
                self.refused.append(f"{item.origin} → {item.target}: {touch}")
        return self._known[key]

    def judged(self, motions: Sequence[CycleMotion]) -> tuple[CycleMotion, ...]:
        """The motions; one that touches is `uncertified`, and its note names the pair."""
        return tuple(self._judged(item) for item in motions)

    def _judged(self, item: CycleMotion) -> CycleMotion:
        touch = None if item.motion.trajectory is None else self.touch(item)
        if touch is None:
            return item
        note = f"{item.motion.note}; {touch}".removeprefix("; ")
        motion = item.motion.replace(status=Status.UNCERTIFIED, certified=False, note=note)
        return replace(item, motion=motion)

    def report(self, motions: Sequence[CycleMotion]) -> Look:
        """What was asked of the motions of a cycle, and what of others was refused on the way."""
        found = [m for m in motions if m.motion.trajectory is not None]
        counts = [samples_of(m.motion.trajectory) for m in found if m.motion.trajectory is not None]
        contacts = sum(self.touch(item) is not None for item in found)
        engine = f"python-fcl {version('python-fcl')}"
        return Look(engine, len(found), sum(counts), contacts, tuple(self.refused))
