"""The robots of the package, and what a Robot keeps, changes and survives."""

import pickle
import re
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from authoring.robots.generate import write_robots
from authoring.robots.ur10e import DH
from dmoc.errors import RobotError
from dmoc.robot.robot import Robot, Tool, available_robots, load_robot
from dmoc.robot.settings import ROTOR_RAD_S2

HOME = np.array([0.0, -0.35, 0.35, 0.0, 0.6, 0.0])


@pytest.fixture(scope="module", params=["irb6640_class", "ur10e_class"])
def robot(request) -> Robot:
    return load_robot(request.param)


def test_urdfs_are_what_the_generator_writes(tmp_path):
    for path in write_robots(tmp_path):
        shipped = load_robot(path.parent.name).urdf
        assert path.read_bytes() == shipped.read_bytes()


def test_heavy_arm_has_the_published_reach_and_axes():
    robot = load_robot("irb6640_class")
    pose = robot.flange_pose(np.zeros(6))
    assert pose.translation == pytest.approx([0.32 + 1.392 + 0.2, 0, 0.78 + 1.075 + 0.2])
    assert np.rad2deg(robot.q_upper_rad) == pytest.approx([170, 85, 70, 300, 120, 360])
    assert np.rad2deg(robot.velocity_limit_rad_s) == pytest.approx([100, 90, 90, 170, 140, 190])


def test_ur_class_follows_its_denavit_hartenberg_table():
    robot = load_robot("ur10e_class")
    for q in np.random.default_rng(3).uniform(-3, 3, (20, 6)):
        pose = np.eye(4)
        for angle, (a, d, alpha) in zip(q, DH, strict=True):
            c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
            pose = pose @ np.array(
                [
                    [c, -s * ca, s * sa, a * c],
                    [s, c * ca, -c * sa, a * s],
                    [0, sa, ca, d],
                    [0, 0, 0, 1],
                ]
            )
        assert np.allclose(robot.flange_pose(q).homogeneous, pose, atol=1e-12)


def test_every_number_is_tagged(robot):
    assert {"kinematics", "mass", "inertia", "armature_kg_m2", "torque_limit_nm", "shapes"} <= set(
        robot.provenance
    )
    for tag in robot.provenance.values():
        assert tag in ("measured", "assumed") or tag.startswith("published: ")


def test_shapes_are_those_that_the_parser_finds_in_a_plain_file(robot):
    geometry = pin.buildGeomFromUrdf(robot.model, str(robot.urdf), pin.GeometryType.COLLISION)
    theirs = {}
    for item in geometry.geometryObjects:
        link = robot.model.frames[item.parentFrame].name
        theirs.setdefault(link, []).append((item.parentJoint, item.placement, item.geometry))
    assert len(geometry.geometryObjects) == len(robot.link_shapes()) > 5
    for item in robot.link_shapes():
        joint, placement, solid = theirs[item.link].pop(0)
        assert joint == item.joint
        assert np.allclose(placement.homogeneous, item.placement.homogeneous, atol=1e-12)
        size = {
            "box": lambda s: 2 * s.halfSide,
            "cylinder": lambda s: [s.radius, 2 * s.halfLength],
            "sphere": lambda s: [s.radius],
        }[item.shape.kind](solid)
        assert np.allclose(size, item.shape.size_m)


def test_pairs_that_may_not_touch_are_apart_at_home(robot):
    geometry = pin.buildGeomFromUrdf(robot.model, str(robot.urdf), pin.GeometryType.COLLISION)
    geometry.addAllCollisionPairs()
    data, shapes = robot.model.createData(), geometry.createData()
    q = HOME if robot.name == "irb6640_class" else np.array([0, -1.5, 1.2, -1, -1.5, 0.0])
    pin.computeDistances(robot.model, data, geometry, shapes, q)
    allowed = {frozenset(pair) for pair in robot.allowed_collisions}
    for pair, result in zip(geometry.collisionPairs, shapes.distanceResults, strict=True):
        names = frozenset(
            robot.model.frames[geometry.geometryObjects[i].parentFrame].name
            for i in (pair.first, pair.second)
        )
        if len(names) == 2 and names not in allowed:
            assert result.min_distance > 0.02, names


def test_tool_and_payload_load_the_joints():
    robot = load_robot("irb6640_class")
    tool = Tool(mass_kg=90, com_m=np.array([0.24, 0, 0]), inertia_kg_m2=np.eye(3))
    loaded = robot.with_tool(tool).with_payload(10.0)
    before, after = robot.gravity_torque_nm(HOME), loaded.gravity_torque_nm(HOME)
    flange = robot.flange_pose(HOME)
    lever = (flange.act(np.array([0.24, 0, 0]))[0] - 0.32) * 90 + (
        flange.translation[0] - 0.32
    ) * 10
    assert before[1] - after[1] == pytest.approx(9.81 * lever, rel=1e-6)
    assert len({robot.fingerprint, loaded.fingerprint, robot.with_tool(tool).fingerprint}) == 3


def test_base_moves_the_arm_and_the_fixed_shapes():
    robot = load_robot("irb6640_class")
    base = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 0.7), np.array([1.0, -2.0, 0.5]))
    moved = robot.with_base(base)
    assert np.allclose(
        moved.flange_pose(HOME).homogeneous, (base * robot.flange_pose(HOME)).homogeneous
    )
    for before, after in zip(robot.link_shapes(), moved.link_shapes(), strict=True):
        expected = base * before.placement if before.joint == 0 else before.placement
        assert np.allclose(after.placement.homogeneous, expected.homogeneous)
    assert np.allclose(moved.gravity_torque_nm(HOME), robot.gravity_torque_nm(HOME))


