"""An alternative of a weld, and the departure line on which the gun leaves it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from dmoc.arrays import Array, StaysReadonly, readonly
from dmoc.errors import Fault, ProblemError
from dmoc.robot.robot import Robot
from planning.arm.inverse_kinematics import follow_line
from planning.arm.screws import chain_of
from planning.collision.departure_line import DepartureLine
from planning.station.station import Station
from planning.station.studs import Stud

#: Poses of a station that are planned with: of more, `sequencing.edges.pruning` chooses.
MOST_POSES = 480


@dataclass(frozen=True, eq=False)
class Alternative(StaysReadonly):
    """One way to weld a stud.

    `q_rad` (n,) welds it; `line_rad` (11, n) are the joint vectors at equal fractions of the
    departure line, the first being `q_rad`; `weld_cost` = weld time · (c_t + c_e ‖g(q)‖²).
    """

    stud_id: str
    index: int
    q_rad: Array
    line_rad: Array
    weld_cost: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "q_rad", readonly(self.q_rad, "q_rad", 1))
        object.__setattr__(self, "line_rad", readonly(self.line_rad, "line_rad", 2))


@dataclass(frozen=True, eq=False)
class StudAlternatives:
    """The alternatives of a stud, and how many candidates each reason took away.

    Reasons: `unreachable` (a tool spin without any solution), `joint limit`, `collision with
    itself (A, B)`, `collision with BODY`, `departure leaves the joint limits`, `departure jams
    with BODY`.
    """

    stud: Stud
    alternatives: tuple[Alternative, ...]
    reasons: Mapping[str, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "reasons", MappingProxyType(dict(self.reasons)))

    def __reduce__(self) -> tuple[Any, ...]:
        return (StudAlternatives, (self.stud, self.alternatives, dict(self.reasons)))


def weld_poses(stud: Stud, spin_steps: int) -> Array:
    """Tip poses (S, 4, 4) of a weld: +Z = −normal, turned about it in equal steps.

    The first has its X along the world's x axis as nearly as the normal lets it (y axis where the
    normal is within 26° of x). One pose only if the stud does not allow the tool to spin; where it
    allows a range of turns, about as densely from its one end to the other.
    """
    z = -np.asarray(stud.normal)
    seed = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0.0, 1, 0])
    x = seed - (seed @ z) * z
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    count = spin_steps if stud.spin_free else 1
    angles = 2 * np.pi * np.arange(count) / spin_steps
    if stud.spin_rad is not None:
        low, high = stud.spin_rad
        ends = high - low < 2 * np.pi - 1e-9
        count = max(1, round(spin_steps * (high - low) / (2 * np.pi)))
        count = count + int(ends) if high > low else 1
        angles = low + (high - low) * np.arange(count) / max(1, count - int(ends))
    poses = np.tile(np.eye(4), (len(angles), 1, 1))
    poses[:, :3, 0] = np.outer(np.cos(angles), x) + np.outer(np.sin(angles), y)
    poses[:, :3, 1] = np.outer(np.cos(angles), y) - np.outer(np.sin(angles), x)
    poses[:, :3, 2] = z
    poses[:, :3, 3] = stud.position_m
    return poses


def weld_line(station: Station, stud: Stud) -> DepartureLine:
    """The line on which the gun leaves this stud, and where its tip may touch the part."""
    return DepartureLine(
        tip_start_m=stud.position_m,
        direction=stud.depart_direction,
        length_m=stud.depart_m,
        stray_m=station.stray_m,
        part=stud.on,
    )


def departure_knots(
    station: Station, stud: Stud, q_rad: Array, fractions: Sequence[float] | Array
) -> Array:
    """Joint vectors (m, n) at fractions (0 weld, 1 end) of the stud's departure line.

    The tool keeps its orientation; each is found by continuation from `q_rad` (n,), error at most
    1e-9. Errors: `ProblemError` if the line leaves the joint limits or the arm's reach.
    """
    values = np.asarray(fractions, dtype=float)
    order = np.argsort(values, kind="stable")
    offset = stud.depart_m * values[order, None] * stud.depart_direction
    line, good = follow_line(chain_of(station.robot), np.atleast_2d(q_rad), offset[None])
    if not good[0]:
        raise ProblemError(_no_line(stud, q_rad))
    result = np.empty_like(line[0])
    result[order] = line[0]
    return result


def departure_point(station: Station, stud: Stud, q_rad: Array, fraction: float) -> Array:
    """`departure_knots` at one fraction (n,), read-only, bit for bit.

    Points are kept for the life of the process: every travel from or to a pose asks for the same
    few, and following the line takes longer than the motion's programme.
    """
    offset = stud.depart_m * float(fraction) * stud.depart_direction
    point = _point_at(station.robot, tuple(map(float, q_rad)), tuple(map(float, offset)))
    if point is None:
        raise ProblemError(_no_line(stud, q_rad))
    return point


@lru_cache(maxsize=65536)
def _point_at(robot: Robot, q_rad: tuple[float, ...], offset_m: tuple[float, ...]) -> Array | None:
    line, good = follow_line(chain_of(robot), np.array([q_rad]), np.array([[offset_m]]))
    return readonly(line[0, 0], "line", ndim=1) if good[0] else None


def _no_line(stud: Stud, q_rad: Array) -> Fault:
    return Fault(
        "departure",
        field=f"stud {stud.id}",
        value=str(np.round(q_rad, 4)),
        legal="a joint vector whose departure line the robot can follow",
        fix="use one of planning.alternatives(station)",
    )
