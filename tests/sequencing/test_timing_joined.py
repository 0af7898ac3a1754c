"""Two planned stations on one link: reading runs, and (slow) from station to timing."""

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.errors import InputError
from planning import demo_station
from sequencing.timing.cell import from_run as run_robot
from sequencing.timing.cell.read import load_cell
from sequencing.timing.clearance.verify import check_fixtures, check_schedule
from sequencing.timing.scheduling import schedule
from studies.pallet_cell.joined import write_joined_cell


def fake_run(station, stops, weld_s: float, name: str, fingerprint: str | None = None):
    """What `read_run` gives for a run of trapezoids home -> welds -> home."""
    names = ["home", *[f"S{k:02d}" for k in range(len(stops) - 2)], "home"]
    motions = [
        SimpleNamespace(
            origin=names[k],
            target=names[k + 1],
            kind="travel",
            motion=SimpleNamespace(trajectory=trapezoid_motion(station.robot, a, b)),
        )
        for k, (a, b) in enumerate(itertools.pairwise(stops))
    ]
    return SimpleNamespace(
        name=name,
        folder=Path("gone"),
        robot=station.robot,
        robot_note="",
        motions=tuple(motions),
        welds=tuple(SimpleNamespace(stud=n, time_s=weld_s) for n in names[1:-1]),
        result={
            "robot": {"fingerprint": fingerprint or station.robot.fingerprint},
            "inputs": {"station_fingerprint": "of a part of it"},
        },
    )


@pytest.fixture
def runs(monkeypatch):
    station = demo_station("stud_welding_a_8")
    home = np.array(station.home_rad)
    rng = np.random.default_rng(4)
    made = {}
    for name, welds in (("left", 2), ("right", 4)):
        stops = [home, *[home + rng.uniform(-0.3, 0.3, 6) for _ in range(welds)], home]
        made[name] = fake_run(station, stops, 1.5, station.name)
    monkeypatch.setattr(run_robot, "read_run", lambda folder: made[folder.name])
    return made


def test_runs_become_a_cell_that_is_timed_without_collisions(tmp_path, runs) -> None:
    cell = load_cell(write_joined_cell(tmp_path, tmp_path / "left", tmp_path / "right"))
    assert [len(r.trajectories) for r in cell.robots] == [3, 5]
    assert cell.robots[0].pause_s == (1.5, 1.5, 0.0)
    assert cell.robots[1].robot.base.translation[0] == 5.4
    assert {body.name for body in cell.robots[0].tool_bodies} >= {"gun_arm", "gun_tip"}
    assert len(cell.robots[0].fixtures) == 8
    found = schedule(cell, seed=0)
    fast = found.cases[0]
    assert str(found.status) == "converged"
    assert found.fixture_contacts == ()
    assert found.order is None  # welding robots stand still: no windows
    assert found.energy_j < fast.energy_j
    assert check_schedule(cell, found.start_s, found.override) == []
    assert check_fixtures(cell) == []
    end = found.start_s + found.duration_s
    for r, item in enumerate(cell.robots):
        a, b = cell.first[r], cell.first[r + 1]
        rest = found.start_s[a + 1 : b] - end[a : b - 1]
        assert (rest >= np.array(item.pause_s[:-1]) - 1e-9).all()


def test_an_arm_in_the_other_stations_fixtures_is_seen(tmp_path, runs) -> None:
    """No timing mends it, so there is no answer, and the contact is named."""
    cell = load_cell(write_joined_cell(tmp_path, tmp_path / "left", tmp_path / "right", 2.6))
    contacts = check_fixtures(cell)
    assert any(contact.distance_m <= 0.0 for contact in contacts)
    # Moved with its robot: the right station's ground lies under the right robot.
    ground = next(b for b in cell.robots[1].fixtures if b.name == "ground")
    np.testing.assert_allclose(ground.pose[:2, 3], [2.6 - 1.2, 0.15], atol=1e-9)


def test_an_unknown_tool_is_refused_rather_than_left_out(tmp_path, runs) -> None:
    runs["left"].result["robot"]["fingerprint"] = "changed"
    with pytest.raises(InputError, match="run-tool"):
        load_cell(write_joined_cell(tmp_path, tmp_path / "left", tmp_path / "right"))


@pytest.mark.slow
def test_two_planned_stations_are_timed_on_one_link(tmp_path) -> None:
    from sequencing import plan_station, write_run

    station = demo_station("stud_welding_a_8")
    for name, studs in (("left", station.studs[:3]), ("right", station.studs[4:])):
        part = replace(station, studs=studs, fingerprint=f"{station.fingerprint}-{name}")
        write_run(plan_station(part, seed=0), tmp_path / name, {})
    cell = load_cell(write_joined_cell(tmp_path, tmp_path / "left", tmp_path / "right"))
    found = schedule(cell, seed=0)
    assert str(found.status) == "converged"
    assert found.energy_j < found.cases[0].energy_j
    assert check_schedule(cell, found.start_s, found.override) == []
    assert check_fixtures(cell) == []
    assert found.fixture_contacts == ()
