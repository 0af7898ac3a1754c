"""Warming up changes no answer."""

import numpy as np
import pytest
from scenes import clutter, random_q
from test_world import GUN, ROBOT

from planning.collision.warming import warm_up
from planning.collision.world import world_for


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("engine", ["native", "coal"])
def test_answers_are_those_of_a_fresh_world(reverse: bool, engine: str) -> None:
    q = random_q(ROBOT, 20, 4)
    fresh, warm = (world_for(ROBOT, GUN, clutter(2), engine=engine) for _ in range(2))
    warm_up(warm, reverse)
    assert np.array_equal(fresh.clearance().phi(q), warm.clearance().phi(q))
    assert np.array_equal(fresh.collide_batch(q), warm.collide_batch(q))
    rows = [world.clearance().rows(q, 0.2) for world in (fresh, warm)]
    assert np.array_equal(rows[0].gradient, rows[1].gradient)
