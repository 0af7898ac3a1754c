"""A small cycle of a real robot with quintic motions: what run files and reports are tested on."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.robot.robot import Tool, load_robot
from planning.geometry.shapes import Body, Shape, pose_matrix
from planning.station.station import Station
from planning.station.studs import Stud
from sequencing.cycle_types import (
    Cycle,
    CycleCost,
    CycleMotion,
    Look,
    Search,
    StudRow,
    Tables,
    Weld,
)
from sequencing.gtsp.problem import Tour
from sequencing.runs.result import cost_shares

POSES = {
    "home": [0.0, -0.35, 0.35, 0.0, 0.6, 0.0],
    "S1": [-0.35, 0.35, 0.25, 0.3, 0.7, -0.4],
    "S2": [0.2, 0.45, 0.1, -0.2, 0.8, 0.9],
    "S3": [0.5, 0.15, 0.4, 0.5, 0.6, -1.2],
}


def quintic(robot, start, goal, duration_s=2.5, intervals=16):
    """Rest-to-rest quintic from start to goal with the torques at the intervals' middles."""
    times = np.linspace(0.0, duration_s, intervals + 1)
    delta = np.subtract(goal, start)

    def at(t):
        s = (t / duration_s)[:, None]
        q = start + (10 * s**3 - 15 * s**4 + 6 * s**5) * delta
        v = (30 * s**2 - 60 * s**3 + 30 * s**4) * delta / duration_s
        a = (60 * s - 180 * s**2 + 120 * s**3) * delta / duration_s**2
        return q, v, a

    q, v, _ = at(times)
    torque = inverse_dynamics(robot.model, *at((times[:-1] + times[1:]) / 2))
    return JointTrajectory(times, q, v, torque, robot)


@cache
def sample_station(home: bool = True) -> Station:
    """The heavy arm with a gun in front of a box, three studs where its poses put the tip."""
    gun = Tool(
        mass_kg=40.0,
        com_m=[0.2, 0.0, 0.0],
        inertia_kg_m2=np.diag([1.0, 2.0, 2.0]),
        tip_position_m=[0.35, 0.0, 0.0],
    )
    robot = load_robot("irb6640_class").with_tool(gun)
    shape = Shape("box", (0.35, 0.12, 0.12), pose=pose_matrix((0.175, 0.0, 0.0)))
    studs = tuple(
        Stud(
            name,
            robot.tip_pose(np.array(pose)).translation,
            [0.0, 0.0, 1.0],
            2.0,
            "",
            [0.0, 0.0, 1.0],
            0.03,
        )
        for name, pose in POSES.items()
        if name != "home"
    )
    table = Body("table", (Shape("box", (0.8, 1.6, 0.3)),), pose=pose_matrix((1.9, 0.0, 0.15)))
    return Station(
        name="sample",
        robot=robot,
        tool_bodies=(Body("gun", (shape,), touches=True),),
        obstacles=(table,),
        studs=studs,
        spin_steps=12,
        home_rad=np.array(POSES["home"]) if home else None,
        clearance_m=0.02,
        cost=Cost(),
        precedence=(),
        allowed_collisions=(),
        source=Path("nowhere/station.yaml"),
        fingerprint="5a" * 32,
    )


def sample_cycle(home: bool = True, order: tuple[str, ...] = ("S1", "S3", "S2")) -> Cycle:
    """A cycle through `order`; with home it begins and ends there."""
    station = sample_station(home)
    stops = ["home", *order, "home"] if home else [*order, order[0]]
    motions = []
    for number, (origin, target) in enumerate(pairwise(stops)):
        trajectory = quintic(station.robot, np.array(POSES[origin]), np.array(POSES[target]))
        cost = sum(cost_shares(trajectory, station.cost).values())
        motion = Motion(
            Status.CONVERGED,
            "refined",
            trajectory,
            cost,
            smoothing_cost=0.01,
            iterations=20,
            max_defect=1e-9,
            min_clearance_m=0.021,
            certified=True,
        )
        kind = "home" if "home" in (origin, target) else "travel"
        motions.append(CycleMotion(f"m{number:03d}", origin, target, kind, motion))
    welds = []
    for name in order:
        pose = np.array(POSES[name])
        cost = 2.0 * float(station.cost.holding_rate(station.robot.gravity_torque_nm(pose)))
        welds.append(Weld(name, 1, pose, cost, 2.0))
    travel, welding = sum(m.motion.cost for m in motions), sum(w.cost for w in welds)
    tables = Tables(
        tuple(StudRow(w.stud, 6, w.cost, 2 * w.cost) for w in welds),
        CycleCost(1.2 * travel, 1.5 * welding),
        (400.0, 500.0),
        CycleCost(travel, welding),
    )
    search = Search(
        edges_total=100,
        edges_evaluated=40,
        edges_training=20,
        edges_held_out=10,
        edges_failed=1,
        lower_bound=10.0,
        bound_is_proven=True,
        gap_percent=80.0,
        conditional_factor=0.9,
        coverage_percent=90.9,
        conditional_gap_percent=2.5,
        stopped_by="conditional gap",
        rounds=({"round": 0},),
    )
    return Cycle(
        station=station,
        seed=7,
        method="halfspaces",
        tour=Tour(tuple(range(len(stops) - 1)), travel + welding),
        welds=tuple(welds),
        motions=tuple(motions),
        tables=tables,
        search=search,
        configurations=18,
        unreachable=(("S9", "joint limit (12)"),),
        second_look=Look("python-fcl 0", len(motions), 201 * len(motions), 0),
    )
