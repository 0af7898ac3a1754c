"""pyroboplan on the same scenes, where it is installed (it is no dependency of the project).

Its bidirectional RRT-connect plans on the same convex pieces and the same pairs, through
pinocchio and coal, until it succeeds or its time is up.
"""

from __future__ import annotations

import time
from importlib.util import find_spec

import numpy as np
import pinocchio as pin

from benchmarks.mbm import Problem
from planning.collision.coal_engine import coal_geometry

__all__ = ["has_pyroboplan", "pyroboplan_ms"]

BUDGET_S = 2.0
STEP_RAD, CONNECT_RAD = 0.05, 1.0


def has_pyroboplan() -> bool:
    """Whether the peer can be asked."""
    return find_spec("pyroboplan") is not None and find_spec("meshcat") is not None


def pyroboplan_ms(problem: Problem, seed: int) -> tuple[bool, float]:
    """Whether it reached the goal, and its CPU time [ms]; building its model is not counted."""
    from pyroboplan.planning.rrt import RRTPlanner, RRTPlannerOptions

    scene, model = problem.world.scene, problem.world.robot.model
    geometry, first = pin.GeometryModel(), {}
    for number, piece in enumerate(scene.pieces):
        placement = pin.SE3(np.array(piece.pose))
        item = pin.GeometryObject(
            f"{piece.body}_{number}", piece.joint, placement, coal_geometry(piece)
        )
        first[number] = geometry.addGeometryObject(item)
    for a, b in scene.pairs.piece:
        geometry.addCollisionPair(pin.CollisionPair(first[int(a)], first[int(b)]))
    options = RRTPlannerOptions(
        max_step_size=STEP_RAD,
        max_connection_dist=CONNECT_RAD,
        rrt_connect=True,
        bidirectional_rrt=True,
        max_planning_time=BUDGET_S,
        rng_seed=seed,
    )
    planner = RRTPlanner(model, geometry, options)
    begin = time.process_time()
    path = planner.plan(problem.start_rad, problem.goal_rad)
    spent = 1e3 * (time.process_time() - begin)
    # Out of time it returns what it has: a path counts if it arrives.
    return bool(path) and np.allclose(path[-1], problem.goal_rad), spent
