"""Every bad robot file gives coded faults with line, field and fix, and never another error."""

import re
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dmoc.errors import DmocError, RobotError
from dmoc.robot.robot import load_robot
from planning.station.parts import check_link_meshes
from sequencing.report.geometry import robot_triangles

SOURCE = load_robot("irb6640_class").urdf
URDF = SOURCE.read_text()
SETTINGS = SOURCE.with_name("robot.yaml").read_text()


def codes(folder, urdf=URDF, settings=None):
    (folder / "arm.urdf").write_text(urdf)
    if settings is not None:
        (folder / "robot.yaml").write_text(settings)
    with pytest.raises(RobotError) as caught:
        load_robot(folder / "arm.urdf")
    for fault in caught.value.faults:
        assert fault.code
        assert fault.file
        assert fault.legal
        assert fault.fix
    return [fault.code for fault in caught.value.faults]


#: The first collision shape.
FOOT = r'(<collision>.*?)<box size="0.78 0.7 0.08"/>'


def sub(pattern, replacement):
    changed, count = re.subn(pattern, replacement, URDF, count=1, flags=re.S)
    assert count == 1
    return changed


BAD = {
    "nan mass": (r'<mass value="330"/>', '<mass value="nan"/>', "urdf-number"),
    "negative mass": (r'<mass value="330"/>', '<mass value="-330"/>', "mass-range"),
    "no mass": (r'<mass value="330"/>', '<mass value="0"/>', "mass-zero"),
    "text mass": (r'<mass value="330"/>', '<mass value="heavy"/>', "urdf-number"),
    "negative inertia": (r'ixx="23.3[^"]*"', 'ixx="-1"', "inertia-impossible"),
    "triangle inequality": (r'izz="31[^"]*"', 'izz="900"', "inertia-impossible"),
    "inertia in g mm": (
        r'ixx="[^"]*"( ixy="0" ixz="0") iyy="[^"]*"( iyz="0") izz="[^"]*"',
        r'ixx="3e8"\1 iyy="3e8"\2 izz="3e8"',
        "urdf-unit",
    ),
    "inverted limit": (
        r'lower="-2.9[^"]*" upper="2.9[^"]*"',
        'lower="2" upper="-2"',
        "limit-inverted",
    ),
    "degrees": (r'lower="-2.9[^"]*" upper="2.9[^"]*"', 'lower="-170" upper="170"', "urdf-unit"),
    "no limit": (r"<limit [^>]*/>", "", "limit-missing"),
    "zero axis": (r'<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "axis-zero"),
    "short axis": (r'<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', "urdf-number"),
    "negative effort": (r'effort="14000"', 'effort="-1"', "limit-effort"),
    "zero speed": (r'velocity="1.7[^"]*"', 'velocity="0"', "limit-velocity"),
    "millimetres": (r'xyz="0 0 1.075"', 'xyz="0 0 1075"', "urdf-unit"),
    "infinite offset": (r'xyz="0 0 1.075"', 'xyz="0 0 inf"', "urdf-number"),
    "floating": (
        r'name="joint_4" type="revolute"',
        'name="joint_4" type="floating"',
        "joint-type",
    ),
    "prismatic": (
        r'name="joint_4" type="revolute"',
        'name="joint_4" type="prismatic"',
        "joint-type",
    ),
    "unknown parent": (r'<parent link="link_3"/>', '<parent link="link_33"/>', "urdf-link-unknown"),
    "two parents": (r'<child link="link_4"/>', '<child link="link_3"/>', "urdf-tree"),
    "loop": (r'<child link="link_1"/>', '<child link="base_link"/>', "urdf-tree"),
    "branch": (r'<parent link="link_3"/>', '<parent link="link_2"/>', "urdf-serial"),
    "twice": (r'<link name="link_3">', '<link name="link_2">', "urdf-duplicate"),
    "mesh outside": (
        r'<box size="0.78 0.7 0.08"/>',
        '<mesh filename="../../etc/passwd.stl"/>',
        "path-outside",
    ),
    "mesh absolute": (
        r'<box size="0.78 0.7 0.08"/>',
        '<mesh filename="/etc/passwd"/>',
        "path-outside",
    ),
    "mesh uri": (
        r'<box size="0.78 0.7 0.08"/>',
        '<mesh filename="file:///etc/passwd"/>',
        "path-outside",
    ),
    "mesh missing": (FOOT, r'\1<mesh filename="no.stl"/>', "mesh-missing"),
    "package missing": (FOOT, r'\1<mesh filename="package://none/a.stl"/>', "package-missing"),
    "negative box": (r'<box size="0.78 0.7 0.08"/>', '<box size="0.78 -0.7 0.08"/>', "shape-size"),
    "two shapes": (
        r'<box size="0.78 0.7 0.08"/>',
        '<box size="1 1 1"/><sphere radius="1"/>',
        "shape-choice",
    ),
    "entities": (
        r'<\?xml version="1.0"\?>',
        '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]>',
        "urdf-entity",
    ),
    "xacro": (
        r'<link name="flange"/>',
        '<link name="flange"/><xacro:include filename="x"/>',
        "urdf-xacro",
    ),
    "syntax": (r"</robot>", "", "urdf-syntax"),
    "no robot": (r"<robot name.*</robot>", "<sdf/>", "urdf-root"),
    "two masses": (r'<mass value="330"/>', '<mass value="330"/><mass value="3"/>', "urdf-twice"),
    "misspelt tag": (r"<collision>(.*?)</collision>", r"<colision>\1</colision>", "urdf-word"),
    "misspelt attribute": (r'<origin xyz="0 0 1.075"', '<origin xzy="0 0 1.075"', "urdf-word"),
    "underscore": (r'<mass value="330"/>', '<mass value="3_3_0"/>', "urdf-number"),
    "other digits": (r'<mass value="330"/>', '<mass value="٣٣٠"/>', "urdf-number"),
    "no-break space": (r'<mass value="330"/>', '<mass value="330&#160;"/>', "urdf-number"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_urdf_is_named(tmp_path, name):
    pattern, replacement, code = BAD[name]
    assert code in codes(tmp_path, sub(pattern, replacement))


def test_faults_carry_their_line_and_come_all_at_once(tmp_path):
    text = sub('xyz="0 0 1.075"', 'xyz="0 0 1075"').replace('effort="14000"', 'effort="-1"')
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(RobotError) as caught:
        load_robot(tmp_path / "arm.urdf")
    lines = text.splitlines()
    faults = {fault.code: fault for fault in caught.value.faults}
    assert "1075" in lines[faults["urdf-unit"].line - 1]
    assert faults["urdf-unit"].field == "joint joint_3.origin.xyz"
    assert 'effort="-1"' in lines[faults["limit-effort"].line - 1]


def test_a_chain_of_20000_links_is_refused(tmp_path):
    links = "".join(f'<link name="l{i}"/>' for i in range(20001))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(20000)
    )
    assert codes(tmp_path, f'<robot name="r">{links}{joints}</robot>') == ["urdf-large"]


def test_deep_nesting_is_refused(tmp_path):
    deep = "<a>" * 5000 + "</a>" * 5000
    assert codes(tmp_path, f'<robot name="r">{deep}</robot>') == ["urdf-large"]


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("link.stl", b"solid x\nfacet", "mesh-truncated"),
        ("link.stl", b"x" * 80 + struct.pack("<I", 99), "mesh-truncated"),
        (
            "link.stl",
            b"x" * 80 + struct.pack("<I", 1) + np.full(12, np.nan, "<f4").tobytes() + b"\0\0",
            "mesh-nan",
        ),
        ("link.dae", b"<COLLADA><asset>", "mesh-syntax"),
        ("link.ply", trimesh.creation.box().export(file_type="ply")[:-40], "mesh-syntax"),
        ("link.obj", b"v 0 0 0\nf 1 2 3\n", "mesh-index"),
    ],
)
def test_broken_link_meshes(tmp_path, name, content, code):
    """A broken collision mesh costs the robot; a broken picture is drawn by the other shapes."""
    (tmp_path / name).write_bytes(content)
    (tmp_path / "arm.urdf").write_text(sub(FOOT, rf'\1<mesh filename="{name}"/>'))
    with pytest.raises(DmocError) as caught:
        check_link_meshes(load_robot(tmp_path / "arm.urdf"))
    assert [fault.code for fault in caught.value.faults] == [code]
    assert caught.value.faults[0].field == "link base_link.collision"
    picture = sub('<box size="0.78 0.7 0.08"/>', f'<mesh filename="{name}"/>')
    (tmp_path / "arm.urdf").write_text(picture)
    robot = load_robot(tmp_path / "arm.urdf")
    check_link_meshes(robot)
    assert len(robot_triangles(robot)[0]) == 2


