"""Distances do not depend on what was asked before, bit for bit."""

from __future__ import annotations

import numpy as np

from planning.station import demo_station
from planning.world import CollisionWorld


def test_rows_are_the_same_after_other_queries() -> None:
    """coal kept its last support vertices: overlapping pairs changed in the last digits."""
    station = demo_station("stud_welding_a_8")
    robot = station.robot
    rng = np.random.default_rng(2)
    q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (400, robot.num_joints))
    world = CollisionWorld(station)
    deep = q[world.collide_batch(q)][:40]
    assert len(deep) == 40
    fresh, used = CollisionWorld(station).clearance(), CollisionWorld(station).clearance()
    used.rows(deep[::-1], 0.2)
    first, second = fresh.rows(deep, 0.2), used.rows(deep, 0.2)
    np.testing.assert_array_equal(first.distance_m, second.distance_m)
    np.testing.assert_array_equal(first.gradient, second.gradient)