def test_mass_scale_scales_gravity_and_leaves_the_tool():
    robot = load_robot("irb6640_class")
    heavy = robot.with_mass_scale(1.6)
    assert heavy.gravity_torque_nm(HOME) == pytest.approx(1.6 * robot.gravity_torque_nm(HOME))
    assert heavy.fingerprint != robot.fingerprint
    assert heavy.with_mass_scale(1.0) == robot


def _gravity(robot: Robot) -> np.ndarray:
    return robot.gravity_torque_nm(HOME)


def test_pickle_survives_another_process():
    robot = load_robot("irb6640_class").with_payload(5.0)
    copy = pickle.loads(pickle.dumps(robot))
    assert copy == robot
    assert copy.provenance == robot.provenance
    assert not copy.torque_limit_nm.flags.writeable
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert np.array_equal(pool.submit(_gravity, robot).result(), _gravity(robot))


def test_limits_change_the_fingerprint_and_are_read_only():
    robot = load_robot("ur10e_class")
    weak = robot.with_limits(torque_limit_nm=0.5 * robot.torque_limit_nm)
    assert weak.fingerprint != robot.fingerprint
    with pytest.raises(ValueError, match="read-only"):
        weak.torque_limit_nm[0] = 1.0


def test_seven_joints_load(tmp_path):
    text = load_robot("irb6640_class").urdf.read_text()
    extra = text.replace(
        '<joint name="flange_fixed" type="fixed">',
        '<joint name="joint_7" type="revolute"><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="10"/>',
    ).replace(
        '<link name="flange"/>',
        '<link name="flange"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1"/></inertial></link>',
    )
    (tmp_path / "arm.urdf").write_text(extra)
    robot = load_robot(tmp_path / "arm.urdf")
    assert robot.num_joints == 7
    assert robot.flange == "flange"


def test_names_of_the_package():
    assert {"irb6640_class", "ur10e_class"} <= set(available_robots())


def bare_arm(folder: Path) -> Path:
    """The UR10e-class URDF without its robot.yaml."""
    urdf = folder / "arm.urdf"
    urdf.write_bytes(load_robot("ur10e_class").urdf.read_bytes())
    return urdf


def test_what_nobody_gave_is_named_with_what_was_taken(tmp_path: Path) -> None:
    robot = load_robot(bare_arm(tmp_path))
    doubts = {doubt.code: doubt for doubt in robot.description.warnings}
    assert {"robot-yaml-missing", "acceleration-assumed", "armature-missing"} <= set(doubts)
    assert f"{robot.acceleration_limit_rad_s2[0]:.3g}" in doubts["acceleration-assumed"].value
    estimate = robot.torque_limit_nm / ROTOR_RAD_S2
    assert f"[{estimate[0]:.3g}," in doubts["armature-missing"].fix
    assert "assumed" in doubts["armature-missing"].fix
    (tmp_path / "robot.yaml").write_text("armature_kg_m2: 1\nacceleration_limit_rad_s2: 9\n")
    assert not load_robot(tmp_path / "arm.urdf").description.warnings


def test_a_mass_that_does_not_go_with_the_arms_length_is_named(tmp_path: Path) -> None:
    urdf = bare_arm(tmp_path)
    codes = [doubt.code for doubt in load_robot(urdf).description.warnings]
    assert "robot-mass" not in codes  # 33 kg on 1.38 m: 13 kg/m³
    text = re.sub(
        r'<mass value="([^"]+)"', lambda m: f'<mass value="{10 * float(m[1])}"', urdf.read_text()
    )
    urdf.write_text(text)
    (doubt,) = (d for d in load_robot(urdf).description.warnings if d.code == "robot-mass")
    assert doubt.value.startswith("331 kg")
    assert "80 kg/m³" in doubt.legal


def test_robots_of_the_package_give_everything_and_rotors_are_near_the_estimate() -> None:
    for name in ("ur3e_class", "ur10e_class", "irb6640_class"):
        robot = load_robot(name)
        assert not robot.description.warnings
        share = robot.armature_kg_m2 * ROTOR_RAD_S2 / robot.torque_limit_nm
        assert share.min() > 0.5
        assert share.max() < 2.1


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        ("yml", "robot-yaml-name"),
        ("folder", "robot-yaml-kind"),
        ("dangling", "robot-yaml-kind"),
        ("outside", "path-outside"),
    ],
)
def test_what_stands_in_the_place_of_robot_yaml_is_named(
    tmp_path: Path, kind: str, code: str
) -> None:
    home = tmp_path / "arm"
    home.mkdir()
    urdf, place = bare_arm(home), home / "robot.yaml"
    elsewhere = tmp_path / "other.yaml"
    if kind == "yml":
        (home / "robot.yml").write_text("armature_kg_m2: 1\n")
    elif kind == "folder":
        place.mkdir()
    else:
        place.symlink_to(elsewhere)
        if kind == "outside":
            elsewhere.write_text("armature_kg_m2: 1\n")
    with pytest.raises(RobotError) as caught:
        load_robot(urdf)
    assert [fault.code for fault in caught.value.faults] == [code]
