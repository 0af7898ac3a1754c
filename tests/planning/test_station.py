"""Stations load, pickle and regenerate; every bad one gives coded faults and nothing else."""

import json
import pickle
import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from authoring.stations.generate import write_stations
from dmoc.errors import InputError
from planning.collision.world import CollisionWorld
from planning.station.build import available_stations, demo_station, load_station
from planning.station.schema import station_schema
from planning.welds.poses import weld_poses

ROOT = Path(__file__).parents[2]
SMALL = """\
schema_version: 1
name: small
robot: {model: ur10e_class}
tool:
  shapes: [{name: tip, cylinder_m: [0.01, 0.1], pose: {position_m: [0, 0, 0.05]}, touches: true}]
  tip: {position_m: [0, 0, 0.1]}
obstacles:
  - {name: table, box_m: [1, 1, 0.1], pose: {position_m: [0.7, 0, 0.1]}}
studs: studs.csv
home_rad: [0, -1.5, 1.2, -1, -1.5, 0]
"""
STUDS = "id,x_m,y_m,z_m,nx,ny,nz,weld_time_s\na,0.6,0.1,0.15,0,0,2,1\nb,0.7,-0.2,0.15,0,0,1,1\n"


def write(folder, text=SMALL, studs=STUDS):
    (folder / "station.yaml").write_text(text)
    (folder / "studs.csv").write_text(studs)
    return folder / "station.yaml"


def faults_of(path):
    with pytest.raises(InputError) as caught:
        load_station(path)
    for fault in caught.value.faults:
        assert fault.code
        assert fault.file
        assert fault.legal
        assert fault.fix
    return {fault.code: fault for fault in caught.value.faults}


@pytest.mark.parametrize(
    ("name", "studs"),
    [
        ("stud_welding_a", 20),
        ("stud_welding_a_8", 8),
        ("stud_welding_b", 20),
        ("stud_welding_c", 20),
        ("stud_welding_a_heavy", 20),
    ],
)
def test_stations_of_the_package(name, studs):
    station = demo_station(name)
    assert len(station.studs) == studs
    assert {stud.on for stud in station.studs} == {"underbody"}
    assert all(stud.weld_time_s == 2.0 for stud in station.studs)
    part = station.obstacles[0]
    assert part.mesh is not None
    assert len(part.mesh.faces) >= 10_000
    assert [body.touches for body in station.tool_bodies] == [False, False, True]
    world = CollisionWorld(station)
    assert world.collide(station.home_rad, station.clearance_m) is None
    for stud in station.studs:
        depth = np.array(stud.position_m) - part.pose[:3, 3]
        gap = np.linalg.norm(part.mesh.vertices_m - depth, axis=1).min()
        assert gap < 0.08


def test_generated_files_are_the_shipped_ones(tmp_path):
    for path in write_stations(tmp_path):
        shipped = ROOT / "planning" / "stations" / path.relative_to(tmp_path)
        assert path.read_bytes() == shipped.read_bytes(), path.name


def test_pickle_and_fingerprint():
    station = demo_station("stud_welding_a_8")
    copy = pickle.loads(pickle.dumps(station))
    assert copy == station
    assert not copy.obstacles[0].mesh.vertices_m.flags.writeable
    assert not copy.studs[0].position_m.flags.writeable
    prints = {demo_station(name).fingerprint for name in available_stations()}
    assert len(prints) == len(available_stations())


def test_a_changed_mesh_changes_the_fingerprint(tmp_path):
    source = ROOT / "planning" / "stations" / "stud_welding_a"
    shutil.copytree(source, tmp_path / "s")
    before = load_station(tmp_path / "s").fingerprint
    assert before == demo_station("stud_welding_a").fingerprint
    data = bytearray((tmp_path / "s" / "underbody.stl").read_bytes())
    corner = np.frombuffer(data, "<f4", 3, 84 + 12).copy()
    corner[2] -= 1e-4
    data[96:108] = corner.tobytes()
    (tmp_path / "s" / "underbody.stl").write_bytes(data)
    assert load_station(tmp_path / "s").fingerprint != before


def test_small_station_and_its_defaults(tmp_path):
    station = load_station(write(tmp_path))
    stud = station.studs[0]
    assert stud.normal == pytest.approx([0, 0, 1])
    assert stud.depart_direction == pytest.approx([0, 0, 1])
    assert (stud.depart_m, stud.on, stud.spin_free) == (0.03, "table", True)
    assert (station.spin_steps, station.clearance_m) == (12, 0.02)
    assert station.cost.effort == 1e-6
    with pytest.raises(InputError, match="legal: a, b"):
        station.stud("c")


