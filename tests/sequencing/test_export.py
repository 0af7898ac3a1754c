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
from dmoc.robot.controller import controller_from_mapping
from sequencing.cycle_types import CycleMotion
from sequencing.export.exporting import EXPORT_FORMATS, export_run
from sequencing.export.program import program_of
from sequencing.export.readers import (
    read_cubics,
    read_krl,
    read_log,
    read_rapid,
    read_ros,
    read_urscript,
)
from sequencing.export.wording import _LANGUAGES
from sequencing.runs.folder import read_run, write_motions, write_run


def run_of(folder, cycle):
    write_run(cycle, folder / "run", {})
    return read_run(folder / "run")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_of(tmp_path_factory.mktemp("export"), sample_cycle())


def lines_with_ramps(points, times, share):
    """Straight lines in joint space, speeds changed evenly over 2 · share of a stretch: integrated
    from the accelerations, as a controller would. Times and positions."""
    step = times[1] if len(times) > 2 else times[0] / 1.5 if len(times) == 2 else times[0] / 2
    speeds = np.diff(points, axis=0) / step
    speeds = np.vstack([np.zeros((1, 6)), speeds, np.zeros((1, 6))])
    ramp = 2 * share * step
    # A ramp is centred on its target; the first and the last lie at rest beside theirs.
    centres = ramp / 2 + np.arange(len(points)) * step
    clock = np.linspace(0, centres[-1] + ramp / 2, 40001)
    rise = np.clip((clock[:, None] - centres + ramp / 2) / ramp, 0, 1)
    speed = rise @ np.diff(speeds, axis=0)
    moved = np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(clock)[:, None], axis=0)
    return clock, points[0] + np.vstack([np.zeros((1, 6)), moved])


def test_rapid_read_back_and_interpolated_is_the_motion(run, tmp_path):
    export = export_run(run, "rapid", tmp_path)
    found = read_rapid(export.files[0])
    assert set(found) == set(run.trajectories)
    assert sum(len(move.times_s) for move in found.values()) < 16 * len(found)
    worst = 0.0
    for key, plan in run.trajectories.items():
        move = found[key]
        assert move.exact.tolist() == [False] * (len(move.exact) - 1) + [True]
        assert move.times_s.sum() == pytest.approx(plan.duration_s, abs=1e-5)
        points = np.vstack([plan.q_rad[:1], np.radians(move.degrees)])
        clock, q = lines_with_ramps(points, move.times_s, 0.5)
        np.testing.assert_allclose(q[-1], plan.q_rad[-1], atol=1e-6)
        worst = max(worst, np.abs(q - plan.sample(clock).q_rad).max())
    assert worst == pytest.approx(export.max_deviation_rad, rel=0.02)
    assert worst <= 2.1e-3


def test_krl_read_back_is_the_motion_at_equal_times(run, tmp_path):
    (path,) = export_run(run, "krl", tmp_path).files
    for key, move in read_krl(path).items():
        plan = run.trajectories[key]
        times = np.cumsum(move.times_s)
        assert times[-1] == pytest.approx(plan.duration_s, abs=1e-5)
        np.testing.assert_allclose(np.radians(move.degrees), plan.sample(times).q_rad, atol=1e-5)


def test_the_cubics_of_a_urscript_are_the_plan(run, tmp_path):
    (path,) = export_run(run, "urscript", tmp_path).files
    for key, (times, q, v) in read_cubics(path).items():
        plan = run.trajectories[key]
        again = JointTrajectory(times, q, v, plan.torque_nm)
        clock = np.linspace(0, plan.duration_s, 500)
        error = again.sample(clock).q_rad - plan.sample(clock).q_rad
        assert np.abs(error).max() < 1e-7


