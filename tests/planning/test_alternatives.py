"""Alternatives of the welds: enough of them, exact, clear, and a reason for every loss."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dmoc.errors import InputError, ProblemError
from planning.collision.world import CollisionWorld
from planning.geometry.shapes import Body, Shape, pose_matrix
from planning.station.build import demo_station
from planning.station.studs import Stud
from planning.welds.alternatives_search import FREE_M, alternatives
from planning.welds.check import check_station
from planning.welds.poses import departure_knots, departure_point, weld_line, weld_poses


@pytest.fixture(scope="module", params=["stud_welding_a", "stud_welding_b", "stud_welding_c"])
def found(request):
    station = demo_station(request.param)
    return station, alternatives(station)


def test_every_stud_has_at_least_four(found):
    _, studs = found
    counts = {item.stud.id: len(item.alternatives) for item in studs}
    assert min(counts.values()) >= 4, counts
    assert 200 <= sum(counts.values()) <= 400


def test_they_weld_within_limits_and_leave_straight(found):
    station, studs = found
    robot = station.robot
    for item in studs:
        stud = item.stud
        for alternative in item.alternatives[::3]:
            tip = robot.tip_pose(alternative.q_rad)
            assert tip.translation == pytest.approx(stud.position_m, abs=1e-9)
            assert tip.rotation[:, 2] == pytest.approx(-stud.normal, abs=1e-9)
            assert np.array_equal(alternative.line_rad[0], alternative.q_rad)
            end = robot.tip_pose(alternative.line_rad[-1])
            goal = stud.position_m + stud.depart_m * stud.depart_direction
            assert end.translation == pytest.approx(goal, abs=1e-9)
            assert np.allclose(end.rotation, tip.rotation, atol=1e-9)
            assert np.all(alternative.line_rad >= robot.q_lower_rad - 1e-9)
            assert np.all(alternative.line_rad <= robot.q_upper_rad + 1e-9)


def test_another_engine_finds_them_clear(found):
    station, studs = found
    world = CollisionWorld(station, engine="coal")
    for item in studs:
        line = weld_line(station, item.stud)
        for alternative in item.alternatives[::5]:
            for q in alternative.line_rad[::5]:
                assert world.collide(q, station.clearance_m - 1e-4, (line,)) is None
            assert world.collide(alternative.line_rad[-1], FREE_M - 1e-4) is None


def test_weld_cost_is_holding_the_arm(found):
    station, studs = found
    cost = station.cost
    for item in studs[::4]:
        alternative = item.alternatives[0]
        torque = station.robot.gravity_torque_nm(alternative.q_rad)
        expected = 2.0 * (cost.time + cost.effort * float(torque @ torque))
        assert alternative.weld_cost == pytest.approx(expected, rel=1e-12)


def test_long_gun_spreads_the_weld_costs():
    """Heavy station C covers the range of weld costs that the paper prints (33 to 472)."""
    studs = alternatives(demo_station("stud_welding_c_heavy"))
    costs = [a.weld_cost for item in studs for a in item.alternatives]
    assert 25 < min(costs) < 40
    assert 300 < max(costs) < 472


def test_knots_on_the_departure_line():
    station = demo_station("stud_welding_a_8")
    item = alternatives(station)[0]
    alternative = item.alternatives[2]
    knots = departure_knots(station, item.stud, alternative.q_rad, [1.0, 0.0, 0.25])
    for fraction in (1.0, 0.25, 1.0):
        alone = departure_knots(station, item.stud, alternative.q_rad, [fraction])[0]
        kept = departure_point(station, item.stud, alternative.q_rad, fraction)
        assert alone.tobytes() == kept.tobytes()
    assert np.allclose(knots[1], alternative.q_rad, atol=1e-12)
    assert np.allclose(knots[0], alternative.line_rad[-1], atol=1e-9)
    tip = station.robot.tip_pose(knots[2]).translation
    goal = item.stud.position_m + 0.25 * item.stud.depart_m * item.stud.depart_direction
    assert tip == pytest.approx(goal, abs=1e-9)
    far = Stud("x", item.stud.position_m, item.stud.normal, 2.0, "", np.array([0, 0, 1.0]), 50.0)
    with pytest.raises(ProblemError, match="departure"):
        departure_knots(station, far, alternative.q_rad, [1.0])


def test_spins_turn_about_the_normal():
    stud = Stud("x", np.ones(3), np.array([0.6, 0, 0.8]), 1.0, "", np.array([0, 0, 1.0]), 0.03)
    poses = weld_poses(stud, 12)
    assert poses.shape == (12, 4, 4)
    assert np.allclose(np.linalg.det(poses[:, :3, :3]), 1.0)
    assert np.allclose(poses[:, :3, 2], -stud.normal)
    assert np.allclose(
        np.einsum("ki,ki->k", poses[:, :3, 0], np.roll(poses[:, :3, 0], 1, 0)), np.cos(np.pi / 6)
    )
    fixed = Stud("x", np.ones(3), stud.normal, 1.0, "", stud.normal, 0.03, spin_free=False)
    assert len(weld_poses(fixed, 12)) == 1


def reasons(station):
    return dict(alternatives(station)[0].reasons)


def test_reasons():
    whole = demo_station("stud_welding_a_8")
    station = replace(whole, studs=whole.studs[:1])
    stud = station.studs[0]
    far = Stud("far", stud.position_m + [5, 0, 0], stud.normal, 2.0, "", stud.normal, 0.03)
    assert reasons(replace(station, studs=(far,))) == {"unreachable": 12}
    assert reasons(station)["joint limit"] > 0
    wall = Body("wall", (Shape("box", (3.0, 3.0, 0.2)),), pose=pose_matrix([1.5, 0, 1.35]))
    blocked = alternatives(replace(station, obstacles=(*station.obstacles, wall)))[0]
    assert blocked.alternatives == ()
    assert blocked.reasons["collision with wall"] > 0
    # A lid above the gun: the weld is free, the way up is not.
    lifted = Stud("s", stud.position_m, stud.normal, 2.0, "", stud.normal, 0.6, on=stud.on)
    assert any("departure" in reason for reason in reasons(replace(station, studs=(lifted,))))
    assert pickle.loads(pickle.dumps(blocked)).reasons == blocked.reasons


def test_part_is_an_obstacle_away_from_the_line():
    """The exception holds for the stud's own part and tip only."""
    whole = demo_station("stud_welding_a_8")
    stud = whole.studs[0]
    elsewhere = Stud(stud.id, stud.position_m, stud.normal, 2.0, "", stud.normal, 0.03, on="")
    result = alternatives(replace(whole, studs=(elsewhere,)))[0]
    assert result.alternatives == ()
    assert result.reasons["collision with underbody"] > 0


def test_check_station_and_a_home_in_collision(tmp_path):
    source = demo_station("stud_welding_a_8").source
    data = check_station(source)
    assert [row["id"] for row in data["studs"]] == [
        s.id for s in demo_station("stud_welding_a_8").studs
    ]
    assert data["errors"] == []
    assert data["configurations"] == sum(row["alternatives"] for row in data["studs"])
    for path in source.parent.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    text = source.read_text().replace("[0, -0.35, 0.35, 0, 0.6, 0]", "[0, 1.2, 0.35, 0, 0.6, 0]")
    (tmp_path / "station.yaml").write_text(text)
    with pytest.raises(InputError, match="home-collision"):
        check_station(tmp_path / "station.yaml")


def test_same_result_twice():
    station = demo_station("stud_welding_a_8")
    first, again = alternatives(station), alternatives(station)
    for a, b in zip(first, again, strict=True):
        assert all(
            np.array_equal(x.q_rad, y.q_rad)
            for x, y in zip(a.alternatives, b.alternatives, strict=True)
        )