def test_schema_accepts_the_shipped_files_and_is_the_published_one():
    schema = station_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in (ROOT / "planning" / "stations").glob("stud_welding_*/station*.yaml"):
        jsonschema.validate(yaml.safe_load(path.read_text()), schema)
    published = json.loads((ROOT / "docs" / "station.schema.json").read_text())
    assert published == json.loads(json.dumps(schema))


BAD = {
    "schema version": ("schema_version: 1", "schema_version: 2", "value-illegal"),
    "unknown field": ("name: small", "name: small\nnmae: x", "field-unknown"),
    "no name": ("name: small\n", "", "field-missing"),
    "no robot": ("robot: {model: ur10e_class}\n", "", "field-missing"),
    "unknown robot": ("ur10e_class", "ur11", "robot-missing"),
    "two robots": ("{model: ur10e_class}", "{model: ur10e_class, urdf: a.urdf}", "robot-choice"),
    "urdf outside": ("{model: ur10e_class}", "{urdf: ../a.urdf}", "path-outside"),
    "urdf missing": ("{model: ur10e_class}", "{urdf: a.urdf}", "robot-missing"),
    "wide limits": (
        "{model: ur10e_class}",
        "{model: ur10e_class, q_upper_rad: [9, 1, 1, 1, 1, 1]}",
        "limit-range",
    ),
    "inverted limits": (
        "{model: ur10e_class}",
        "{model: ur10e_class, q_upper_rad: [-6.28, -6.29, 1, 1, 1, 1],"
        " q_lower_rad: [-6, -6, 0, 0, 0, 0]}",
        "limit-inverted",
    ),
    "mesh without unit": ("box_m: [1, 1, 0.1]", "mesh: a.stl", "unit-missing"),
    "mesh missing": ("box_m: [1, 1, 0.1]", "mesh: a.stl, unit: m", "mesh-missing"),
    "mesh outside": ("box_m: [1, 1, 0.1]", "mesh: ../a.stl, unit: m", "path-outside"),
    "mesh absolute": ("box_m: [1, 1, 0.1]", "mesh: /etc/passwd, unit: m", "path-outside"),
    "unit inch": ("box_m: [1, 1, 0.1]", "mesh: a.stl, unit: inch", "value-illegal"),
    "negative box": ("box_m: [1, 1, 0.1]", "box_m: [1, -1, 0.1]", "value-range"),
    "flat box": ("box_m: [1, 1, 0.1]", "box_m: [1, 1]", "length"),
    "no shape": (", box_m: [1, 1, 0.1]", "", "shape-choice"),
    "two shapes": ("box_m: [1, 1, 0.1]", "box_m: [1, 1, 0.1], sphere_m: 1", "shape-choice"),
    "nan": ("box_m: [1, 1, 0.1]", "box_m: [1, 1, .nan]", "number-not-finite"),
    "text number": ("box_m: [1, 1, 0.1]", "box_m: [1, 1, thick]", "type"),
    "millimetres": ("position_m: [0.7, 0, 0.1]", "position_m: [700, 0, 100]", "value-range"),
    "name of a link": ("name: table", "name: link_1", "name-duplicate"),
    "name with a blank": ("name: table", "name: my table", "name"),
    "quaternion": ("{position_m: [0.7, 0, 0.1]}", "{quaternion_xyzw: [0, 0, 0, 2]}", "quaternion"),
    "studs missing": ("studs: studs.csv", "studs: no.csv", "file-missing"),
    "studs outside": ("studs: studs.csv", "studs: ../studs.csv", "path-outside"),
    "home size": ("[0, -1.5, 1.2, -1, -1.5, 0]", "[0, -1.5]", "home"),
    "home in degrees": ("[0, -1.5, 1.2, -1, -1.5, 0]", "[0, -90, 60, 0, 0, 0]", "home-limit"),
    "inertia": ("  tip:", "  inertia_kg_m2: [[1, 0, 0], [0, 1, 0], [0, 0, 9]]\n  tip:", "inertia"),
    "negative mass": ("  tip:", "  mass_kg: -1\n  tip:", "value-range"),
    "spin": ("studs: studs.csv", "studs: studs.csv\nspin_steps: 0", "value-range"),
    "clearance": ("studs: studs.csv", "studs: studs.csv\nclearance_m: 20", "value-range"),
    "cost": ("studs: studs.csv", "studs: studs.csv\ncost: {time: -1}", "value-range"),
    "cost without time": (
        "studs: studs.csv",
        "studs: studs.csv\ncost: {time: 0, effort: 0}",
        "cost-zero",
    ),
    "cost out of all bounds": (
        "studs: studs.csv",
        "studs: studs.csv\ncost: {time: 1.0e+300}",
        "value-range",
    ),
    "no tool solid": (SMALL[SMALL.index("  shapes:") : SMALL.index("  tip:")], "", "tool-shape"),
    "departure": (
        "studs: studs.csv",
        "studs: studs.csv\ndeparture: {direction: [0, 0, 0]}",
        "vector-zero",
    ),
    "precedence": ("studs: studs.csv", "studs: studs.csv\nprecedence: [[a, z]]", "name-unknown"),
    "circle": (
        "studs: studs.csv",
        "studs: studs.csv\nprecedence: [[a, b], [b, a]]",
        "precedence-cycle",
    ),
    "allowed": (
        "studs: studs.csv",
        "studs: studs.csv\nallowed_collisions: [[tip, moon]]",
        "name-unknown",
    ),
    "anchor": ("name: small", "name: &n small", "yaml-anchor"),
    "duplicate": ("name: small", "name: small\nname: big", "yaml-duplicate"),
    "syntax": ("obstacles:", "obstacles: [", "yaml-syntax"),
    "tag": ("name: small", "name: !!python/object:os.system small", "yaml-syntax"),
    "deep": ("name: small", "name: " + "[" * 200 + "]" * 200, "yaml-depth"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_station_is_named(tmp_path, name):
    old, new, code = BAD[name]
    assert old in SMALL
    faults = faults_of(write(tmp_path, SMALL.replace(old, new, 1)))
    assert code in faults, faults


def test_all_faults_at_once_with_lines_and_fields(tmp_path):
    text = SMALL.replace("box_m: [1, 1, 0.1]", "box_m: [1, -1, 0.1]").replace("ur10e_class", "x")
    text = text.replace("studs: studs.csv", "studs: studs.csv\nclearance_m: no")
    faults = faults_of(write(tmp_path, text, STUDS.replace("-0.2", "left")))
    assert faults["robot-missing"].field == "robot.model"
    assert faults["robot-missing"].line == 3
    assert faults["value-range"].field == "obstacles[0].box_m[1]"
    assert faults["value-range"].line == 8
    assert faults["type"].field == "clearance_m"
    assert (faults["stud-value"].field, faults["stud-value"].line) == ("y_m", 3)


@pytest.mark.parametrize(
    ("studs", "code"),
    [
        (STUDS.replace("0,0,2,1", "0,0,0,1"), "stud-value"),
        (STUDS.replace("0.15,0,0,2", "nan,0,0,2"), "stud-value"),
        (STUDS.replace("0.6,", "600,"), "stud-value"),
        (STUDS.replace("0.6,", "70,"), "stud-unit"),
        (STUDS.replace("\nb,", "\na,"), "stud-duplicate"),
        (STUDS.replace("weld_time_s", "time"), "csv-column"),
        (STUDS.replace("0,0,2,1", "0,0,2"), "stud-row"),
        (STUDS.replace("0,0,2,1", "0,0,2,-1"), "stud-value"),
        (STUDS.splitlines()[0], "studs-empty"),
        ("", "csv-column"),
        (STUDS.replace(",", ";").replace("0.1;", "0,1;"), "csv-decimal"),
        (STUDS.replace("0.6,", "0_6,"), "stud-value"),
        (STUDS.replace("\na,", '\n"a\n1",'), "stud-value"),
        ("id,x_m,y_m,z_m,nx,ny,nz,weld_time_s,on\na,0.6,0,0.15,0,0,1,1,moon\n", "stud-on"),
        (
            "id,x_m,y_m,z_m,nx,ny,nz,weld_time_s,depart_x,depart_y,depart_z\n"
            "a,0.6,0,0.15,0,0,1,1,0,0,-1\n",
            "stud-departure",
        ),
        (
            "id,x_m,y_m,z_m,nx,ny,nz,weld_time_s,spin_free\na,0.6,0,0.15,0,0,1,1,perhaps\n",
            "stud-value",
        ),
    ],
)
def test_bad_studs_are_named(tmp_path, studs, code):
    assert code in faults_of(write(tmp_path, studs=studs))


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.replace(",", ";"),
        lambda s: s.replace(",", ";").replace(".", ","),
        lambda s: s.replace(",", "\t").replace(".", ","),
        lambda s: s.replace(",", "  "),
        lambda s: "# exported\n" + s.replace(",", " ; "),
    ],
)
def test_studs_with_another_separator_and_mark_are_the_same(tmp_path, change):
    plain = load_station(write(tmp_path))
    assert load_station(write(tmp_path, studs=change(STUDS))) == plain


