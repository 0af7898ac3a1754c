"""The movements of the UR3 study: A to D of the paper's description, and random pairs like them.

The paper prints no joint vectors. Ours follow its text (section 4.2): A side to side by 90° at the
same height, B front to back by 180° close to the base, C from the horizontal to the upright
position, D back down. Random pairs of the same description show how much a figure owes to a pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.errors import ProblemError
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from planning.collision.world import CollisionWorld

CLASSES = ("A", "B", "C", "D")

#: What URScript's movej takes when nothing is given [rad/s²].
MOVEJ_ACCELERATION_RAD_S2 = 1.4
# A pair must keep this distance to everything at its ends [m].
END_CLEARANCE_M = 0.01


@dataclass(frozen=True, eq=False)
class Move:
    """A movement of class `kind` from `start_rad` to `goal_rad` (n,)."""

    name: str
    kind: str
    start_rad: Array
    goal_rad: Array


#: Joint vectors [deg], fixed before anything was optimised.
_PAPER_DEG = {
    "A": ((-45, -75, 95, -110, -90, 0), (45, -65, 80, -105, -90, 0)),
    "B": ((-90, -95, 125, -120, -90, -90), (90, -95, 125, -120, -90, 90)),
    "C": ((0, -10, 10, -90, -90, 0), (0, -90, 0, -90, -90, 0)),
    "D": ((0, -90, 0, -90, -90, 0), (0, -10, 10, -90, -90, 0)),
}


def paper_moves() -> tuple[Move, ...]:
    """One movement per class, in round degrees."""
    return tuple(
        Move(kind, kind, np.deg2rad(start), np.deg2rad(goal))
        for kind, (start, goal) in _PAPER_DEG.items()
    )


def random_moves(
    robot: Robot, world: CollisionWorld, kind: str, count: int, seed: int
) -> tuple[Move, ...]:
    """`count` seeded pairs of class `kind`: ends within limits, 10 mm clear, movej free.

    Drawn uniformly from joint ranges that fit the description and rejected until it holds.
    """
    if kind not in CLASSES:
        raise ProblemError.of(
            "move-class",
            field="kind",
            value=kind,
            legal=", ".join(CLASSES),
            fix="name a class of the paper",
        )
    rng = np.random.default_rng([seed, CLASSES.index(kind)])
    draw = {"A": _side_to_side, "B": _front_to_back, "C": _up, "D": _down}[kind]
    moves: list[Move] = []
    while len(moves) < count:
        pair = draw(robot, rng)
        if pair is None:
            continue
        start, goal = np.deg2rad(pair[0]), np.deg2rad(pair[1])
        if world.collide_batch(np.stack([start, goal]), END_CLEARANCE_M).any():
            continue
        share = np.linspace(0.0, 1.0, 101)[:, None]
        if not world.collide_batch(start + share * (goal - start)).any():
            moves.append(Move(f"{kind}{len(moves) + 1:02d}", kind, start, goal))
    return tuple(moves)


def movej(move: Move, robot: Robot, duration_s: float) -> JointTrajectory:
    """The controller's movej that takes `duration_s`: a synchronised trapezoid.

    The leading axis accelerates at URScript's default of 1.4 rad/s², or, where that is too slow,
    so that its ramps take a third of the time each. Limits of the robot are not enforced here.
    """
    distance = float(np.max(np.abs(move.goal_rad - move.start_rad)))
    acceleration = max(MOVEJ_ACCELERATION_RAD_S2, 4.5 * distance / duration_s**2)
    reach = acceleration * duration_s
    speed = 0.5 * (reach - np.sqrt(reach * reach - 4.0 * acceleration * distance))
    paced = robot.with_limits(velocity_limit_rad_s=speed, acceleration_limit_rad_s2=acceleration)
    return trapezoid_motion(paced, move.start_rad, move.goal_rad, num_intervals=60).on(robot)


Pair = tuple[Array, Array]


def _elbow_up(rng: np.random.Generator, turn_deg: float) -> Array:
    """Tool down within 15°, elbow up, base at `turn_deg`."""
    shoulder, elbow = rng.uniform(-110, -30), rng.uniform(40, 140)
    tilt = rng.uniform(-15, 15)
    wrist = rng.uniform((-100, -90), (-80, 90))
    return np.array([turn_deg, shoulder, elbow, -90 - shoulder - elbow + tilt, *wrist])


def _tip(robot: Robot, q_deg: Array) -> tuple[float, float]:
    """Radius and height of the flange [m]."""
    x, y, z = robot.tip_pose(np.deg2rad(q_deg)).translation
    return float(np.hypot(x, y)), float(z)


def _at_one_height(
    robot: Robot, rng: np.random.Generator, turn_deg: float, least_m: float, most_m: float
) -> Pair | None:
    first = rng.uniform(-180, 180 - turn_deg)
    ends = [_elbow_up(rng, turn) for turn in (first, first + turn_deg + rng.uniform(-5, 5))]
    (r0, z0), (r1, z1) = (_tip(robot, q) for q in ends)
    fits = abs(z0 - z1) < 0.03 and min(z0, z1) > 0.05 and least_m < min(r0, r1)
    if not fits or max(r0, r1) > most_m:
        return None
    return (ends[0], ends[1]) if rng.random() < 0.5 else (ends[1], ends[0])


def _side_to_side(robot: Robot, rng: np.random.Generator) -> Pair | None:
    return _at_one_height(robot, rng, 90.0, 0.2, 0.45)


def _front_to_back(robot: Robot, rng: np.random.Generator) -> Pair | None:
    return _at_one_height(robot, rng, 180.0, 0.12, 0.30)


def _up(robot: Robot, rng: np.random.Generator) -> Pair | None:
    turn = rng.uniform(-180, 180)
    flat, upright = (
        np.array(
            [
                turn + rng.uniform(-20, 20),
                shoulder + rng.uniform(-15, 15),
                rng.uniform(-20, 20),
                -90 + rng.uniform(-30, 30),
                -90 + rng.uniform(-30, 30),
                rng.uniform(-90, 90),
            ]
        )
        for shoulder in (-10.0, -90.0)
    )
    low, high = _tip(robot, flat), _tip(robot, upright)
    return (flat, upright) if low[0] > 0.35 and high[1] > 0.45 else None


def _down(robot: Robot, rng: np.random.Generator) -> Pair | None:
    pair = _up(robot, rng)
    return None if pair is None else (pair[1], pair[0])
