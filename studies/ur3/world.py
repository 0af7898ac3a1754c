"""What the arm of the UR3 study may touch: itself, the table, and obstacles that are put there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from planning.collision.world import CollisionWorld, world_for
from planning.geometry.shapes import Body, Shape
from studies.ur3.bezier_motion import BezierMotion

#: Curves in a search keep this distance at their samples [m].
SEARCH_CLEARANCE_M = 0.005


def box(name: str, size_m: tuple[float, float, float], centre_m: tuple[float, ...]) -> Body:
    """A box obstacle with edges along the axes."""
    pose = np.eye(4)
    pose[:3, 3] = centre_m
    return Body(name, (Shape("box", size_m),), pose=pose)


def tabletop_world(robot: Robot, obstacles: tuple[Body, ...] = ()) -> CollisionWorld:
    """The robot on a 1.4 m square table whose top is at z = 0; the base may touch it."""
    table = box("table", (1.4, 1.4, 0.05), (0.0, 0.0, -0.025))
    allowed = (*robot.allowed_collisions, ("table", "base_link"))
    return world_for(robot, (), (table, *obstacles), allowed, clearance_m=0.0)


def forbidden_in(world: CollisionWorld) -> Callable[[Array], npt.NDArray[np.bool_]]:
    """Which of sampled curves (P, K, n) come nearer than 5 mm to anything, at their samples."""

    def forbidden(curves: Array) -> npt.NDArray[np.bool_]:
        flat = np.ascontiguousarray(curves.reshape(-1, curves.shape[-1]))
        hit = world.collide_batch(flat, SEARCH_CLEARANCE_M)
        return np.asarray(hit.reshape(curves.shape[:-1]).any(axis=-1))

    return forbidden


PRICE = 2e6


def avoid_in(
    world: CollisionWorld, margin_m: float = 0.015
) -> Callable[[Array], tuple[Array, Array]]:
    """Price·(margin − d)² per pair nearer than the margin, and its gradient, for samples (K, n).

    The price is in units of the metric per second and square metre. Zero at margin and beyond.
    """
    clearance = world.clearance(tracking_error_m=0.0)

    def avoid(q: Array) -> tuple[Array, Array]:
        rows = clearance.rows(q, margin_m)
        gap = np.maximum(margin_m - rows.distance_m, 0.0)
        rate, slope = np.zeros(len(q)), np.zeros_like(q)
        np.add.at(rate, rows.knot, PRICE * gap * gap)
        np.add.at(slope, rows.knot, -2.0 * PRICE * gap[:, None] * rows.gradient)
        return rate, slope

    return avoid


def touches(
    world: CollisionWorld, motion: BezierMotion | JointTrajectory, num_samples: int = 1000
) -> tuple[str, str] | None:
    """A pair that touches at one of `num_samples` times of a motion, or None."""
    t = np.linspace(0.0, motion.duration_s, num_samples)
    if isinstance(motion, BezierMotion):
        q = motion.derivative(t, 0)
    else:
        q = motion.sample(motion.t_s[0] + t).q_rad
    hit = np.flatnonzero(world.collide_batch(q))
    return None if hit.size == 0 else world.collide(q[hit[0]])
