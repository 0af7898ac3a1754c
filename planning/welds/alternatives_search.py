"""Search the alternatives of every weld: which joint vectors weld it, and why the others do not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from planning.arm.inverse_kinematics import follow_line, inverse
from planning.arm.screws import chain_of
from planning.collision.departure_line import DepartureLine
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from planning.station.studs import Stud
from planning.welds.poses import Alternative, StudAlternatives, weld_line, weld_poses

#: Fractions of the departure line at which an alternative is checked and stored.
LINE_FRACTIONS = np.linspace(0.0, 1.0, 11)
#: What the certificate demands for the controller; weld poses keep at least that [m].
LEAST_CLEARANCE_M = 0.002
#: Once off its line the tip may touch nothing: this far it must be from the part by then [m].
FREE_M = 0.005


def alternatives(
    station: Station, world: CollisionWorld | None = None, seed: int = 0
) -> tuple[StudAlternatives, ...]:
    """All alternatives of every stud: IK branches × wrap-arounds within limits × tool spins that
    keep the station's clearance at the weld and on the whole departure line.

    The gun's touching body may meet the part only while the tip is on that line; at its end it
    must be 5 mm off. The drives must be able to hold the arm still at the weld. `seed` matters only
    for arms whose inverse kinematics is numerical.
    """
    world = CollisionWorld(station) if world is None else world
    return tuple(
        _of_stud(station, world, stud, seed + 100_003 * k) for k, stud in enumerate(station.studs)
    )


def _of_stud(station: Station, world: CollisionWorld, stud: Stud, seed: int) -> StudAlternatives:
    robot = station.robot
    found = inverse(robot, weld_poses(stud, station.spin_steps), seed)
    reasons: Counter[str] = Counter()
    reasons["unreachable"] += int(np.sum(found.num_branches == 0))
    reasons["joint limit"] += int(found.num_outside.sum())
    # A stud that sits on nothing has nothing that its gun may touch.
    lines = (weld_line(station, stud),) if stud.on else ()
    own = {body.name for body in station.tool_bodies} | {f.name for f in robot.model.frames}
    demand = demanded_clearance_m(station)
    q = _held(robot, found.q_rad, reasons)
    q = _without(world, demand, q, lines, own, reasons, "collision with ")
    offset = stud.depart_m * LINE_FRACTIONS[:, None] * stud.depart_direction
    knots, good = follow_line(chain_of(robot), q, np.broadcast_to(offset, (len(q), *offset.shape)))
    reasons["departure leaves the joint limits"] += int(np.sum(~good))
    kept = []
    for row in knots[good]:
        pair = _first_hit(world, row, demand, lines)
        pair = pair or _first_hit(world, row[-1:], FREE_M, ())
        if pair is None:
            kept.append(row)
        else:
            reasons["departure jams with " + _other(pair, own)] += 1
    result = tuple(
        Alternative(stud.id, index, row[0], row, weld_cost(station, stud, row[0]))
        for index, row in enumerate(kept)
    )
    return StudAlternatives(stud, result, {k: v for k, v in reasons.items() if v})


def demanded_clearance_m(station: Station) -> float:
    """What a weld pose and its departure line keep from everything [m]."""
    return max(station.clearance_m, LEAST_CLEARANCE_M)


def weld_cost(station: Station, stud: Stud, q_rad: Array) -> float:
    """Cost of the weld at q (n,): its time × (c_t + c_e ‖g(q)‖²)."""
    rate = float(station.cost.holding_rate(station.robot.gravity_torque_nm(q_rad)))
    return stud.weld_time_s * rate


def holding_load(robot: Robot, q_rad: Array) -> Array:
    """Share (K, n) of each joint's torque limit that it takes to stand still at rows of q."""
    load: Array = np.abs(robot.gravity_torque_nm(q_rad)) / robot.torque_limit_nm
    return load


def _held(robot: Robot, q: Array, reasons: Counter[str]) -> Array:
    """Rows of q at which no joint needs more than its torque limit to stand still."""
    if not len(q):
        return q
    excess = holding_load(robot, q)
    for joint in np.argmax(excess, axis=1)[excess.max(axis=1) > 1.0]:
        reasons[f"joint {joint + 1} cannot hold the weight"] += 1
    return q[excess.max(axis=1) <= 1.0]


def _without(
    world: CollisionWorld,
    demand_m: float,
    q: Array,
    lines: Sequence[DepartureLine],
    own: set[str],
    reasons: Counter[str],
    words: str,
) -> Array:
    """Rows of q that keep clear at the weld; the others are counted by reason."""
    if not len(q):
        return q
    hit: npt.NDArray[np.bool_] = world.collide_batch(q, demand_m, lines)
    for row in q[hit]:
        pair = world.collide(row, demand_m, lines)
        if pair is not None:
            reasons[words + _other(pair, own)] += 1
    return q[~hit]


def _first_hit(
    world: CollisionWorld, q: Array, inflation_m: float, lines: Sequence[DepartureLine]
) -> tuple[str, str] | None:
    hit = world.collide_batch(q, inflation_m, lines)
    if not hit.any():
        return None
    return world.collide(q[int(np.argmax(hit))], inflation_m, lines)


def _other(pair: tuple[str, str], own: set[str]) -> str:
    """The body of a pair that is not the robot's; both names if both are."""
    others = [name for name in pair if name not in own]
    return others[0] if others else f"itself ({pair[0]}, {pair[1]})"