TURNED = SMALL.replace(
    "pose: {position_m: [0.7, 0, 0.1]}",
    "pose: {position_m: [0.7, 0, 0.1], quaternion_xyzw: [0, 0, 0.7071067811865476, "
    "0.7071067811865476]}",
)


def test_studs_in_millimetres_and_in_the_axes_of_a_body(tmp_path):
    plain = load_station(write(tmp_path, TURNED))
    # A quarter turn about z: the table's x is the world's y.
    rows = "id;x_mm;y_mm;z_mm;nx;ny;nz;weld_time_s;frame\na;100,0;100;50;0;0;2;1;table\n"
    rows += "b;-200;0;50;0;0;1;1;table\n"
    framed = load_station(write(tmp_path, TURNED, rows))
    for a, b in zip(plain.studs, framed.studs):
        np.testing.assert_allclose(a.position_m, b.position_m, atol=1e-12)
        np.testing.assert_allclose(a.normal, b.normal, atol=1e-12)
        np.testing.assert_allclose(a.depart_direction, b.depart_direction, atol=1e-12)
    assert "stud-frame" in faults_of(write(tmp_path, TURNED, rows.replace("table", "moon")))
    assert "csv-column" in faults_of(write(tmp_path, studs=rows.replace("nx", "x_m", 1)))


