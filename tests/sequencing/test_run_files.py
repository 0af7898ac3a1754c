"""A run written and read back: same arrays, same bytes, damage noticed."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from sample_cycle import quintic, sample_cycle

from dmoc.errors import InputError
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.robot.robot import load_robot
from sequencing.commands.console import Console
from sequencing.commands.runs import run_compare, run_view
from sequencing.commands.solve import run_solve
from sequencing.cycle_types import CycleMotion
from sequencing.report.markup import markdown_html
from sequencing.runs.archive import json_text, npz_bytes, write_atomic
from sequencing.runs.clock import timeline
from sequencing.runs.compare import compare_runs, comparison_text, differences
from sequencing.runs.folder import read_run, station_of, write_motions, write_run
from sequencing.runs.result import cost_shares, result_of
from sequencing.runs.tables import tables_markdown


def written(tmp_path, cycle=None, name="run"):
    write_run(cycle or sample_cycle(), tmp_path / name, {"wall_s": 1.0})
    return tmp_path / name


def test_a_run_is_read_back_exactly(tmp_path):
    cycle = sample_cycle()
    run = read_run(written(tmp_path, cycle))
    assert run.name == "sample"
    assert run.robot is not None
    assert run.robot.fingerprint == cycle.station.robot.fingerprint
    for before, after in zip(cycle.motions, run.motions, strict=True):
        assert (before.key, before.origin, before.target, before.kind) == (
            after.key,
            after.origin,
            after.target,
            after.kind,
        )
        for field in ("t_s", "q_rad", "velocity_rad_s", "torque_nm"):
            assert np.array_equal(
                getattr(before.motion.trajectory, field), getattr(after.motion.trajectory, field)
            )
        assert before.motion.replace(trajectory=None) == after.motion.replace(trajectory=None)
    for before, after in zip(cycle.welds, run.welds, strict=True):
        assert np.array_equal(before.q_rad, after.q_rad)
        assert (before.stud, before.cost, before.time_s) == (after.stud, after.cost, after.time_s)


def test_the_contract_of_result_json(tmp_path):
    folder = written(tmp_path)
    result = json.loads((folder / "result.json").read_text())
    keys = {
        "key",
        "from",
        "to",
        "kind",
        "status",
        "source",
        "certified",
        "min_clearance_m",
        "cost",
        "duration_s",
    }
    assert all(keys <= set(item) for item in result["motions"])
    assert all(
        {"stud", "alternative", "q_rad", "cost", "time_s"} <= set(w) for w in result["welds"]
    )
    assert result["robot"]["provenance"]["mass"] == "assumed"
    assert result["search"]["bound_is_proven"] is True
    assert {"numpy", "casadi", "pin", "python"} <= set(result["versions"])
    assert {"robot/robot.yaml", "robot/irb6640_class.urdf"} <= set(result["inputs"]["files"])
    with np.load(folder / "motions.npz") as archive:
        assert {f"m000/{k}" for k in ("t_s", "q_rad", "velocity_rad_s", "torque_nm")} <= set(
            archive.files
        )
    assert "wall_s" not in (folder / "result.json").read_text()


def test_the_same_cycle_gives_the_same_bytes(tmp_path):
    folders = [written(tmp_path, name=name) for name in ("a", "b")]
    for name in ("result.json", "motions.npz", "tables.md", "motions/m001_S1_S3.csv"):
        first, second = ((folder / name).read_bytes() for folder in folders)
        assert first == second, name


def test_the_archive_does_not_depend_on_the_clock(monkeypatch):
    before = npz_bytes({"a/b": np.arange(3.0)})
    monkeypatch.setattr("time.time", lambda: 2e9)
    monkeypatch.setattr("time.localtime", lambda *_: (2033, 5, 18, 3, 33, 20, 2, 138, 0))
    assert npz_bytes({"a/b": np.arange(3.0)}) == before


def test_csv_is_the_common_interpolant_with_units(tmp_path):
    folder = written(tmp_path)
    path = folder / "motions" / "m000_home_S1.csv"
    header = path.read_text().splitlines()[0].split(",")
    assert header[0] == "t_s"
    assert {"q1_rad", "velocity6_rad_s", "acceleration3_rad_s2", "torque2_nm", "control2_nm"} <= (
        set(header)
    )
    values = np.genfromtxt(path, delimiter=",", names=True)
    trajectory = sample_cycle().motions[0].motion.trajectory
    sample = trajectory.sample(values["t_s"])
    np.testing.assert_allclose(values["q2_rad"], sample.q_rad[:, 1], atol=1e-12)
    np.testing.assert_allclose(values["torque3_nm"], sample.torque_nm[:, 2], atol=1e-6)
    assert values["t_s"][-1] == trajectory.duration_s
    assert len(values) == 4 * trajectory.num_intervals + 1


def test_an_older_run_leaves_no_motion_behind(tmp_path):
    folder = written(tmp_path, sample_cycle(order=("S1", "S2", "S3")))
    (folder / "motions" / "notes.csv").write_text("mine")
    written(tmp_path, sample_cycle(order=("S3", "S1")))
    assert sorted(p.name for p in (folder / "motions").iterdir()) == [
        "m000_home_S3.csv",
        "m001_S3_S1.csv",
        "m002_S1_home.csv",
        "notes.csv",
    ]
    assert len(read_run(folder).motions) == 3


@pytest.mark.parametrize(
    ("harm", "code"),
    [
        (lambda f: (f / "result.json").unlink(), "run-missing"),
        (lambda f: (f / "result.json").write_text("{"), "run-damaged"),
        (lambda f: (f / "result.json").write_text("[]"), "run-damaged"),
        (lambda f: _edit(f, robot={"name": "irb6640_class"}), "run-damaged"),
        (lambda f: _edit(f, motions=[{"key": "m000"}]), "run-damaged"),
        (lambda f: _edit(f, welds=7), "run-damaged"),
        (lambda f: (f / "motions.npz").unlink(), "run-mixed"),
        (lambda f: (f / "motions.npz").write_bytes(b"PK"), "run-mixed"),
        (lambda f: _edit(f, schema_version=99), "run-version"),
    ],
)
def test_a_damaged_run_is_one_coded_error(tmp_path, harm, code):
    folder = written(tmp_path)
    harm(folder)
    with pytest.raises(InputError) as caught:
        read_run(folder)
    assert [fault.code for fault in caught.value.faults] == [code]


def _edit(folder, **changes):
    data = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps(data | changes))


def test_a_changed_robot_is_not_used_for_torques(tmp_path):
    folder = written(tmp_path)
    data = json.loads((folder / "result.json").read_text())
    data["robot"]["tool"]["mass_kg"] += 1.0
    (folder / "result.json").write_text(json.dumps(data))
    run = read_run(folder)
    assert run.robot is None
    assert "changed" in run.robot_note
    assert len(run.trajectories) == 4


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file.txt"
    write_atomic(path, "old")

    def no_space(*_):
        raise OSError("no space left")

    monkeypatch.setattr("os.replace", no_space)
    with pytest.raises(OSError, match="no space"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_numbers_that_are_not_finite_become_null():
    text = json_text({"a": float("inf"), "b": np.float64("nan"), "c": np.array([0.1])})
    assert json.loads(text) == {"a": None, "b": None, "c": [0.1]}


def test_the_shares_add_up_to_the_cost():
    cycle = sample_cycle()
    trajectory = cycle.motions[0].motion.trajectory
    shares = cost_shares(trajectory, Cost(time=2.0, effort=3e-6, velocity=0.5))
    h = np.diff(trajectory.t_s)
    naive = 0.0
    for k in range(trajectory.num_intervals):
        speed = (trajectory.q_rad[k + 1] - trajectory.q_rad[k]) / h[k]
        within = (trajectory.velocity_rad_s[k + 1] - trajectory.velocity_rad_s[k]) ** 2 / 12
        naive += h[k] * (2 + 3e-6 * np.sum(trajectory.torque_nm[k] ** 2))
        naive += h[k] * 0.5 * np.sum(speed**2 + within)
    assert sum(shares.values()) == pytest.approx(naive, rel=1e-12)


@pytest.mark.parametrize("home", [True, False])
def test_the_timeline_is_the_cycle_without_holes(home):
    cycle = sample_cycle(home=home)
    line = timeline(cycle.welds, cycle.motions)
    assert line.duration_s == pytest.approx(cycle.duration_s)
    ends = [segment.end_s for segment in line.segments]
    assert [segment.start_s for segment in line.segments[1:]] == ends[:-1]
    clock = 0.0
    for index, item in enumerate(cycle.motions):
        if 0 <= (weld := index - home) < len(cycle.welds):
            held = cycle.welds[weld]
            found = line.at(np.array([clock + 0.5 * held.time_s])).q_rad[0]
            np.testing.assert_allclose(found, held.q_rad, atol=1e-9)
            clock += held.time_s
        t = item.motion.trajectory.t_s
        times = np.linspace(t[0], t[-1], 50)
        joints = item.motion.trajectory.sample(times).q_rad
        np.testing.assert_allclose(line.at(clock + times - t[0]).q_rad, joints, atol=1e-9)
        clock += t[-1] - t[0]
    steps = np.diff(line.at(np.linspace(0, line.duration_s, 2000)).q_rad, axis=0)
    assert np.max(np.abs(steps)) < 0.02


def test_torques_of_the_timeline_hold_gravity_while_welding():
    cycle = sample_cycle()
    line = timeline(cycle.welds, cycle.motions)
    weld = next(s for s in line.segments if s.kind == "weld")
    state = line.at(np.array([weld.start_s + 1.0]), cycle.station.robot)
    np.testing.assert_allclose(
        state.torque_nm[0], cycle.station.robot.gravity_torque_nm(cycle.welds[0].q_rad)
    )
    assert not np.any(state.velocity_rad_s)


def test_comparing_runs_names_what_differs(tmp_path):
    cycle = sample_cycle()
    first = read_run(written(tmp_path, cycle, "a"))
    assert compare_runs(first, first)["identical"] is True
    slower = quintic(
        cycle.station.robot,
        cycle.motions[1].motion.trajectory.q_rad[0],
        cycle.motions[1].motion.trajectory.q_rad[-1],
        duration_s=3.0,
    )
    changed = list(cycle.motions)
    changed[1] = replace(changed[1], motion=changed[1].motion.replace(trajectory=slower, cost=99.0))
    moved = replace(cycle.welds[0], alternative=4)
    other = replace(cycle, motions=tuple(changed), welds=(moved, *cycle.welds[1:]), seed=8)
    report = compare_runs(first, read_run(written(tmp_path, other, "b")))
    assert report["identical"] is False
    assert report["seed"] == [7, 8]
    assert report["same_order"] is True
    assert report["moved_poses"] == [{"stud": "S1", "a": 1, "b": 4}]
    assert report["duration_s"]["b"] - report["duration_s"]["a"] == pytest.approx(0.5)
    assert report["motions"]["common"][1]["cost"]["b"] == 99.0
    json_text(report)
    text = comparison_text(report)
    assert "Stud S1: alternative 1 in a, 4 in b" in text
    assert "| J S1 → S3 |" in text
    assert comparison_text(compare_runs(first, first)) == "The runs are identical."


def change_motion(cycle, **changes):
    """`cycle` with its second motion changed."""
    item = cycle.motions[1]
    changed = replace(item, motion=item.motion.replace(**changes))
    return replace(cycle, motions=(cycle.motions[0], changed, *cycle.motions[2:]))


def change_weld(cycle, **changes):
    """`cycle` with its first weld changed."""
    return replace(cycle, welds=(replace(cycle.welds[0], **changes), *cycle.welds[1:]))


NAMED = {"solver": "structured", "planner": "ompl", "method": "half-spaces"}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda c: change_motion(c, **NAMED, cost=c.motions[1].motion.cost * (1 + 1e-5)), "/cost"),
        (lambda c: change_motion(c, **NAMED | {"solver": "ipopt"}), "/solver"),
        (lambda c: change_motion(c, **NAMED | {"planner": "compiled"}), "/planner"),
        (lambda c: change_motion(c, **NAMED | {"method": "boxes"}), "/method"),
        (lambda c: change_motion(c, **NAMED, certified=False), "/certified"),
        (lambda c: change_weld(change_motion(c, **NAMED), cost=c.welds[0].cost + 1.0), "/cost"),
        (lambda c: change_weld(change_motion(c, **NAMED), alternative=2), "/alternative"),
        (lambda c: sample_cycle(order=("S3", "S1", "S2")), "order"),
    ],
)
def test_a_tolerance_lists_what_differs_and_exits_1(tmp_path, change, place):
    cycle = sample_cycle()
    first = written(tmp_path, change_motion(cycle, **NAMED), "a")
    second = written(tmp_path, change(cycle), "b")
    outcome = run_compare(Console(json=True), first, second, None, 1e-6)
    assert outcome.exit_code == 1
    assert any(place in line for line in outcome.data["differences"])
    assert run_compare(Console(json=True), first, first, None, 0.0).exit_code == 0
    assert run_compare(Console(json=True), first, second, None).exit_code == 0


def test_within_the_tolerance_and_without_names_runs_are_equal(tmp_path):
    cycle = sample_cycle()
    first = written(tmp_path, cycle, "a")
    near = change_motion(cycle, **NAMED, cost=cycle.motions[1].motion.cost * (1 + 1e-8))
    outcome = run_compare(Console(json=True), first, written(tmp_path, near, "b"), None, 1e-6)
    assert (outcome.exit_code, outcome.data["differences"]) == (0, [])


def test_differences_see_numbers_lists_keys_and_kinds():
    known = {"a": [1.0, 2.0], "b": {"c": None}, "d": True}
    assert differences(known, {"a": [1.0, 2.0 + 1e-7], "b": {"c": None}, "d": True}, 1e-6) == []
    assert differences({"big": 1e6}, {"big": 1e6 + 0.5}, 1e-6) == []
    assert differences(known, {**known, "a": [1.0, 2.1]}, 1e-6) == ["a[1]: 2.0 in a, 2.1 in b"]
    assert differences(known, {**known, "a": [1.0]}, 1e-6) != []
    assert differences(known, {"a": [1.0, 2.0], "b": {}, "d": True}, 1e-6) == ["b/c: only in a"]
    assert differences(known, {**known, "d": 1}, 1e-6) != []
    assert differences({"x": float("nan")}, {"x": 1.0}, 1e-6) != []
    assert differences({"x": float("inf")}, {"x": 1.0}, 1e-6) != []


def test_a_station_that_is_gone_is_a_coded_error(tmp_path):
    with pytest.raises(InputError) as caught:
        station_of(read_run(written(tmp_path)))
    assert caught.value.faults[0].code == "run-station"


CYCLE_ONLY = (
    "method",
    "configurations",
    "unreachable",
    "clearance_m",
    "fallbacks",
    "search",
    "tour",
    "tables",
    "polish",
)


@pytest.mark.parametrize("absent", [(), CYCLE_ONLY], ids=["now", "without their fields"])
def test_motions_without_a_station_are_viewed_and_compared(tmp_path, absent):
    robot = load_robot("ur3e_class")
    folders = []
    for number, cost in enumerate((20.0, 25.0)):
        curve = quintic(robot, np.zeros(6), np.full(6, 0.3))
        motion = Motion(Status.CONVERGED, "refined", curve, cost=cost, certified=True)
        item = CycleMotion("m000", "start", "goal", "travel", motion)
        folders.append(tmp_path / str(number))
        price = ElectricalCost(time=0.0, torque_smoothing=0.0)
        run = write_motions("ur3_A", robot, [item], price, folders[-1], seed=3)
        assert run.result["certified"] == 1
        result = json.loads((folders[-1] / "result.json").read_text())
        kept = {key: value for key, value in result.items() if key not in absent}
        write_atomic(folders[-1] / "result.json", json_text(kept))
    data = run_compare(Console(json=True), *folders, None).data
    assert data["cost"]["travel"] == {"a": 20.0, "b": 25.0, "change_percent": 25.0}
    assert data["cost"]["welding"]["change_percent"] is None
    assert data["max_joint_deviation_rad"] == 0.0
    files = run_view(Console(json=True), folders[0], tmp_path / "view").data["files"]
    assert [name.rsplit("/", 1)[1] for name in files] == ["curves.png", "report.html"]
    page = (tmp_path / "view" / "report.html").read_text()
    assert "1 motions without a station" in page
    assert "scene.html" not in page


def test_a_solved_motion_is_written_as_a_run(tmp_path):
    ends = ("0,0,0,0,0,0", "0.2,0,0,0,0,0")
    weights = (1.0, 1e-6, 1.0, 1e-2)
    outcome = run_solve(
        Console(json=True), "ur10e_class", *ends, 10, None, weights, 0.0, 0, tmp_path
    )
    (item,) = read_run(tmp_path).motions
    assert item.motion.cost == outcome.data["cost"]
    assert np.array_equal(item.motion.trajectory.q_rad, outcome.data["q_rad"])
    assert item.motion.certified is None


NASTY = "a|b <img src=x onerror=alert(1)> [c](javascript:1) **d** `e`\n# f"


def test_names_are_text_in_tables_and_page() -> None:
    """Whatever a station calls its things, tables.md and report.html show it and nothing else."""
    plain = sample_cycle()
    motions = tuple(replace(item, origin=NASTY, target=NASTY) for item in plain.motions)
    rows = tuple(replace(row, stud=NASTY) for row in plain.tables.studs)
    robot = replace(plain.station.robot, provenance={NASTY: "assumed", "mass": NASTY})
    cycle = replace(
        plain,
        station=replace(plain.station, name=NASTY, robot=robot),
        motions=motions,
        tables=replace(plain.tables, studs=rows),
        unreachable=((NASTY, NASTY),),
    )
    text = tables_markdown(result_of(cycle, {}))
    for sign in ("<", "`", "[c", "*d"):
        places = [m.start() for m in re.finditer(re.escape(sign), text)]
        assert places
        assert all(text[at - 1] == "\\" for at in places), sign
    table = [line for line in text.splitlines() if line.startswith("| a")]
    assert len(table) == len(rows)
    assert all(line.count("|") == 4 for line in table)
    page = markdown_html(text)
    assert "<img" not in page
    assert page.count("&lt;img src=x onerror=alert(1)&gt; [c](javascript:1) **d** `e` # f") > 10
