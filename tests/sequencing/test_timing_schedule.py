"""Whole schedules of the pallet cell, cell files, and the promises of every case."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from timing_cells import reaching, stops, two_arms

import planning
from authoring.stations.pallet_cell import author
from dmoc.errors import InputError
from sequencing.timing.cell.read import load_cell
from sequencing.timing.cell.schema import CellFile
from sequencing.timing.clearance.verify import check_obstacles, check_schedule
from sequencing.timing.power.along_path import drive_of
from sequencing.timing.scheduling import schedule, schedule_to_dict
from sequencing.timing.search.prepared import prepare_cell
from sequencing.timing.search.windows import make_windows
from studies.pallet_cell.study import first_trajectories, pallet_cell, traces

CELL_FOLDER = Path(planning.__file__).parent / "stations" / "pallet_cell"


@pytest.fixture(scope="module")
def small():
    return first_trajectories(pallet_cell(), 4)


@pytest.fixture(scope="module")
def found(small):
    return schedule(small, seed=1)


def case(found, name):
    return next(c for c in found.cases if c.name == name)


def test_the_cell_has_three_robots_with_39_trajectories_each() -> None:
    cell = pallet_cell()
    assert [len(r.trajectories) for r in cell.robots] == [39, 39, 39]
    assert len(cell.handovers) == 38


def test_the_waypoints_are_what_the_author_script_writes(tmp_path) -> None:
    author(tmp_path)
    for name in ("north", "west", "east"):
        kept = np.genfromtxt(CELL_FOLDER / name / "waypoints.csv", delimiter=",", skip_header=1)
        made = np.genfromtxt(tmp_path / name / "waypoints.csv", delimiter=",", skip_header=1)
        np.testing.assert_allclose(made[:, 1:], kept[:, 1:], atol=1e-6)


def test_its_paths_keep_clear_of_the_obstacles(small) -> None:
    assert check_obstacles(small) == []


def test_process_time_is_unchanged_and_nothing_is_worse_than_the_start(found) -> None:
    fast = case(found, "as-fast-as-possible")
    for item in found.cases:
        assert item.timing.total_s == pytest.approx(fast.timing.total_s, abs=1e-9)
    assert case(found, "windows").energy_j <= fast.energy_j
    free = case(found, "free-running")
    assert found.baseline == "free-running"
    assert free.collisions == 0
    assert (free.timing.override == 1.0).all()
    assert free.energy_j <= fast.energy_j  # no robot stops because another has not arrived
    assert free.saving_with_base_percent == free.saving_percent == 0.0
    best = case(found, found.best)
    assert best.saving_percent == pytest.approx(100 * (1 - best.energy_j / free.energy_j))
    assert 0 < best.saving_with_base_percent < best.saving_percent
    assert case(found, "windows").energy_j <= case(found, "stretched").energy_j * 1.001
    assert case(found, "general").energy_j < case(found, "windows").energy_j


def test_the_answer_is_free_of_collisions_in_continuous_time(small, found) -> None:
    assert str(found.status) == "converged"
    assert check_schedule(small, found.start_s, found.override) == []
    for name in ("windows", "general"):
        assert case(found, name).collisions == 0


def test_order_handovers_and_total_time_are_kept_by_every_case(small, found) -> None:
    flat = np.concatenate(small.durations_s)
    for item in found.cases:
        timing = item.timing
        end = timing.start_s + flat / timing.override
        assert (timing.override <= 1 + 1e-9).all()
        assert (end <= timing.total_s + 1e-9).all()
        for a, b in small.handovers:
            assert timing.start_s[b] >= end[a] - 1e-9
        for first, last in zip(small.first, small.first[1:]):
            assert (timing.start_s[first + 1 : last] >= end[first : last - 1] - 1e-9).all()


def test_same_seed_same_schedule(small, found) -> None:
    again = schedule(small, seed=1)
    np.testing.assert_array_equal(again.start_s, found.start_s)
    np.testing.assert_array_equal(again.override, found.override)


def test_json_is_plain_and_complete(found) -> None:
    data = json.loads(json.dumps(schedule_to_dict(found)))
    wanted = {"name", "energy_j", "saving_with_base_percent", "duration_s", "collisions", "cpu_s"}
    assert all(wanted <= set(item) for item in data["cases"])
    assert set(data["start_s"]) == {"north", "west", "east"}
    for share in data["torque_share"].values():
        assert 0 < share["scheduled"] <= share["full_speed"] + 1e-9
    assert all(len(row) == 4 for row in data["override"].values())


def test_grid_power_is_never_negative_and_adds_up(small, found) -> None:
    assert (found.power_w >= 0).all()
    prepared = prepare_cell(small)
    shown = traces(prepared, found.start_s, found.override, case(found, found.best).timing.total_s)
    assert shown["robot_w"].shape[0] == 3
    longest = [max(t.duration_s for t in robot.trajectories) for robot in small.robots]
    assert shown["relative_speed"][int(np.argmax(longest))].max() == pytest.approx(1.0)
    # What the robots draw comes from the grid; the rest of it is lost or left in the capacitor.
    assert shown["robot_w"].sum() <= shown["grid_w"].sum() * (1 + 1e-9)


def test_separate_links_never_need_less_than_a_common_one(small) -> None:
    apart = replace(small, links=small.links * 3, link_of=(0, 1, 2))
    fast = np.ones(small.first[-1])
    windows = make_windows(prepare_cell(small))
    start = np.concatenate([windows.edges_s[:-1]] * 3)
    common = replace(
        small, links=(replace(small.links[0], capacitance_f=3 * small.links[0].capacitance_f),)
    )
    total = float(windows.edges_s[-1])
    one = prepare_cell(common).evaluate(start, fast, total).link_j
    three = prepare_cell(apart).evaluate(start, fast, total).link_j
    assert one <= three + 1e-6


def test_where_full_speed_collides_waiting_parts_the_robots_and_the_rest_still_saves() -> None:
    cell = two_arms(reaching(2), reaching(1), 1.5, facing=True, clearance_m=0.03)
    found = schedule(cell, seed=0)
    cases = {case.name: case for case in found.cases}
    assert cases["as-fast-as-possible"].collisions > 0
    assert cases["separated"].collisions == 0
    full_speed = next(
        name
        for name in ("free-running", "as-fast-as-possible", "separated")
        if name in cases and cases[name].collisions == 0
    )
    assert found.baseline == full_speed
    assert cases[full_speed].saving_percent == 0.0
    assert str(found.status) == "converged"
    assert found.best == "general"
    # Freezing what meets would leave next to nothing; the swarm goes round the collision.
    assert cases["general"].energy_j < 0.97 * cases["separated"].energy_j
    assert check_schedule(cell, found.start_s, found.override) == []


def test_robots_inside_each_other_have_no_schedule() -> None:
    found = schedule(two_arms(stops(1, 3), stops(2, 3), 0.1), seed=0)
    assert str(found.status) == "in_collision"
    assert all(case.collisions > 0 for case in found.cases)
    assert "contacts" in schedule_to_dict(found)["advice"]


def test_without_slack_nothing_is_delayed() -> None:
    chain = tuple((k, k + 3) for k in range(3)) + tuple((k + 3, k + 1) for k in range(2))
    cell = two_arms(stops(1, 4), stops(2, 4), handovers=chain)
    found = schedule(cell, seed=0)
    fast = found.cases[0]
    assert str(found.status) == "converged"
    np.testing.assert_allclose(found.override, 1.0, atol=1e-6)
    assert found.energy_j == pytest.approx(fast.energy_j, rel=1e-6)


def test_robots_of_two_makes_on_links_of_their_own() -> None:
    cell = two_arms(stops(1, 3), stops(2, 3))
    other = pallet_cell().robots[0]
    big = replace(
        other,
        trajectories=other.trajectories[:2],
        loaded=other.loaded[:2],
        labels=other.labels[:2],
        pause_s=other.pause_s[:2],
        wrench=other.wrench[:2],
        robot=other.robot,
    )
    mixed = replace(
        cell, robots=(cell.robots[0], big), links=cell.links * 2, link_of=(0, 1), base_load_w=350.0
    )
    found = schedule(mixed, seed=0)
    assert str(found.status) == "converged"
    for item in found.cases:
        constant = item.total_j - item.energy_j
        watts = 350.0 + sum(drive_of(r.robot).base_power_w for r in mixed.robots)
        assert constant == pytest.approx(watts * item.timing.total_s)


def write_cell(folder: Path, change) -> Path:
    text = (CELL_FOLDER / "cell.yaml").read_text(encoding="utf-8")
    for name in ("north", "west", "east"):
        (folder / name).mkdir(exist_ok=True)
        rows = (CELL_FOLDER / name / "waypoints.csv").read_text(encoding="utf-8")
        (folder / name / "waypoints.csv").write_text(rows, encoding="utf-8")
    (folder / "cell.yaml").write_text(change(text), encoding="utf-8")
    return folder / "cell.yaml"


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda s: s.replace("name: west\n", "name: north\n", 1), "name-twice"),
        (lambda s: s.replace("north/0,", "north/99,"), "handover"),
        (lambda s: s.replace("chopper_v: 760.0", "chopper_v: 500.0"), "link-order"),
        (lambda s: s.replace("trajectories: north", "trajectories: nowhere"), "motions-missing"),
        (lambda s: s.replace("model: irb6640_class", "model: hal9000", 1), "robot-missing"),
        (lambda s: s.replace("shared: true", "shared: [[north, west]]"), "link-groups"),
        (lambda s: s.replace("capacitance_f: 6.0e-3", "capacitance_f: -1"), "value-range"),
        (lambda s: s + "surprise: 1\n", "field-unknown"),
    ],
)
def test_bad_cells_are_refused_with_a_code(tmp_path, change, code) -> None:
    with pytest.raises(InputError) as caught:
        load_cell(write_cell(tmp_path, change))
    assert code in {fault.code for fault in caught.value.faults}
    assert all(fault.file for fault in caught.value.faults)


def test_several_faults_are_reported_at_once(tmp_path) -> None:
    def change(text):
        text = text.replace("trajectories: north", "trajectories: nowhere")
        return text.replace("model: irb6640_class", "model: hal9000", 1).replace(
            "chopper_v: 760.0", "chopper_v: 500.0"
        )

    with pytest.raises(InputError) as caught:
        load_cell(write_cell(tmp_path, change))
    assert len(caught.value.faults) >= 2


def test_a_jump_between_waypoints_of_an_archive_is_refused(tmp_path) -> None:
    file = write_cell(tmp_path, lambda s: s)
    motion = pallet_cell().robots[0].trajectories
    arrays = {}
    for k, t in enumerate((motion[0], motion[2])):
        for name in ("t_s", "q_rad", "velocity_rad_s", "torque_nm"):
            arrays[f"m{k:03d}/{name}"] = getattr(t, name)
    (tmp_path / "north" / "waypoints.csv").unlink()
    np.savez(tmp_path / "north" / "motions.npz", **arrays)
    with pytest.raises(InputError, match="motions-gap"):
        load_cell(file)


def test_the_schema_is_published() -> None:
    assert CellFile.model_json_schema()["properties"]["robots"]["maxItems"] == 20
