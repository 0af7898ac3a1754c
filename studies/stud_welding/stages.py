"""One motion of the cycle again, as the paper's Figs. 1 and 2 show it: boxes around a seed path."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.refinement import RefineParams, RefineRecord, refine
from planning.collision.world import CollisionWorld, EdgeClearance
from planning.path.departure import LineFunction, best_departure
from planning.path.edge_motion import EdgeParams, seed_paths
from planning.station.station import Station
from planning.welds.poses import departure_point, weld_line
from sequencing.cycle_types import Cycle, CycleMotion


@dataclass(frozen=True)
class Stages:
    """Iterates of the refinement with boxes, from a planned path, and the clearance they saw."""

    records: tuple[RefineRecord, ...]
    seed_rad: Array
    clearance: EdgeClearance


def tightest_motion(cycle: Cycle) -> CycleMotion:
    """The motion between two welds that passes nearest to anything."""
    between = [item for item in cycle.motions if item.kind == "travel"]
    return min(between, key=lambda item: (item.motion.min_clearance_m or np.inf, item.key))


def refine_in_stages(
    station: Station, world: CollisionWorld, item: CycleMotion, seed: int, max_outer: int = 60
) -> Stages:
    """Refine the motion of `item` with the paper's boxes from a planned path, kept iterate by
    iterate. Raises `MotionNotSolved` where the motion has no trajectory."""
    curve = item.motion.require().trajectory
    assert curve is not None
    origin, target = station.stud(item.origin), station.stud(item.target)
    problem = best_departure(
        MotionProblem(station.robot, curve.q_rad[0], curve.q_rad[-1], station.cost),
        _line(station, item.origin, curve.q_rad[0]),
        _line(station, item.target, curve.q_rad[-1]),
        20,
    ).problem
    clearance = world.clearance(
        start_line=weld_line(station, origin) if origin.on else None,
        goal_line=weld_line(station, target) if target.on else None,
    )
    found = next(seed_paths(problem, clearance, seed, EdgeParams()))
    records: list[RefineRecord] = []
    if found.path is None:
        return Stages((), np.zeros((0, station.robot.num_joints)), clearance)
    settings = RefineParams.screening().replace(
        clearance_m=station.clearance_m, stop_fraction=2e-3, max_outer=max_outer
    )
    refine(
        problem,
        found.path,
        clearance,
        method="boxes",
        params=settings,
        fallback=False,
        trace=records.append,
    )
    return Stages(tuple(records), np.asarray(found.path.q_rad), clearance)


def _line(station: Station, stud_id: str, q_rad: Array) -> LineFunction:
    stud = station.stud(stud_id)
    return lambda fraction: departure_point(station, stud, q_rad, fraction)


def projected(record: RefineRecord, joints: tuple[int, int]) -> RefineRecord:
    """The iterate seen in two joints; a box of joint space is a box there too."""
    pick = list(joints)
    return replace(
        record,
        q_rad=record.q_rad[:, pick],
        velocity_rad_s=record.velocity_rad_s[:, pick],
        lower_rad=record.lower_rad[:, pick],
        upper_rad=record.upper_rad[:, pick],
    )


def slice_through(q_rad: Array) -> tuple[Array, Array, Array]:
    """Origin (n,) and two unit directions (n,) of the plane nearest to points (K, n).

    The two largest principal directions; a motion drawn in it deviates from the truth by what the
    others hold.
    """
    middle = q_rad.mean(axis=0)
    _, _, directions = np.linalg.svd(q_rad - middle, full_matrices=False)
    return middle, directions[0], directions[1]
