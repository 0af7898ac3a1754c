"""Departure lines: where a tool tip may touch the part it welds, and how far it strays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array, readonly
from dmoc.errors import ProblemError


@dataclass(frozen=True)
class DepartureLine:
    """A straight line on which the tool tip leaves (or reaches) a weld.

    The tip starts at `tip_start_m` (3,) and moves along the unit vector `direction` (3,) for
    `length_m`. While it lies within `stray_m` of that segment (a capsule), contact of the tool's
    touching body with the obstacle named `part` is no collision; everywhere else it is.
    """

    tip_start_m: Array
    direction: Array
    length_m: float
    stray_m: float = 0.01
    part: str = ""

    def __post_init__(self) -> None:
        for name in ("tip_start_m", "direction"):
            value = readonly(getattr(self, name), name, ndim=1)
            if value.shape != (3,):
                raise ProblemError.of(
                    "departure-line",
                    field=name,
                    value=f"shape {value.shape}",
                    legal="(3,)",
                    fix="give x, y, z",
                )
            object.__setattr__(self, name, value)
        if abs(np.linalg.norm(self.direction) - 1.0) > 1e-6:
            raise ProblemError.of(
                "departure-line",
                field="direction",
                value=str(self.direction),
                legal="a unit vector",
                fix="divide it by its length",
            )
        if not (self.length_m >= 0 and self.stray_m > 0):
            raise ProblemError.of(
                "departure-line",
                field="length_m, stray_m",
                value=f"{self.length_m}, {self.stray_m}",
                legal=">= 0, > 0 m",
                fix="give the length of the line and the radius of its tube",
            )

    @property
    def row(self) -> Array:
        """(8,) start, direction, length, stray, as the kernels take it."""
        return np.array([*self.tip_start_m, *self.direction, self.length_m, self.stray_m])


def line_stray_m(line: DepartureLine, tips_m: Array) -> float:
    """How far a tip path strays from its departure line before it is clear of it [m].

    `tips_m` (K, 3) in the order in which the line is left (reverse them for an arrival), densely
    sampled. Only points before the first one beyond the end of the line count; the distance is
    that to the segment. The tip's own spacing bounds what a sample can miss.
    """
    offset = np.asarray(tips_m, dtype=float) - line.tip_start_m
    along = offset @ line.direction
    beyond = np.flatnonzero(along > line.length_m)
    last = beyond[0] if len(beyond) else len(along)
    if last == 0:
        return 0.0
    nearest = np.clip(along[:last], 0.0, line.length_m)[:, None] * line.direction
    return float(np.linalg.norm(offset[:last] - nearest, axis=1).max())
