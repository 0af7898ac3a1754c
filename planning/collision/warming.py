"""Have every kernel of a world compiled, so that processes that start together share the work."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.programme.builder import Families
from dmoc.programme.guess import straight_guess
from dmoc.refinement import RefineParams
from dmoc.robot.robot import Robot
from dmoc.solving.nlp import solve_nlp
from planning.collision.certificate import prove_path
from planning.collision.world import CollisionWorld


def warm_up(world: CollisionWorld, reverse: bool = False) -> None:
    """Ask every query once; nothing is kept of the answers.

    On a fresh machine each kernel is compiled by the first process that needs it and read from the
    cache folder by the others. Two processes that begin at opposite ends (`reverse`) compile
    different kernels at the same time. Afterwards this costs milliseconds.
    """
    scene, edge = world.scene, world.clearance()
    q = np.vstack([world.robot.q_lower_rad, world.robot.q_upper_rad])
    queries = (
        lambda: edge.rows(q, world.clearance_m),
        lambda: edge.phi(q),
        lambda: scene.segment_contact(q[0], q[1], 1e3, 0.0, scene.everything),
        lambda: prove_path(edge, q, max_depth=1),
        lambda: _solve_something(world.robot, q),
    )
    for query in reversed(queries) if reverse else queries:
        query()


def _solve_something(robot: Robot, limits: Array) -> None:
    """A short motion with every kind of row that refinement has."""
    middle = limits.mean(axis=0)
    problem = MotionProblem(robot, middle, 0.9 * middle + 0.1 * limits[1], num_intervals=10)
    families = Families(velocity=True, acceleration=True)
    solve_nlp(problem, straight_guess(problem), params=RefineParams().loose, families=families)
