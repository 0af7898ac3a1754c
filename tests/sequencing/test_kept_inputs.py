"""A run of an own robot works from its folder alone, wherever that is; nothing of it goes stale."""

from __future__ import annotations

import fcntl
import json
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from sample_cycle import POSES, sample_cycle

from dmoc.errors import InputError
from dmoc.robot.robot import load_robot
from planning.station.build import load_station
from sequencing.commands.console import Console
from sequencing.commands.runs import run_compare, run_export, run_view
from sequencing.runs.folder import read_run, station_of, write_run
from sequencing.runs.inputs import forget_pages, kept_inputs, locked
from sequencing.runs.measured import measured_against_plan
from sequencing.timing.cell.read import load_cell

STATION = """\
schema_version: 1
name: own
robot: {urdf: arm/mine.urdf, base: {position_m: [0, 0, 0.1]}}
tool:
  shapes: [{name: gun, box_m: [0.35, 0.12, 0.12], pose: {position_m: [0.175, 0, 0]}, touches: true}]
  mass_kg: 40
  com_m: [0.2, 0, 0]
  inertia_kg_m2: [[1, 0, 0], [0, 2, 0], [0, 0, 2]]
  tip: {position_m: [0.35, 0, 0]}
obstacles:
  - {name: part, mesh: part.stl, unit: mm, pose: {position_m: [1.9, 0, 0.15]}}
studs: lists/studs.csv
home_rad: [0.0, -0.35, 0.35, 0.0, 0.6, 0.0]
"""
CELL = """\
schema_version: 1
name: pair
link: {capacitance_f: 6.0e-3, voltage_v: 560.0, chopper_v: 760.0}
robots:
  - {name: one, run: run, base: {position_m: [0, 0, 0]}}
  - {name: two, run: run, base: {position_m: [6, 0, 0]}}
"""


def own_cycle(folder: Path):
    """The sample cycle with an own robot that has a mesh, in a station with files of its own."""
    packaged = load_robot("irb6640_class").urdf
    (folder / "arm" / "meshes").mkdir(parents=True)
    (folder / "lists").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "arm" / "meshes" / "shield.stl")
    trimesh.creation.box((300, 800, 200)).export(folder / "part.stl")
    text = packaged.read_text()
    at = text.index("<inertial>")
    shape = '<geometry><mesh filename="meshes/shield.stl"/></geometry>'
    text = f"{text[:at]}<collision>{shape}</collision>{text[at:]}"
    (folder / "arm" / "mine.urdf").write_text(text)
    settings = packaged.with_name("robot.yaml").read_text()
    (folder / "arm" / "robot.yaml").write_text(settings.replace("irb6640_class", "mine"))
    robot = sample_cycle().station.robot
    rows = ["id,x_m,y_m,z_m,nx,ny,nz,weld_time_s"]
    for name, pose in POSES.items():
        if name != "home":
            x, y, z = robot.tip_pose(np.array(pose)).translation
            rows.append(f"{name},{x},{y},{z + 0.1},0,0,1,2")
    (folder / "lists" / "studs.csv").write_text("\n".join(rows))
    (folder / "station.yaml").write_text(STATION)
    return replace(sample_cycle(), station=load_station(folder))


def test_every_command_works_from_a_moved_run_of_an_own_robot(tmp_path: Path) -> None:
    cycle = own_cycle(tmp_path / "there")
    write_run(cycle, tmp_path / "there" / "run", {})
    (tmp_path / "here").mkdir()
    shutil.move(tmp_path / "there" / "run", tmp_path / "here" / "run")
    shutil.rmtree(tmp_path / "there")
    folder = tmp_path / "here" / "run"
    run = read_run(folder)
    assert run.robot is not None
    assert run.robot.fingerprint == cycle.station.robot.fingerprint
    assert station_of(run).fingerprint == cycle.station.fingerprint
    files = {
        path.relative_to(folder / "inputs").as_posix()
        for path in folder.rglob("*.*")
        if path.is_relative_to(folder / "inputs")
    }
    assert files == {
        "inputs.json",
        "station/station.yaml",
        "station/part.stl",
        "station/lists/studs.csv",
        "robot/mine.urdf",
        "robot/robot.yaml",
        "robot/meshes/shield.stl",
    }
    console = Console(json=True)
    assert (folder / "scene.html").samefile(run_view(console, folder, None).data["files"][1])
    assert run_export(console, folder, "rtde", 0.02, None).data["files"]
    (log,) = (folder / "export").glob("*.csv")
    assert measured_against_plan(log, folder)["energy"]["planned_j"] is not None
    assert run_compare(console, folder, folder, None).exit_code == 0
    (tmp_path / "here" / "cell.yaml").write_text(CELL)
    cell = load_cell(tmp_path / "here")
    assert [len(robot.fixtures) for robot in cell.robots] == [1, 1]
    assert [body.name for body in cell.robots[1].tool_bodies] == ["gun"]
    (folder / "inputs" / "robot" / "robot.yaml").write_text("schema_version: 1\n")
    assert kept_inputs(folder) == (None, None)
    assert read_run(folder).robot is None


def test_pages_of_an_older_result_go_and_those_of_the_same_stay(tmp_path: Path) -> None:
    cycle = sample_cycle()
    write_run(cycle, tmp_path, {})
    (tmp_path / "export").mkdir()
    pages = [tmp_path / name for name in ("scene.html", "report.html", "export/sample.mod")]
    for page in pages:
        page.write_text("old")
    write_run(cycle, tmp_path, {"wall_s": 1.0})
    assert all(page.is_file() for page in pages)
    write_run(sample_cycle(order=("S2", "S1", "S3")), tmp_path, {})
    assert not any(page.exists() for page in pages)
    forget_pages(tmp_path)
    assert json.loads((tmp_path / "result.json").read_text())["name"] == "sample"


def test_one_plan_at_a_time_in_a_folder(tmp_path: Path) -> None:
    with locked(tmp_path / "run"):
        with pytest.raises(InputError, match="run-locked"), locked(tmp_path / "run"):
            pass
        with locked(tmp_path / "other"):
            pass
    with locked(tmp_path / "run"):
        pass


WRITES = """
import os, signal, sys
from pathlib import Path
from sequencing.runs import archive
archive.os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
archive.write_atomic(Path(sys.argv[1]), "half")
"""


@pytest.mark.parametrize("name", ["result.json", "motions/01.csv", "export/cell.script"])
def test_what_a_killed_run_left_half_written_goes_with_the_next(name, tmp_path) -> None:
    done = subprocess.run([sys.executable, "-c", WRITES, str(tmp_path / name)], check=False)
    assert done.returncode == -signal.SIGKILL
    folder = (tmp_path / name).parent
    assert [path.name[: len(name)] for path in folder.iterdir()] != []
    (tmp_path / ".inputs.abcd_123").mkdir()
    (tmp_path / ".inputs.abcd_123" / "robot").write_text("half")
    kept = {folder / ".gitignore", folder / ".notes.settings", folder / ".a.json.writing1"}
    for path in kept:
        path.write_text("mine")
    with open(folder / ".a.json.writing1") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)  # another process writes it at this moment
        with locked(tmp_path):
            pass
        assert {path for path in folder.iterdir() if path.name != ".lock"} == kept
    assert not (tmp_path / ".inputs.abcd_123").exists()