@pytest.mark.parametrize("share", [0.01, 0.2, 0.35, 0.5])
def test_every_zone_share_stays_in_the_proven_pieces(run, share):
    """What a controller with smaller zones does lies, corner by corner, on the piece's curve."""
    targets = program_of(run, "zones", "abb", "RAPID").targets["m001"]
    _, q = lines_with_ramps(targets.q_rad, targets.times_s, share)
    pieces = [piece.curve(share) for piece in targets.pieces]
    own = np.vstack([c.sample(np.linspace(c.t_s[0], c.t_s[-1], 2000)).q_rad for c in pieces])
    for row in q[:: len(q) // 60]:
        assert np.abs(own - row).max(axis=1).min() < 1e-3
    middle = [piece.curve(0.25) for piece in targets.pieces]
    for piece, mid, other in zip(targets.pieces, middle, pieces):
        clock = np.linspace(0, 1, 50)
        at = [c.sample(c.t_s[0] + clock * c.duration_s).q_rad for c in (mid, other)]
        far = np.abs(at[0][:, None] - at[1][None]).max(axis=2).min(axis=1).max()
        assert far <= piece.rate.max() * abs(share - 0.25) + 2e-3


def mapped(run, **section):
    controller = controller_from_mapping({"vendor": "any", "coupling": "none", **section}, 6)
    return replace(run, robot=replace(run.robot, controller=controller))


@pytest.mark.parametrize("coupling", ["none", "plus_axis_2", "minus_axis_2"])
def test_programs_speak_the_controllers_angles(run, tmp_path, coupling):
    sign, offset = [-1, 1, 1, -1, 1, -1], [0, -90, 90, 0, 0, 0]
    ours = mapped(run, sign=sign, offset_deg=offset, coupling=coupling)
    (plain,), (path,) = (
        export_run(r, "rapid", tmp_path / n).files for r, n in ((run, "a"), (ours, "b"))
    )
    turn = {"none": 0, "plus_axis_2": 1, "minus_axis_2": -1}[coupling]
    for key, move in read_rapid(path).items():
        wanted = read_rapid(plain)[key].degrees * sign + offset
        wanted[:, 2] += turn * wanted[:, 1]
        np.testing.assert_allclose(move.degrees, wanted, atol=1e-5)
        again = ours.robot.controller.radians(move.degrees)
        np.testing.assert_allclose(again, np.radians(read_rapid(plain)[key].degrees), atol=1e-7)


@pytest.mark.parametrize(
    ("change", "format", "word"),
    [
        (None, "rapid", "nothing says"),
        ({"vendor": "kuka"}, "rapid", "kuka"),
        ({"home": {"urdf_deg": [0] * 6, "controller_deg": [0, 0, 5, 0, 0, 0]}}, "krl", "misses"),
        ({"limits_deg": [[-10, 10]] * 6}, "urscript", "deg"),
    ],
)
def test_without_a_right_map_there_is_no_program(run, tmp_path, change, format, word):
    other = mapped(run, **change) if change else run
    if not change:
        other = replace(run, robot=replace(run.robot, controller=None, name="other"))
    with pytest.raises(InputError) as caught:
        export_run(other, format, tmp_path / "out")
    (fault,) = caught.value.faults
    assert fault.code in ("export-controller", "export-target")
    assert word in fault.value
    assert not (tmp_path / "out").exists()


def test_the_plants_weld_routine_is_kept(run, tmp_path):
    export_run(run, "urscript", tmp_path)
    routine = tmp_path / "dm_weld.script"
    routine.write_text("def dm_weld(stud, seconds):\n  set_digital_out(3, True)\nend\n")
    export = export_run(run, "urscript", tmp_path)
    assert "set_digital_out(3, True)" in export.files[0].read_text()
    calls = re.findall(r"^  dm_weld\((\d+), ([\d.]+)\)$", export.files[0].read_text(), re.M)
    assert calls == [(w.stud[1:], f"{w.time_s:.6f}") for w in run.welds]
    assert "set_digital_out" in routine.read_text()


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
    (path,) = export_run(run, "urscript", tmp_path, 0.008).files
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
