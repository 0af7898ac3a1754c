"""Robots as others write them: what was judged is what is loaded, or the file is refused."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from dmoc.errors import DmocError, RobotError
from dmoc.robot.description import Description
from dmoc.robot.robot import load_robot
from planning.collision.robot_bodies import link_bodies
from planning.geometry.mesh_file import write_binary_stl
from planning.station.estimate import estimated_settings, settings_text
from planning.station.parts import check_link_meshes
from sequencing.report.geometry import robot_triangles

BODY = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="7"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>'
)
BOX = '<collision><geometry><box size="0.1 0.1 0.2"/></geometry></collision>'


def link(name, inside=BODY + BOX):
    return f'<link name="{name}">{inside}</link>'


def joint(name, parent, child, kind="revolute", more="", origin="0 0 0.3"):
    moving = "" if kind == "fixed" else '<limit lower="-2" upper="1" velocity="2" effort="90"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{origin}"/><axis xyz="0 1 0"/>{moving}{more}</joint>'
    )


PARTS = [
    link("base", ""),
    link("l1"),
    link("l2"),
    link("l3"),
    link("tool0", ""),
    joint("j1", "base", "l1"),
    joint("j2", "l1", "l2"),
    joint("j3", "l2", "l3"),
    joint("mount", "l3", "tool0", "fixed"),
]


def write(folder, *more, without=(), settings=None, name="arm.urdf"):
    kept = [part for part in PARTS if not any(f'name="{word}"' in part[:25] for word in without)]
    path = folder / name
    path.write_text(f'<robot name="arm">{"".join([*kept, *more])}</robot>')
    if settings is not None:
        (folder / "robot.yaml").write_text(settings)
    return path


def refused(path, *codes):
    with pytest.raises(RobotError) as caught:
        load_robot(path)
    assert [fault.code for fault in caught.value.faults] == list(codes)
    return caught.value.faults


def doubts(robot):
    return {fault.code: fault for fault in robot.description.warnings}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('value="7"', 'value="7 "'),
        ('value="7"', 'value="&#9;7"'),
        (' ixy="0" ixz="0" iyz="0"', ""),
        ("0 0 0.1", "0&#9;0&#10;0.1"),
        ("0.1 0.1 0.2", " 0.1  0.1\n0.2 "),
        ("<collision>", '<visual><geometry><box size="1 1 1"/></geometry><material/></visual>'
         "<collision>"),
        ('ixx="0.02"', 'ixx="+2.0E-2"'),
    ],
)  # fmt: off
def test_what_another_parser_drops_is_kept(tmp_path, old, new):
    plain = load_robot(write(tmp_path))
    text = (tmp_path / "arm.urdf").read_text()
    assert old in text
    (tmp_path / "arm.urdf").write_text(text.replace(old, new))
    robot = load_robot(tmp_path / "arm.urdf")
    assert robot == plain
    assert [m.body.name for m in link_bodies(robot)] == ["l1", "l2", "l3"]
    assert sum(inertia.mass for inertia in robot.model.inertias) == 21
    assert np.allclose(np.diag(robot.model.inertias[2].inertia), [0.02, 0.03, 0.04])


def test_a_model_that_is_not_what_was_read_is_refused(tmp_path, monkeypatch):
    description = load_robot(write(tmp_path)).description
    honest = Description._xml(description)
    for old, new, field in (
        ('<mass value="7.0"/>', '<mass value="8.0"/>', "joint j3 mass"),
        ('ixx="0.02"', 'ixx="0.021"', "joint j3 inertia"),
        ('xyz="0.0 0.0 0.3" rpy="0.0 0.0 0.0"/>', 'xyz="0 0 0.31"/>', "link tool0.origin"),
        ('upper="1.0"', 'upper="1.1"', "joint j3.limit"),
        ('<axis xyz="0.0 1.0 0.0"/>', '<axis xyz="0 -1 0"/>', "joint j3.axis"),
    ):
        head, found, tail = honest.rpartition(old)
        assert found
        monkeypatch.setattr(Description, "_xml", lambda _, text=head + new + tail: text)
        with pytest.raises(RobotError) as caught:
            description.build_model()
        assert {fault.code for fault in caught.value.faults} == {"urdf-mismatch"}
        assert field in {fault.field for fault in caught.value.faults}


def test_links_that_nothing_can_hit_are_named(tmp_path):
    picture = '<visual><geometry><box size="0.1 0.1 0.2"/></geometry></visual>'
    path = write(tmp_path, link("l2", BODY + picture), without=("l2",))
    robot = load_robot(path)
    assert "l2" in doubts(robot)["link-bare"].value
    assert "l1" not in doubts(robot)["link-bare"].value
    for use in ("true", "[l2]"):
        (tmp_path / "robot.yaml").write_text(f"use_visual_shapes: {use}")
        robot = load_robot(path)
        assert "link-bare" not in doubts(robot)
        assert {m.body.name for m in link_bodies(robot)} == {"l1", "l2", "l3"}
    (tmp_path / "robot.yaml").write_text("use_visual_shapes: [l9]")
    refused(path, "robot-value")
    path = write(tmp_path, link("l2", BODY), without=("l2",), settings="{}")
    assert doubts(load_robot(path))["link-bare"].value.startswith("l2:")


def test_the_flange_is_on_the_last_moving_joint(tmp_path):
    for parent in ("base", "l2"):
        camera = [link("camera", ""), joint("zz", parent, "camera", "fixed")]
        assert load_robot(write(tmp_path, *camera)).flange == "tool0"
    two = [link("gauge", ""), joint("zz", "l3", "gauge", "fixed")]
    assert load_robot(write(tmp_path, *two)).flange == "tool0"
    path = write(tmp_path, *two, link("hook", ""), joint("m", "l3", "hook", "fixed"),
                 without=("tool0", "mount"))  # fmt: off
    (fault,) = refused(path, "robot-flange")
    assert "gauge" in fault.legal
    (tmp_path / "robot.yaml").write_text("flange: hook")
    assert load_robot(path).flange == "hook"
    (tmp_path / "robot.yaml").write_text("flange: l2")
    (fault,) = refused(path, "robot-flange")
    assert "hook" in fault.legal


def test_link_and_joint_may_share_a_name(tmp_path):
    text = write(tmp_path).read_text().replace('"mount"', '"tool0"').replace('"j2"', '"l3"')
    (tmp_path / "arm.urdf").write_text(text)
    robot = load_robot(tmp_path / "arm.urdf").with_payload(2.0)
    assert robot.flange == "tool0"
    assert np.allclose(robot.flange_pose(np.zeros(3)).translation, [0, 0, 1.2])


def test_fingers_are_locked_and_said_to_be(tmp_path):
    fingers = [link("a"), link("b"), joint("fa", "l3", "a", "prismatic")]
    fingers.append(joint("fb", "l3", "b", "prismatic", '<mimic joint="fa"/>'))
    robot = load_robot(write(tmp_path, *fingers))
    assert robot.num_joints == 3
    assert robot.flange == "tool0"
    assert robot.model.inertias[3].mass == 21
    assert doubts(robot)["joint-locked"].value == "fa at 0, fb at 0"
    path = write(tmp_path, *fingers, settings="locked: {fa: 0.05}")
    moved = load_robot(path)
    assert doubts(moved)["joint-locked"].value == "fa at 0.05, fb at 0"
    place = {item.link: item.placement.translation for item in moved.link_shapes()}
    assert np.allclose(place["a"] - place["b"], [0, 0.05, 0])
    (tmp_path / "robot.yaml").write_text("locked: {fc: 0.0}")
    assert "name-unknown" in {fault.code for fault in refused(path, "name-unknown")}


def test_a_rod_that_mimics_a_joint_is_no_branch(tmp_path):
    rod = [link("rod"), joint("jr", "l1", "rod", "continuous", '<mimic joint="j2"/>')]
    robot = load_robot(write(tmp_path, *rod))
    assert list(robot.model.names)[1:] == ["j1", "j2", "j3"]
    assert "jr at 0" in doubts(robot)["joint-locked"].value


def test_where_the_chain_branches_somebody_must_say(tmp_path):
    arm = [link("m1"), joint("k1", "l1", "m1")]
    (fault,) = refused(write(tmp_path, *arm), "urdf-serial")
    assert "j2" in fault.value
    assert "k1" in fault.value
    robot = load_robot(write(tmp_path, *arm, settings="flange: tool0"))
    assert robot.num_joints == 3
    robot = load_robot(write(tmp_path, *arm, settings="locked: {j2: 0.5}\nflange: m1"))
    assert list(robot.model.names)[1:] == ["j1", "k1"]


def test_a_locked_joint_stands_where_it_is_locked(tmp_path):
    free = load_robot(write(tmp_path))
    locked = load_robot(write(tmp_path, settings="locked: {j2: 0.5}"))
    assert locked.num_joints == 2
    pose = free.flange_pose(np.array([0.3, 0.5, -0.4])).homogeneous
    assert np.allclose(locked.flange_pose(np.array([0.3, -0.4])).homogeneous, pose, atol=1e-12)


def test_continuous_joints_get_two_turns(tmp_path):
    free = joint("j3", "l2", "l3", "continuous")
    robot = load_robot(write(tmp_path, free, without=("j3",)))
    assert np.allclose([robot.q_lower_rad[2], robot.q_upper_rad[2]], [-2 * np.pi, 2 * np.pi])
    assert "j3" in doubts(robot)["joint-continuous"].value
    path = write(tmp_path, free, without=("j3",), settings="q_lower_rad: -1\nq_upper_rad: 2")
    assert "joint-continuous" not in doubts(load_robot(path))


def test_a_sliding_axis_in_the_arm_is_refused(tmp_path):
    refused(write(tmp_path, joint("j2", "l1", "l2", "prismatic"), without=("j2",)), "joint-type")


def mesh_link(name, scale=""):
    shape = f'<geometry><mesh filename="{name}" {scale}/></geometry>'
    return link("l2", f"{BODY}<collision>{shape}</collision><visual>{shape}</visual>")


def dae(metre):
    box = trimesh.creation.box((0.1 / metre, 0.2 / metre, 0.3 / metre))
    numbers = " ".join(f"{x:.9g}" for x in box.vertices.ravel())
    faces = " ".join(str(i) for i in box.faces.ravel())
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{metre}"/><up_axis>Z_UP</up_axis></asset><library_geometries>
<geometry id="g"><mesh><source id="p"><float_array id="a" count="24">{numbers}</float_array>
<technique_common><accessor source="#a" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize("metre", [1.0, 0.001, 0.0254])
def test_a_dae_says_its_unit(tmp_path, metre):
    (tmp_path / "l2.dae").write_text(dae(metre))
    robot = load_robot(write(tmp_path, mesh_link("l2.dae"), without=("l2",)))
    (body,) = (m.body for m in link_bodies(robot) if m.body.name == "l2")
    points = np.concatenate([shape.vertices_m for shape in body.shapes])
    assert np.allclose(np.ptp(points, axis=0), [0.1, 0.2, 0.3])
    drawn = robot_triangles(robot)[2][0].vertices_m
    assert np.allclose(np.ptp(drawn, axis=0), [0.1, 0.2, 0.3])


def test_the_size_of_a_link_is_judged_after_its_scale(tmp_path):
    box = trimesh.creation.box((100, 200, 300))
    write_binary_stl(tmp_path / "l2.stl", box.vertices, box.faces)
    for scale, code in (("", "mesh-unit"), ('scale="1e-6 1e-6 1e-6"', "mesh-unit")):
        robot = load_robot(write(tmp_path, mesh_link("l2.stl", scale), without=("l2",)))
        with pytest.raises(DmocError) as caught:
            check_link_meshes(robot)
        assert [fault.code for fault in caught.value.faults] == [code]
    mirrored = 'scale="0.001 -0.001 0.001"'
    robot = load_robot(write(tmp_path, mesh_link("l2.stl", mirrored), without=("l2",)))
    check_link_meshes(robot)
    drawn = robot_triangles(robot)[2][0]
    assert np.allclose(np.ptp(drawn.vertices_m, axis=0), [0.1, 0.2, 0.3])
    assert trimesh.Trimesh(drawn.vertices_m, drawn.faces).volume == pytest.approx(0.006)


def package(root, name):
    (root / name / "urdf").mkdir(parents=True)
    (root / name / "meshes").mkdir()
    (root / name / "package.xml").write_text(f"<package><name>{name}</name></package>")
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    write_binary_stl(root / name / "meshes" / "l2.stl", box.vertices, box.faces)
    return root / name


def test_packages_are_found_in_the_usual_places(tmp_path, monkeypatch):
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    own = package(tmp_path / "src", "arm_support")
    other = package(tmp_path / "else" / "share", "arm_meshes")
    inside = write(own / "urdf", mesh_link("package://arm_support/meshes/l2.stl"), without=("l2",))
    check_link_meshes(load_robot(inside))
    check_link_meshes(
        load_robot(write(own / "urdf", mesh_link("../meshes/l2.stl"), without=("l2",)))
    )
    path = write(own / "urdf", mesh_link("package://arm_meshes/meshes/l2.stl"), without=("l2",))
    (fault,) = refused(path, "package-missing")
    assert fault.value == "arm_meshes"
    check_link_meshes(load_robot(path, [other.parent]))
    check_link_meshes(load_robot(path, [other]))
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(other.parent))
    check_link_meshes(load_robot(path))
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "else"))
    check_link_meshes(load_robot(path))
    outside = write(own / "urdf", mesh_link("package://arm_meshes/../../x.stl"), without=("l2",))
    refused(outside, "path-outside", "path-outside")


def test_a_missing_package_is_one_line(tmp_path):
    text = "".join(mesh_link(f"package://none/{k}.stl").replace("l2", f"m{k}", 1) for k in range(5))
    ends = "".join(joint(f"f{k}", "l3", f"m{k}", "fixed") for k in range(5))
    (fault,) = refused(write(tmp_path, text, ends), "package-missing")
    assert "5 times" in fault.value


def test_a_xacro_file_is_expanded(tmp_path):
    own = package(tmp_path, "arm_support")
    macro = (
        '<robot xmlns:xacro="http://wiki.ros.org/xacro"><xacro:macro name="arm" params="weight">'
        + "".join(PARTS).replace('value="7"', 'value="${weight / 2}"')
        + "</xacro:macro></robot>"
    )
    (own / "urdf" / "macro.xacro").write_text(macro)
    path = own / "urdf" / "arm.urdf.xacro"
    path.write_text(
        '<robot name="arm" xmlns:xacro="http://wiki.ros.org/xacro">'
        '<xacro:include filename="$(find arm_support)/urdf/macro.xacro"/>'
        '<xacro:arg name="kg" default="1"/><xacro:arm weight="$(arg kg)"/></robot>'
    )
    given = load_robot(path, settings={"xacro_arguments": {"kg": 14}})
    assert given == load_robot(write(tmp_path)) != load_robot(path)
    path.write_text(path.read_text().replace("arm_support", "no_support"))
    (fault,) = refused(path, "urdf-xacro")
    assert "no_support" in fault.value


def test_only_what_the_parser_reads_as_we_do_is_loaded():
    """The shipped robots, written by us, give the model of their own files to the last digit."""
    for name in ("ur10e_class", "irb6640_class", "ur3e_class", "planar2"):
        robot = load_robot(name)
        theirs, ours = pin.buildModelFromUrdf(str(robot.urdf)), robot.description.build_model()
        assert theirs == ours or all(
            np.array_equal(a.homogeneous, b.homogeneous)
            for a, b in zip(theirs.jointPlacements, ours.jointPlacements)
        )
        for a, b in zip(theirs.inertias[1:], ours.inertias[1:]):
            assert np.array_equal(a.toDynamicParameters(), b.toDynamicParameters())


def test_dynamics_are_estimated_for_a_file_without_any(tmp_path):
    bare = [part.replace(BODY, "").replace('effort="90"', 'effort="0"') for part in PARTS]
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(bare)}</robot>')
    (fault,) = refused(path, "mass-zero")
    assert "--total-mass" in fault.fix
    entries = estimated_settings(path, 30.0)
    (tmp_path / "robot.yaml").write_text(settings_text(entries))
    robot = load_robot(path)
    assert [body["mass_kg"] for body in entries["inertials"].values()] == pytest.approx([10] * 3)
    box = 10 / 12 * np.array([0.1**2 + 0.2**2, 0.1**2 + 0.2**2, 2 * 0.1**2])
    assert np.allclose(np.diag(robot.model.inertias[2].inertia), box, rtol=1e-4)
    assert np.all(robot.torque_limit_nm[:2] > robot.gravity_torque_nm(np.full(3, 1.0))[:2])
    assert np.all(robot.armature_kg_m2 > 0)
    assert set(robot.provenance.values()) == {"assumed"}
    refused_by = pytest.raises(RobotError, match="estimate-given")
    with refused_by:
        estimated_settings(path, 30.0)
    (tmp_path / "robot.yaml").write_text(
        settings_text(entries).replace("mass_kg: 10", "mass_kg: -1")
    )
    assert {fault.field for fault in refused(path, *["robot-value"] * 3, "mass-zero")} >= {
        "inertials.l1"
    }


@pytest.mark.parametrize("effort", ['effort="0"', ""])
def test_torque_limits_that_nobody_gave_are_put_in_by_name(tmp_path, effort):
    path = tmp_path / "arm.urdf"
    parts = [part.replace('effort="90"', effort, 1) for part in PARTS]
    path.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
    robot, given = load_robot(path), load_robot(write(tmp_path, name="given.urdf"))
    (warning,) = (w for w in robot.description.warnings if w.code == "torque-assumed")
    assert warning.field == "torque_limit_nm"
    assert robot.provenance["torque_limit_nm"] == "assumed"
    named = [
        name
        for name in list(robot.model.names)[1:]
        if f"{name}," in f"{warning.value},".replace(";", ",")
    ]
    changed = robot.torque_limit_nm != given.torque_limit_nm
    assert len(named) == changed.sum() > 0
    poses = np.random.default_rng(1).uniform(robot.q_lower_rad, robot.q_upper_rad, (50, 3))
    hold = np.abs(robot.gravity_torque_nm(poses)).max(axis=0)
    assert np.all(robot.torque_limit_nm[changed] >= hold[changed])
    assert f"{robot.torque_limit_nm[changed][0]:.3g}" in warning.value


SPRING = "{joint: j2, kind: gas, anchors_m: [0.8, 0.2], zero_rad: -1, area_m2: 1e-4, %s}"


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ("motor_from_joint: 3", "motor_from_joint"),
        ("motor_from_joint: null", "motor_from_joint"),
        ("motor_from_joint: [[1, 0], [0, 1]]", "motor_from_joint"),
        ("motor_from_joint: [[1, 0, 0], [0, .nan, 0], [0, 0, 1]]", "motor_from_joint"),
        ("motor_from_joint: [[0, 1, 0], [1, 0, 0], [0, 0, 1]]", "motor_from_joint"),
        ("motor_from_joint: [[1, 0, 0], [0, 1, 1], [0, 1, 1]]", "motor_from_joint"),
        ("motor_zero_rad: [0, 0]", "motor_zero_rad"),
        ("motor_zero_rad: [0, 0, .inf]", "motor_zero_rad"),
        ("torque_offset_nm: [0, 0, zero]", "torque_offset_nm"),
        (f"torque_offset_nm: 1{'0' * 400}", "torque_offset_nm"),
        ("identified: [1]", "identified"),
        ("identified: {states: good}", "identified.states"),
        ("identified: {status: 3}", "identified.status"),
        ("identified: {std: [1, 2]}", "identified.std"),
        ("identified: {coupling: [[1, 2, 3]]}", "identified.coupling"),
        ("springs: gas", "springs[0]"),
        ("springs: [gas]", "springs[0]"),
        (f"springs: [{SPRING % 'volume_m3: 1e-3'}]", "springs[0]"),
        (f"springs: [{SPRING % 'volume_m3: 1e-3, gas_j: .nan'}]", "springs[0]"),
        (f"springs: [{SPRING % 'volume_m3: 0, gas_j: 9'}]", "springs[0]"),
        (f"springs: [{SPRING % 'volume_m3: 1e-3, gas_j: 9, colour: 1'}]", "springs[0]"),
        (f"springs: [{SPRING.replace('j2', 'j9') % 'volume_m3: 1, gas_j: 9'}]", "springs[0]"),
        (
            f"springs: [{SPRING.replace('[0.8, 0.2]', '0.8') % 'volume_m3: 1, gas_j: 9'}]",
            "springs[0]",
        ),
    ],
)
def test_dynamics_in_settings_are_checked(tmp_path, settings, field):
    path = write(tmp_path, settings=settings)
    assert [fault.field for fault in refused(path, "robot-value")] == [field]


def test_dynamics_that_identify_writes_are_taken(tmp_path):
    settings = (
        "motor_from_joint: [[-100, 0, 0], [0, 90, 0], [0, 90, 80]]\nmotor_zero_rad: [0, -1.5, 0]\n"
        "identified: {status: poor, coupling: [[0.1, 0.2, 0.3]], std: {armature: [1, 1, 1]}}\n"
        f"torque_offset_nm: -1\nsprings: [{SPRING % 'volume_m3: 1.0e-3, gas_j: 9, scale: 0.9'}]\n"
    )
    load_robot(write(tmp_path, settings=settings))