def test_an_empty_mesh_is_named_at_once(tmp_path):
    (tmp_path / "link.stl").write_bytes(b"")
    assert codes(tmp_path, sub(FOOT, r'\1<mesh filename="link.stl"/>')) == ["mesh-broken"]


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        ("torque_limit_nm: [1, 2]", "robot-value"),
        ("torque_limit_nm: [1, 2, 3, 4, 5, .nan]", "robot-value"),
        ("torque_limit_nm: [1, 2, 3, 4, 5, many]", "robot-value"),
        ("armature_kg_m2: -1", "robot-value"),
        ("armatur: 1", "robot-key"),
        ("flange: hand", "robot-flange"),
        ("schema_version: 2", "schema-version"),
        ("q_lower_rad: 3", "limit-inverted"),
        ("drive: {class: tiny}", "drive-class"),
        ("drive: 3", "robot-value"),
        ("provenance: {mass: guess}", "provenance-tag"),
        ("allowed_collisions: [[link_1]]", "robot-value"),
        ("allowed_collisions: [[link_1, elbow]]", "name-unknown"),
        ("a: &x 1\nb: *x", "yaml-anchor"),
        ("name: a\nname: b", "yaml-duplicate"),
        ("- 1", "yaml-mapping"),
        ("a: [1,", "yaml-syntax"),
        ("name: ''", "robot-value"),
    ],
)
def test_bad_settings_are_named(tmp_path, settings, code):
    assert code in codes(tmp_path, settings=settings)


def test_effort_may_come_from_the_settings(tmp_path):
    (tmp_path / "arm.urdf").write_text(re.sub(r'effort="\d+"', 'effort="0"', URDF))
    (tmp_path / "robot.yaml").write_text(SETTINGS)
    assert load_robot(tmp_path / "arm.urdf").torque_limit_nm[0] == 14000


def test_unknown_name_lists_the_robots():
    with pytest.raises(RobotError, match="irb6640_class"):
        load_robot("irb_nothing")


@given(data=st.data())
@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_mutated_files_never_raise_anything_else(tmp_path, data):
    """Cut, double or overwrite a stretch of the file: it loads, or a DmocError says why not."""
    start = data.draw(st.integers(0, len(URDF) - 1))
    size = data.draw(st.integers(1, 60))
    new = data.draw(
        st.sampled_from(["", "nan", "-1", "1e999", '"', "<", "link_1", "\x00", "ü", "0 0"])
    )
    (tmp_path / "arm.urdf").write_text(URDF[:start] + new + URDF[start + size :])
    try:
        robot = load_robot(tmp_path / "arm.urdf")
    except DmocError:
        return
    assert np.all(np.isfinite(robot.q_lower_rad))
