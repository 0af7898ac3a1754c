"""The tool spin of one weld as a continuous variable: pose, admissibility, gradient of the cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory
from dmoc.programme.transcription import Layout
from dmoc.programme.types import Box, Guess
from dmoc.solving.nlp import Multipliers, solve_nlp
from planning.arm.inverse_kinematics import follow_line
from planning.arm.numeric import converge
from planning.arm.screws import chain_of
from planning.collision.world import CollisionWorld
from planning.path.departure import MOST_OF_TWENTY, departure_fractions, num_line_knots
from planning.station.station import Station
from planning.station.studs import Stud
from planning.welds.alternatives_search import (
    FREE_M,
    LINE_FRACTIONS,
    demanded_clearance_m,
    holding_load,
    weld_cost,
)
from planning.welds.poses import departure_knots, weld_line

#: Largest turn of one continuation step [rad].
STEP_RAD = 0.05
#: How far the motion may move while its multipliers are read [rad]; obstacles are not asked.
HELD_RAD = 0.02
_DIFFERENCE_RAD = 1e-5


def spun(station: Station, q_rad: Array, angle_rad: float) -> Array | None:
    """`q_rad` (n,) with the tool turned by `angle_rad` about its own axis, tip in place.

    By continuation on the branch of `q_rad`; None where it ends at a limit or a singularity.
    """
    chain = chain_of(station.robot)
    start = chain.forward(q_rad[None])
    q = q_rad[None].copy()
    steps = max(1, int(np.ceil(abs(angle_rad) / STEP_RAD)))
    for k in range(1, steps + 1):
        turn = angle_rad * k / steps
        c, s = np.cos(turn), np.sin(turn)
        pose = start.copy()
        pose[:, :3, :3] = start[:, :3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        following, arrived = converge(chain, pose, q, iterations=15)
        if not arrived[0] or np.max(np.abs(following - q)) > 0.3:
            return None
        q = following
    if np.any(q[0] < chain.lower_rad) or np.any(q[0] > chain.upper_rad):
        return None
    return np.asarray(q[0])


def admissible(station: Station, world: CollisionWorld, stud: Stud, q_rad: Array) -> bool:
    """Whether `q_rad` (n,) may weld the stud: what `alternatives` demands of a pose."""
    if holding_load(station.robot, q_rad[None]).max() > 1.0:
        return False
    offset = stud.depart_m * LINE_FRACTIONS[:, None] * stud.depart_direction
    line, good = follow_line(chain_of(station.robot), q_rad[None], offset[None])
    if not good[0]:
        return False
    lines = (weld_line(station, stud),) if stud.on else ()
    if world.collide_batch(line[0], demanded_clearance_m(station), lines).any():
        return False
    return not world.collide_batch(line[0, -1:], FREE_M, ()).any()


def line_problem(
    station: Station, origin: Stud | None, target: Stud | None, trajectory: JointTrajectory
) -> MotionProblem | None:
    """The problem that `trajectory` solves, with the line knots that it keeps to; None if none."""
    first, last = trajectory.q_rad[0], trajectory.q_rad[-1]
    num = trajectory.num_intervals
    for per_twenty in range(1, MOST_OF_TWENTY + 1):  # what `best_departure` chooses from
        count = per_twenty * num_line_knots(num)
        fractions = departure_fractions(count)
        depart = arrive = None
        if origin is not None:
            depart = departure_knots(station, origin, first, fractions)
        if target is not None:
            arrive = departure_knots(station, target, last, fractions)[::-1]
        fits = depart is None or np.allclose(trajectory.q_rad[1 : count + 1], depart, atol=1e-6)
        fits &= arrive is None or np.allclose(trajectory.q_rad[-1 - count : -1], arrive, atol=1e-6)
        if fits:
            return MotionProblem(
                station.robot,
                first,
                last,
                station.cost,
                num_intervals=num,
                depart_rad=depart,
                arrive_rad=arrive,
            )
    return None


@dataclass(frozen=True)
class EndGradient:
    """dJ/dq of the fixed knots of a motion: `start` (m+1, n) from the first knot on, `goal`
    (m+1, n) up to the last one."""

    start: Array
    goal: Array


def end_gradient(problem: MotionProblem, trajectory: JointTrajectory) -> EndGradient | None:
    """Gradient of the optimal cost by the knots that the problem prescribes.

    By the envelope theorem it is minus the multiplier of the bounds that fix them. The motion is
    held within 0.02 rad of `trajectory`, which stands for what keeps it off the obstacles.
    """
    step = trajectory.duration_s / trajectory.num_intervals
    box = Box(trajectory.q_rad - HELD_RAD, trajectory.q_rad + HELD_RAD)
    guess = Guess(trajectory.q_rad, trajectory.torque_nm, step)
    solution = solve_nlp(problem, guess, box=box)
    if not solution.status.ok or not isinstance(solution.multipliers, Multipliers):
        return None
    knots = Layout(problem.num_intervals, problem.robot.num_joints).knots()
    price = -solution.multipliers.bounds
    first = 1 if problem.depart_rad is None else len(problem.depart_rad) + 1
    last = 1 if problem.arrive_rad is None else len(problem.arrive_rad) + 1
    return EndGradient(price[knots[:first]], price[knots[-last:]])


def spin_slope(
    station: Station,
    stud: Stud,
    q_rad: Array,
    after: EndGradient | None,
    before: EndGradient | None,
) -> float | None:
    """dF/dφ of a weld: its holding cost, the motion that leaves it and the one that reaches it."""
    ahead = spun(station, q_rad, _DIFFERENCE_RAD)
    behind = spun(station, q_rad, -_DIFFERENCE_RAD)
    if ahead is None or behind is None:
        return None
    change = weld_cost(station, stud, ahead) - weld_cost(station, stud, behind)
    for gradient, leaving in ((after, True), (before, False)):
        if gradient is None:
            continue
        price = gradient.start if leaving else gradient.goal
        fractions = departure_fractions(len(price) - 1) if len(price) > 1 else np.zeros(0)
        if leaving:
            fractions = np.concatenate([[0.0], fractions])
        else:
            fractions = np.concatenate([fractions[::-1], [0.0]])
        lines = [departure_knots(station, stud, q, fractions) for q in (ahead, behind)]
        change += float(np.sum(price * (lines[0] - lines[1])))
    return change / (2 * _DIFFERENCE_RAD)
