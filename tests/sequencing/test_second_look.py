"""A second engine looks at every motion before it is delivered, and before an old run leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from sample_cycle import POSES, quintic, sample_cycle, sample_station

from dmoc.errors import InputError
from dmoc.motion.status import Status
from planning.collision.departure_line import DepartureLine
from planning.collision.second_look import SecondLook, samples_of
from planning.geometry.shapes import Body, Shape, pose_matrix
from sequencing.cycle.second_look import MotionLooks
from sequencing.export import checks
from sequencing.export.exporting import export_run
from sequencing.runs.folder import read_run, write_run
from sequencing.runs.tables import tables_markdown

ROBOT = sample_station().robot
MOTION = quintic(ROBOT, np.array(POSES["S1"]), np.array(POSES["S2"]))


def tip_at(share: float) -> np.ndarray:
    time = share * MOTION.duration_s
    return ROBOT.tip_pose(MOTION.sample(np.array([time])).q_rad[0]).translation


def station_with(*bodies: Body):
    return sample_station().replace(obstacles=bodies)


def plate(where: np.ndarray, thick_m: float = 0.001) -> Body:
    """A thin plate across the tip's way."""
    return Body("plate", (Shape("box", (0.3, thick_m, 0.3)),), pose=pose_matrix(where))


def test_a_free_motion_is_free() -> None:
    looks = MotionLooks(sample_station())
    cycle = sample_cycle()
    assert looks.judged(cycle.motions) == cycle.motions
    look = looks.report(cycle.motions)
    assert (look.motions, look.contacts, look.refused) == (4, 0, ())
    assert look.configurations == 4 * samples_of(MOTION) >= 4 * 200


def test_a_plate_between_two_knots_is_met() -> None:
    knot = MOTION.num_intervals // 2
    touch = SecondLook(station_with(plate(tip_at((knot + 0.5) / MOTION.num_intervals)))).touch(
        MOTION, ()
    )
    assert touch is not None
    assert touch.pair == ("plate", "gun")
    assert 0.2 < touch.time_s < MOTION.t_s[knot + 1]


def test_the_meshes_are_asked_where_the_pieces_do_not_cover_them() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces)
    small = Shape("convex", vertices_m=1e-3 * vertices)
    ahead = ROBOT.tip_pose(MOTION.q_rad[0]).rotation[:, 0]  # 5 cm beyond the gun's end
    pose = pose_matrix(tip_at(0.0) + 0.05 * ahead)
    whole = Body("ball", (small,), Shape("mesh", vertices_m=vertices, faces=faces), pose)
    assert SecondLook(station_with(replace(whole, mesh=None))).touch(MOTION, ()) is None
    touch = SecondLook(station_with(whole)).touch(MOTION, ())
    assert touch is not None
    assert "ball" in touch.pair


def test_the_pieces_are_asked_where_a_mesh_has_no_inside() -> None:
    """The gun is wholly inside a closed mesh: triangles do not meet it, the pieces do."""
    box = trimesh.creation.box((6.0, 6.0, 6.0))
    vertices, faces = np.array(box.vertices), np.array(box.faces)
    shape = Shape("box", (6.0, 6.0, 6.0))
    room = Body("room", (shape,), Shape("mesh", vertices_m=vertices, faces=faces))
    assert SecondLook(station_with(room)).touch(MOTION, ()) is not None


def test_a_weld_may_touch_its_part_on_its_line_only() -> None:
    station = station_with(plate(tip_at(0.5)))
    line = DepartureLine(tip_at(0.5), [0.0, 0.0, 1.0], 0.01, stray_m=0.5, part="plate")
    look = SecondLook(station)
    assert look.touch(MOTION, ()) is not None
    assert look.touch(MOTION, (line,)) is None
    assert look.touch(MOTION, (replace(line, part="other"),)) is not None
    assert look.touch(MOTION, (replace(line, stray_m=0.005),)) is not None


def test_a_motion_that_touches_is_uncertified_and_names_the_pair() -> None:
    cycle = sample_cycle()
    item = cycle.motions[1]
    middle = item.motion.trajectory.q_rad[8]
    bad = plate(ROBOT.tip_pose(middle).translation)
    looks = MotionLooks(station_with(*cycle.station.obstacles, bad))
    judged = looks.judged(cycle.motions)[1].motion
    assert judged.status is Status.UNCERTIFIED
    assert judged.certified is False
    assert "plate and gun" in judged.note
    assert looks.report(cycle.motions).contacts >= 1
    assert any("S1 → S3: python-fcl finds plate and gun" in text for text in looks.refused)


def test_the_figure_is_in_result_and_tables(tmp_path) -> None:
    cycle = sample_cycle()
    cycle = replace(cycle, second_look=MotionLooks(cycle.station).report(cycle.motions))
    write_run(cycle, tmp_path, {})
    result = read_run(tmp_path).result
    assert result["second_look"]["configurations"] == 4 * samples_of(MOTION)
    assert "finds 0 contacts in 4 motions at 804 configurations" in tables_markdown(result)


@pytest.fixture
def old_run(tmp_path):
    """A run from before: nobody looked at it."""
    write_run(replace(sample_cycle(), second_look=None), tmp_path, {})
    return read_run(tmp_path)


def test_an_old_run_is_looked_at_before_it_is_exported(old_run, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(checks, "station_of", lambda run: sample_station())
    assert export_run(old_run, "csv", tmp_path / "good").files
    middle = old_run.motions[1].motion.trajectory.q_rad[8]
    bad = plate(ROBOT.tip_pose(middle).translation)
    monkeypatch.setattr(checks, "station_of", lambda run: station_with(bad))
    with pytest.raises(InputError) as caught:
        export_run(old_run, "csv", tmp_path / "bad")
    assert {fault.code for fault in caught.value.faults} == {"export-uncertified"}
    assert "plate and gun" in str(caught.value)
    assert not (tmp_path / "bad").exists()


def test_an_old_run_without_its_station_stays_here(old_run, tmp_path) -> None:
    with pytest.raises(InputError, match="run-station"):
        export_run(old_run, "csv", tmp_path / "out")


def test_a_run_in_which_contacts_were_found_is_looked_at_again(tmp_path, monkeypatch) -> None:
    cycle = sample_cycle()
    touched = replace(cycle.second_look, contacts=1)
    write_run(replace(cycle, second_look=touched), tmp_path, {})
    with pytest.raises(InputError, match="run-station"):
        export_run(read_run(tmp_path), "csv", tmp_path / "out")
