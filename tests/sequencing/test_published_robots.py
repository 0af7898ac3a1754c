"""Two robots as their makers' descriptions are published, from URDF to a program, unchanged."""

import json
from pathlib import Path

import pinocchio as pin
import pytest
import trimesh
from typer.testing import CliRunner

from sequencing.cli import app

ROBOTS = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
STUDS = "id,x_m,y_m,z_m,nx,ny,nz,weld_time_s\na,{x},0.1,0.2,0,0,1,1\nb,{x},-0.1,0.2,0,0,1,1\n"


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words]).exit_code


@pytest.mark.slow
@pytest.mark.skipif(not ROBOTS.is_dir(), reason="example-robot-data is not installed")
@pytest.mark.parametrize(
    ("urdf", "flange", "x", "half_turn"),
    [
        ("ur_description/urdf/ur10_robot.urdf", "tool0", 0.7, True),
        ("panda_description/urdf/panda.urdf", "panda_hand_tcp", 0.5, False),
    ],
)
def test_from_urdf_to_program(tmp_path, monkeypatch, urdf, flange, x, half_turn):
    monkeypatch.chdir(tmp_path)
    part = trimesh.creation.box((300, 400, 60))
    part.apply_translation([1000 * x, 0, 170])
    part.export("part.stl")
    Path("studs.csv").write_text(STUDS.format(x=x))
    assert run("init", ROBOTS / urdf, "part.stl", "studs.csv", "--unit", "mm", "--out", "st") == 0
    text = Path("st/station.yaml").read_text().replace("spin_steps: 12", "spin_steps: 2")
    if half_turn:  # the one edit: an arm of two turns a joint has 64 times the poses
        ends = "  q_lower_rad: [{0}]\n  q_upper_rad: [{1}]\n"
        ends = ends.format(", ".join(["-3.1"] * 6), ", ".join(["3.1"] * 6))
        text = text.replace("\ntool:", f"{ends}\ntool:", 1)
    Path("st/station.yaml").write_text(text)
    assert run("check", "st", "--out", "checked") == 0
    checked = json.loads(Path("checked/check.json").read_text())
    assert checked["flange"] == flange
    assert not {row["code"] for row in checked["warnings"]} & {"link-bare", "pair-always"}
    assert run("plan", "st", "--out", "run", "--workers", 1) == 0
    assert run("view", "run") == 0
    assert Path("run/scene.html").stat().st_size > 100_000
    assert run("export", "run", "--format", "csv", "--out", "program") == 0
    result = json.loads(Path("run/result.json").read_text())
    assert all(motion["certified"] for motion in result["motions"])
