"""Where to stand the robot: places judged by reach and by the estimated cost of the cycle.

A place is a shift and a turn of the robot's base against the present one; part, fixtures and
studs stay. No motion is solved: the cost is that of the best order and poses under the
straight-line estimate, obstacles between the poses left out. It ranks places; `plan_station`
says what the chosen one costs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from dmoc.errors import ProblemError
from planning.collision.coal_engine import CoalEngine
from planning.collision.pieces import Mounted, pieces_of
from planning.collision.robot_bodies import link_bodies
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing.edges.estimates import straight_line
from sequencing.edges.nodes import StationNodes, station_nodes
from sequencing.edges.pruning import pruned
from sequencing.gtsp.portfolio import solve


@dataclass(frozen=True)
class Place:
    """A shift of the base in world axes [m] and a turn about the vertical through it [rad]."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Placement:
    """What a place is worth.

    `unreached` are the studs without an alternative there, `alternatives` the number of all poses
    and `fewest` that of the poorest stud. `cost` is the estimated J of the cycle, inf where a stud
    is not reached; `reason` says why a place is impossible whatever the studs (else empty).
    """

    place: Place
    unreached: tuple[str, ...]
    alternatives: int
    fewest: int
    cost: float
    reason: str = ""

    @property
    def rank(self) -> tuple[bool, int, float]:
        """Possible places first, then those that reach most studs, then the cheap ones."""
        return (bool(self.reason), len(self.unreached), self.cost)


def grid_of_places(
    span_m: float, step_m: float, yaw_span_rad: float = 0.0, yaw_step_rad: float = np.pi / 12
) -> tuple[Place, ...]:
    """A square grid of ±`span_m` about the present base, at turns within ±`yaw_span_rad`.

    The present place is one of them. Errors: `ProblemError` for a step that is not positive or a
    negative span.
    """
    for name, value, least in (
        ("step_m", step_m, 1e-3),
        ("span_m", span_m, 0.0),
        ("yaw_step_rad", yaw_step_rad, 1e-3),
        ("yaw_span_rad", yaw_span_rad, 0.0),
    ):
        if not least <= value < np.inf:
            raise ProblemError.of(
                "placement",
                field=name,
                value=repr(value),
                legal=f">= {least:g}",
                fix="give metres and radians",
            )
    many = int(np.floor(span_m / step_m + 1e-9))
    turns = int(np.floor(yaw_span_rad / yaw_step_rad + 1e-9))
    axis = step_m * np.arange(-many, many + 1)
    return tuple(
        Place(float(x), float(y), 0.0, float(yaw))
        for yaw in yaw_step_rad * np.arange(-turns, turns + 1)
        for x in axis
        for y in axis
    )


def moved_station(station: Station, place: Place) -> Station:
    """The station with the robot standing at `place`."""
    base = station.robot.base
    turn = pin.utils.rotate("z", place.yaw_rad)
    shift = np.array([place.x_m, place.y_m, place.z_m])
    moved = pin.SE3(turn @ base.rotation, base.translation + shift)
    return station.replace(robot=station.robot.with_base(moved))


def place_station(
    station: Station,
    places: Sequence[Place],
    *,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Placement, ...]:
    """All places judged, best first (`Placement.rank`; ties keep their order).

    `progress` gets the number judged and the number of all. The answer does not depend on the
    executor.
    """
    judge = partial(judge_place, station, seed=seed)
    found = []
    for item in map(judge, places) if executor is None else executor.map(judge, places):
        found.append(item)
        if progress is not None:
            progress(len(found), len(places))
    return tuple(sorted(found, key=lambda item: item.rank))


def judge_place(station: Station, place: Place, *, seed: int = 0) -> Placement:
    """Reach and estimated cycle cost of one place."""
    moved = moved_station(station, place)
    everything = tuple(stud.id for stud in station.studs)
    obstacle = _base_hits(station, moved)
    if obstacle:
        return Placement(place, everything, 0, 0, np.inf, f"the base meets {obstacle}")
    world = CollisionWorld(moved)
    if moved.home_rad is not None:
        pair = world.collide(moved.home_rad)
        if pair is not None:
            return Placement(place, everything, 0, 0, np.inf, f"home: {pair[0]} meets {pair[1]}")
    found = alternatives(moved, world, seed)
    missing = tuple(item.stud.id for item in found if not item.alternatives)
    counts = [len(item.alternatives) for item in found]
    kept = pruned(moved, found, price=False)[0]
    cost = np.inf if missing else _estimated_cost(moved, station_nodes(moved, kept), seed)
    return Placement(place, missing, sum(counts), min(counts), cost)


def _estimated_cost(station: Station, nodes: StationNodes, seed: int) -> float:
    pairs = nodes.usable_pairs()
    q = nodes.q_rad
    travel = np.zeros((nodes.num_nodes, nodes.num_nodes))
    i, j = pairs.T
    travel[i, j] = straight_line(station.robot, station.cost, q[i], q[j]).cost
    travel[j, i] = travel[i, j]
    return float(solve(nodes.problem(travel, station), seed=seed, effort="quick").cost)


def _base_hits(station: Station, moved: Station) -> str:
    """The obstacle that the base meets at its new place and did not meet at the old, or ''."""
    before = _met_by_base(station)
    return next((name for name in _met_by_base(moved) if name not in before), "")


def _met_by_base(station: Station) -> list[str]:
    """Obstacles that the robot's base overlaps: what it stands on, at least."""
    standing = [m for m in link_bodies(station.robot) if m.joint == 0]
    own = [piece for mounted in standing for piece in pieces_of(mounted)]
    met = []
    for body in station.obstacles:
        others = pieces_of(Mounted(body, 0, np.array(body.pose)))
        engine = CoalEngine([*own, *others])
        rows = [np.append(p.pose[:3, :3].ravel(), p.pose[:3, 3]) for p in (*own, *others)]
        theirs = range(len(own), len(rows))
        if any(engine.touches(a, b, rows[a], rows[b]) for a in range(len(own)) for b in theirs):
            met.append(body.name)
    return met
