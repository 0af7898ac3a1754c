"""Distances do not depend on what was asked before, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from planning.collision.world import CollisionWorld
from planning.station.build import demo_station


def test_rows_are_the_same_after_other_queries() -> None:
    """coal kept its last support vertices: overlapping pairs changed in the last digits."""
    station = demo_station("stud_welding_a_8")
    robot = station.robot
    rng = np.random.default_rng(2)
    q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (400, robot.num_joints))
    world = CollisionWorld(station)
    deep = q[world.collide_batch(q)][:40]
    assert len(deep) == 40
    forward, backward = CollisionWorld(station).clearance(), CollisionWorld(station).clearance()
    first = [forward.rows(row[None], 0.2) for row in deep]
    second = [backward.rows(row[None], 0.2) for row in deep[::-1]][::-1]
    for a, b in zip(first, second):
        np.testing.assert_array_equal(a.distance_m, b.distance_m)
        np.testing.assert_array_equal(a.gradient, b.gradient)


def test_depths_of_the_scene_take_no_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    """coal's last digits change with what it measured before: nothing that is stored may ask it."""
    station = demo_station("stud_welding_a_8")
    world = CollisionWorld(station)

    def refuse(*_: object) -> None:
        raise AssertionError("the compiled scene asked an engine")

    monkeypatch.setattr(world.scene.engine, "distance", refuse)
    robot = station.robot
    q = np.random.default_rng(2).uniform(
        robot.q_lower_rad, robot.q_upper_rad, (200, robot.num_joints)
    )
    rows = world.clearance().rows(q, 0.2)
    assert rows.distance_m.min() < -0.01
    world.clearance().phi(q)
    world.scene.pair_distance(q[0], 0)
