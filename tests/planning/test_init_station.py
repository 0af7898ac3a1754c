"""`dmoc init` writes a station that loads and can be checked."""

import numpy as np
import pytest
import trimesh

from dmoc.errors import InputError
from dmoc.robot.robot import load_robot
from planning.station.build import load_station
from planning.station.template import init_station
from planning.welds.check import check_station

STUDS = "id,x_m,y_m,z_m,nx,ny,nz,weld_time_s\na,0.6,0.1,0.2,0,0,1,1\nb,0.7,-0.2,0.2,0,0,1,1\n"


@pytest.fixture
def inputs(tmp_path):
    part = trimesh.creation.box((500, 800, 100))
    part.apply_translation([700, 0, 150])
    part.export(tmp_path / "part.stl")
    (tmp_path / "welds.csv").write_text(STUDS)
    return tmp_path


def test_from_a_robot_of_the_package(inputs):
    path = init_station(
        "ur10e_class", inputs / "part.stl", inputs / "welds.csv", inputs / "out", unit="mm"
    )
    station = load_station(path)
    assert station.obstacles[0].name == "part"
    assert {stud.on for stud in station.studs} == {"part"}
    assert path.read_text().count("#") > 10
    data = check_station(path)
    assert all(row["alternatives"] > 0 for row in data["studs"])


def test_from_a_urdf_with_a_mesh(inputs):
    source = load_robot("irb6640_class").urdf
    (inputs / "arm").mkdir()
    (inputs / "arm" / "meshes").mkdir()
    trimesh.creation.box((0.78, 0.7, 0.08)).export(inputs / "arm" / "meshes" / "foot.stl")
    urdf = source.read_text().replace(
        '<box size="0.78 0.7 0.08"/>', '<mesh filename="meshes/foot.stl"/>'
    )
    (inputs / "arm" / "arm.urdf").write_text(urdf)
    (inputs / "arm" / "robot.yaml").write_bytes(source.with_name("robot.yaml").read_bytes())
    path = init_station(
        inputs / "arm" / "arm.urdf", inputs / "part.stl", inputs / "welds.csv", inputs / "o", "mm"
    )
    station = load_station(path)
    assert station.robot.name == "irb6640_class"
    assert np.allclose(station.robot.armature_kg_m2[0], 250)
    assert (inputs / "o" / "robot" / "meshes" / "foot.stl").is_file()


def test_all_faults_at_once_and_nothing_written(inputs):
    (inputs / "welds.csv").write_text(STUDS.replace("0.6", "six"))
    with pytest.raises(InputError) as caught:
        init_station("no_robot", inputs / "part.stl", inputs / "welds.csv", inputs / "out", "m")
    assert {fault.code for fault in caught.value.faults} == {
        "robot-missing",
        "mesh-unit",
        "stud-value",
    }
    assert not (inputs / "out").exists()


def test_an_existing_station_is_kept(inputs):
    (inputs / "station.yaml").write_text("mine")
    with pytest.raises(InputError, match="init-exists"):
        init_station("ur10e_class", inputs / "part.stl", inputs / "welds.csv", inputs, "mm")
    assert (inputs / "station.yaml").read_text() == "mine"