@pytest.mark.parametrize(
    ("low", "high", "turns"),
    [
        (-30, 30, [-30, 0, 30]),
        (10, 10, [10]),
        (0, 360, list(range(0, 360, 30))),
        (80, 90, [80, 90]),
    ],
)
def test_a_range_of_spins_is_tried_from_end_to_end(tmp_path, low, high, turns):
    rows = STUDS.replace("weld_time_s", "weld_time_s,spin_from_deg,spin_to_deg")
    rows = rows.replace("2,1\n", f"2,1,{low},{high}\n").replace("1,1\n", "1,1,,\n")
    station = load_station(write(tmp_path, studs=rows))
    poses, free = (weld_poses(stud, 12) for stud in station.studs)
    angle = np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    np.testing.assert_allclose((-angle - turns + 180) % 360 - 180, 0, atol=1e-9)
    assert len(free) == 12
    assert station != load_station(write(tmp_path))
    for wrong in (rows.replace(f",{high}\n", ",\n", 1), rows.replace(f",{high}\n", ",-90\n", 1)):
        assert "stud-value" in faults_of(write(tmp_path, studs=wrong))


def test_the_fix_names_the_unit_and_the_comma(tmp_path):
    faults = faults_of(write(tmp_path, studs=STUDS.replace("0.6,", "600,")))
    assert "millimetres" in faults["stud-value"].fix
    faults = faults_of(write(tmp_path, studs=STUDS.replace("0.6,", '"0,6",')))
    assert "decimal point" in faults["stud-value"].fix
    faults = faults_of(write(tmp_path, SMALL.replace("box_m: [1, 1, 0.1]", "box_m: [1, -1, 0.1]")))
    assert faults["value-range"].legal == "> 0"
    twice = SMALL.replace("studs:", "  - {name: table, sphere_m: 0.1}\nstuds:")
    fault = faults_of(write(tmp_path, twice))["name-duplicate"]
    assert (fault.field, fault.line) == ("obstacles[1].name", 9)


def test_latin_1_and_binary_files(tmp_path):
    path = write(tmp_path)
    (tmp_path / "studs.csv").write_bytes(STUDS.encode().replace(b"\na,", b"\n\xe4,"))
    assert "file-encoding" in faults_of(path)
    path.write_bytes(b"\xff\xfe\x00")
    assert "file-encoding" in faults_of(path)
    assert "file-missing" in faults_of(tmp_path / "none.yaml")


def test_unknown_demo_station():
    with pytest.raises(InputError, match="stud_welding_a_8"):
        demo_station("stud_welding_z")


@given(data=st.data())
@settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_mutated_files_never_raise_anything_else(tmp_path, data):
    """Overwrite a stretch of the station or its studs: it loads, or an InputError says why not."""
    texts = [SMALL, STUDS]
    which = data.draw(st.integers(0, 1))
    text = texts[which]
    start = data.draw(st.integers(0, len(text) - 1))
    size = data.draw(st.integers(0, 40))
    new = data.draw(
        st.sampled_from(
            [
                "",
                "nan",
                "-1",
                "1e999",
                '"',
                "{",
                "]",
                ": ",
                "\n",
                "- ",
                "null",
                "\x00",
                "ü",
                "9" * 5000,
            ]
        )
    )
    texts[which] = text[:start] + new + text[start + size :]
    path = write(tmp_path, *texts)
    try:
        station = load_station(path)
    except InputError:
        return
    assert station.fingerprint


def test_replace_gives_a_station_its_own_fingerprint() -> None:
    station = demo_station("stud_welding_a_8")
    assert station.replace() == station
    fewer = station.replace(studs=station.studs[:3])
    assert len(fewer.studs) == 3
    assert fewer != station
    assert fewer == station.replace(studs=station.studs[:3])
    assert station.replace(spin_steps=station.spin_steps + 1) != station
