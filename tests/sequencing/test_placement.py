"""Places of the robot: reach, blocked bases, order, and the same answer by more processes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dmoc.errors import ProblemError
from planning import demo_station
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing.cycle.placement import (
    Place,
    grid_of_places,
    judge_place,
    moved_station,
    place_station,
)
from sequencing.report.placement_report import base_block, placement_markdown, placement_png


@pytest.fixture(scope="module")
def station() -> Station:
    full = demo_station("stud_welding_a_8")
    return full.replace(studs=full.studs[:3], spin_steps=6)


def test_the_present_place_is_the_station_itself(station: Station) -> None:
    here = judge_place(station, Place())
    found = alternatives(station)
    assert here.alternatives == sum(len(item.alternatives) for item in found)
    assert here.fewest == min(len(item.alternatives) for item in found)
    assert here.unreached == ()
    assert math.isfinite(here.cost)


def test_moving_everything_else_is_the_same_as_moving_the_robot(station: Station) -> None:
    """A turn and a shift keep the tip where the shifted and turned arm carries it."""
    place = Place(0.1, -0.2, 0.0, 0.5)
    q = np.array([0.3, -0.2, 0.4, 0.1, 0.5, -0.3])
    before, after = station.robot.tip_pose(q), moved_station(station, place).robot.tip_pose(q)
    c, s = math.cos(0.5), math.sin(0.5)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    base = station.robot.base.translation
    expected = turn @ (before.translation - base) + base + np.array([0.1, -0.2, 0.0])
    np.testing.assert_allclose(after.translation, expected, atol=1e-12)


def test_far_away_studs_are_named_and_a_base_inside_the_fixture_is_refused(
    station: Station,
) -> None:
    far, blocked = Place(-3.0), Place(1.2)
    found = place_station(station, [far, blocked, Place()])
    assert [item.place for item in found] == [Place(), far, blocked]
    assert found[1].unreached == tuple(stud.id for stud in station.studs)
    assert found[1].cost == math.inf
    assert found[2].reason == "the base meets fixture"
    text = placement_markdown(found)
    assert "1 (present)" in text
    assert "3 studs unreached" in text
    assert "position_m: [0, 0, 0]" in base_block(station, found[0])
    assert placement_png(found, station.name)[:4] == b"\x89PNG"


def test_grid_holds_the_present_place_and_refuses_nonsense() -> None:
    places = grid_of_places(0.2, 0.1, math.pi / 6, math.pi / 12)
    assert len(places) == 5 * 5 * 5
    assert Place() in places
    assert grid_of_places(0.0, 0.1) == (Place(),)
    for span, step in ((-0.1, 0.1), (0.1, 0.0), (0.1, math.nan), (math.inf, 0.1)):
        with pytest.raises(ProblemError, match="placement"):
            grid_of_places(span, step)
