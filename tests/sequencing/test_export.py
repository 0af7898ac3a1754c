"""Programs for controllers: read back to the plan, honest about timing, refused beyond limits."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from sample_cycle import quintic, sample_cycle

from dmoc.errors import InputError
from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from sequencing.cycle_types import CycleMotion
from sequencing.export.exporting import EXPORT_FORMATS, export_run
from sequencing.export.wording import _LANGUAGES
from sequencing.runs.folder import read_run, write_motions, write_run
from studies.ur3.readers import read_krl, read_log, read_rapid, read_ros, read_urscript


def run_of(folder, cycle):
    write_run(cycle, folder / "run", {})
    return read_run(folder / "run")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_of(tmp_path_factory.mktemp("export"), sample_cycle())


@pytest.mark.parametrize(
    ("format", "read"), [("rapid", read_rapid), ("krl", read_krl)], ids=["rapid", "krl"]
)
def test_point_to_point_programs_read_back_to_the_knots(run, tmp_path, format, read):
    (path,) = export_run(run, format, tmp_path).files
    found = read(path)
    assert set(found) == set(run.trajectories)
    for key, trajectory in run.trajectories.items():
        np.testing.assert_allclose(found[key], trajectory.q_rad[1:], atol=1e-6)


@pytest.mark.parametrize("step_s", [0.002, 0.008, 0.08])
def test_urscript_reads_back_to_the_interpolant(run, tmp_path, step_s):
    export = export_run(run, "urscript", tmp_path, step_s=step_s)
    found = read_urscript(export.files[0])
    worst = 0.0
    for key, trajectory in run.trajectories.items():
        count = int(np.ceil(trajectory.duration_s / step_s - 1e-9))
        assert len(found[key]) == count
        times = np.minimum(np.arange(1, count + 1) * step_s, trajectory.duration_s)
        np.testing.assert_allclose(found[key], trajectory.sample(times).q_rad, atol=1e-6)
        np.testing.assert_allclose(found[key][-1], trajectory.q_rad[-1], atol=1e-6)
        # Second opinion of the stated deviation: straight lines between the points of the file.
        program = np.vstack([trajectory.q_rad[:1], found[key]])
        fine = np.linspace(0, trajectory.duration_s, 5000)
        for j in range(6):
            line = np.interp(fine, np.arange(count + 1) * step_s, program[:, j])
            worst = max(worst, np.max(np.abs(line - trajectory.sample(fine).q_rad[:, j])))
    assert export.max_deviation_rad == pytest.approx(worst, rel=0.05, abs=1e-7)


def test_coarser_sampling_costs_quadratically_more(run, tmp_path):
    fine, coarse = (
        export_run(run, "urscript", tmp_path, step_s=step).max_deviation_rad for step in (0.01, 0.1)
    )
    assert 50 < coarse / fine < 150


def test_ros_points_are_knots_with_velocities(run, tmp_path):
    *files, cycle = export_run(run, "ros", tmp_path).files
    assert cycle.name == "cycle.json"
    for path in files:
        key, times, position, velocity = read_ros(path)
        trajectory = run.trajectories[key]
        np.testing.assert_allclose(times, trajectory.t_s, atol=1e-9)
        again = JointTrajectory(times, position, velocity, trajectory.torque_nm)
        middle = (times[1:] + times[:-1]) / 2
        np.testing.assert_allclose(
            again.sample(middle).q_rad, trajectory.sample(middle).q_rad, atol=1e-7
        )


@pytest.mark.parametrize(
    ("format", "time", "joint"), [("csv", "t_s", "q2_rad"), ("rtde", "timestamp", "target_q_1")]
)
def test_logs_are_the_cycle_on_an_even_clock(run, tmp_path, format, time, joint):
    (path,) = export_run(run, format, tmp_path, step_s=0.02).files
    columns = read_log(path)
    assert columns[time][-1] == pytest.approx(run.timeline.duration_s)
    state = run.timeline.at(columns[time], run.robot)
    np.testing.assert_allclose(columns[joint], state.q_rad[:, 1], atol=1e-9)
    torque = "torque3_nm" if format == "csv" else "target_moment_2"
    np.testing.assert_allclose(columns[torque], state.torque_nm[:, 2], atol=1e-6)


@pytest.mark.parametrize("format", EXPORT_FORMATS)
def test_every_file_says_that_point_to_point_loses_the_timing(run, tmp_path, format):
    export = export_run(run, format, tmp_path)
    for path in export.files:
        text = " ".join(path.read_text(encoding="utf-8").lower().split())
        assert "point-to-point" in text, path.name
        assert "torque" in text, path.name
        assert "assumed" in text, path.name
        if format in ("rapid", "krl", "urscript"):
            assert text.isascii()


@pytest.mark.parametrize("format", ["urscript", "rapid", "krl"])
def test_a_cycle_without_home_begins_at_its_first_weld(tmp_path, format):
    run = run_of(tmp_path, sample_cycle(home=False))
    (path,) = export_run(run, format, tmp_path).files
    lines = path.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if "weld S1" in line)
    assert any(word in lines[start - 1] for word in ("movej", "MoveAbsJ", "PTP"))


def broken(cycle, **limits):
    """The cycle with other limits in the robot that result.json records."""
    station = replace(cycle.station, robot=cycle.station.robot.with_limits(**limits))
    return replace(cycle, station=station)


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        ({"velocity_limit_rad_s": 0.3}, "velocity_rad_s"),
        ({"torque_limit_nm": 500.0}, "torque_nm"),
        ({"q_upper_rad": 0.4}, "q_rad"),
    ],
)
@pytest.mark.parametrize("format", ["urscript", "ros"])
def test_beyond_a_limit_nothing_is_written(tmp_path, limits, field, format):
    run = run_of(tmp_path, broken(sample_cycle(), **limits))
    with pytest.raises(InputError) as caught:
        export_run(run, format, tmp_path / "out")
    assert {fault.code for fault in caught.value.faults} == {"export-limit"}
    assert any(field in fault.field for fault in caught.value.faults)
    assert all(fault.value and fault.legal and fault.fix for fault in caught.value.faults)
    assert not (tmp_path / "out").exists()


def test_a_bulge_between_the_knots_is_seen(tmp_path):
    cycle = sample_cycle()
    fast = quintic(cycle.station.robot, np.zeros(6), np.full(6, 0.4), duration_s=4.0, intervals=2)
    velocity = np.array(fast.velocity_rad_s)
    velocity[1] *= 12
    swing = JointTrajectory(fast.t_s, fast.q_rad, velocity, fast.torque_nm, fast.robot)
    item = cycle.motions[0]
    item = replace(item, motion=item.motion.replace(trajectory=swing))
    run = run_of(tmp_path, replace(cycle, motions=(item, *cycle.motions[1:])))
    with pytest.raises(InputError) as caught:
        export_run(run, "rapid", tmp_path / "out")
    assert any("m000" in fault.field for fault in caught.value.faults)


@pytest.mark.parametrize("format", ["urscript", "rapid", "krl"])
def test_a_name_cannot_become_a_command(tmp_path, format):
    cycle = sample_cycle()
    evil = replace(cycle.welds[0], stud="S1\nset_digital_out(0, True)\n")
    run = run_of(tmp_path, replace(cycle, welds=(evil, *cycle.welds[1:])))
    (path,) = export_run(run, format, tmp_path).files
    lines = [line for line in path.read_text().splitlines() if "set_digital_out" in line]
    assert len(lines) == 1
    assert lines[0].strip()[0] in "#!;"


def test_what_may_collide_is_not_exported(tmp_path):
    cycle = sample_cycle()
    item = cycle.motions[1]
    item = replace(item, motion=item.motion.replace(certified=False))
    run = run_of(tmp_path, replace(cycle, motions=(cycle.motions[0], item, *cycle.motions[2:])))
    with pytest.raises(InputError) as caught:
        export_run(run, "csv", tmp_path / "out")
    assert [fault.code for fault in caught.value.faults] == ["export-uncertified"]


def test_trajectories_without_a_station_are_exported_too(tmp_path):
    robot = sample_cycle().station.robot
    away, back = np.zeros(6), np.full(6, 0.3)
    curves = [quintic(robot, away, back), quintic(robot, back, away)]
    motions = [
        CycleMotion(
            f"m{k:03d}",
            "here",
            "there",
            "travel",
            Motion(Status.CONVERGED, "refined", curve.on(None), cost=float(k)),
        )
        for k, curve in enumerate(curves)
    ]
    run = write_motions("ur3 study", robot, motions, Cost(), tmp_path, seed=0)
    (path,) = export_run(run, "urscript", tmp_path).files
    assert path.name == "ur3_study.script"
    assert "0 certified" in path.read_text()
    np.testing.assert_allclose(read_urscript(path)["m001"][-1], np.zeros(6), atol=1e-7)
    (path,) = export_run(run, "rtde", tmp_path).files
    assert read_log(path)["timestamp"][-1] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [({"format": "gcode"}, "export-format"), ({"format": "csv", "step_s": 0.0}, "export-step")],
)
def test_wrong_arguments_are_coded_errors(run, tmp_path, arguments, code):
    with pytest.raises(InputError) as caught:
        export_run(run, out=tmp_path / "out", **arguments)
    assert caught.value.faults[0].code == code


@pytest.mark.parametrize(
    "name",
    [
        "door-left",
        "2nd_station",
        "underbody_station_left_side",
        "test",
        "end",
        "Error",
        "x.y",
        "BAS",
    ]
    + ["sleep", "loop", "run", "base", "é"],
)
@pytest.mark.parametrize(
    ("format", "pattern", "language"),
    [
        ("krl", r"^DEF (\w+)\(", "KRL"),
        ("rapid", r"^MODULE (\w+)$", "RAPID"),
        ("urscript", r"^def (\w+)\(", "URScript"),
    ],
)
def test_file_and_program_have_one_legal_name(run, tmp_path, name, format, pattern, language):
    named = replace(run, result={**run.result, "name": name})
    (path,) = export_run(named, format, tmp_path).files
    (found,) = re.findall(pattern, path.read_text(), re.M)
    longest, reserved = _LANGUAGES[language]
    assert found == path.stem
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", found)
    assert len(found) <= longest
    assert found.lower() not in reserved
