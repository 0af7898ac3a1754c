"""An arm on a linear track: model, kinematics, torques, certificate, plan and program."""

import numpy as np
import pinocchio as pin
import pytest
import yaml

from dmoc.errors import InputError
from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.physics.dynamics import arm_model
from dmoc.robot.controller import controller_from_mapping
from dmoc.robot.robot import available_robots, load_robot
from planning.arm.inverse_kinematics import TOLERANCE, inverse
from planning.arm.screws import chain_of
from sequencing.cycle_types import CycleMotion
from sequencing.edges.line_torques import line_sums
from sequencing.export.exporting import export_run
from sequencing.export.readers import read_krl, read_rapid
from sequencing.runs.folder import write_motions

TRACK = """
  <link name="rail"><inertial><mass value="400"/><origin xyz="0 0 0"/>
    <inertia ixx="50" ixy="0" ixz="0" iyy="50" iyz="0" izz="50"/></inertial>
    <collision><origin xyz="0 0 -0.2"/><geometry><box size="4 0.5 0.2"/></geometry></collision>
  </link>
  <joint name="track" type="prismatic"><parent link="rail"/><child link="base_link"/>
    <origin xyz="0 0 0" rpy="0 0 0.4"/><axis xyz="1 0 0"/>
    <limit lower="-1.2" upper="1.2" velocity="1.5" effort="4000"/></joint>
</robot>"""


def quintic(robot, start, goal, duration_s):
    t = np.linspace(0, 1, 17)[:, None]
    q = start + (10 * t**3 - 15 * t**4 + 6 * t**5) * (goal - start)
    v = (30 * t**2 - 60 * t**3 + 30 * t**4) * (goal - start) / duration_s
    torque = inverse_dynamics(robot.model, q[:-1], v[:-1], 0 * v[:-1])
    return JointTrajectory(t[:, 0] * duration_s, q, v, torque, robot)


def on_track(folder, name="ur10e_class"):
    """A robot of the package on a track of its own."""
    shipped = load_robot(name).urdf
    urdf = folder / "tracked.urdf"
    urdf.write_text(shipped.read_text().replace("</robot>", TRACK))
    settings = yaml.safe_load(shipped.with_name("robot.yaml").read_text())
    limits = load_robot(name)
    for key, first in (("armature_kg_m2", 60.0), ("acceleration_limit_rad_s2", 3.0)):
        settings[key] = [first, *getattr(limits, key).tolist()]
    for key in ("torque_limit_nm", "velocity_limit_rad_s", "q_lower_rad", "q_upper_rad", "drive"):
        settings.pop(key, None)
    settings["provenance"] = {}
    settings["allowed_collisions"].append(["rail", "base_link"])
    settings["controller"] = {"vendor": "any", "coupling": "none"}
    (folder / "robot.yaml").write_text(yaml.safe_dump(settings))
    return load_robot(urdf)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return on_track(tmp_path_factory.mktemp("track"))


def random_q(robot, count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (count, robot.num_joints))


def test_the_model_slides_and_then_turns(robot):
    assert robot.slides.tolist() == [True] + [False] * 6
    here, there = (robot.tip_pose(np.array([x, 0, -1, 1, 0, 0, 0])) for x in (0.0, 0.7))
    moved = 0.7 * np.array([np.cos(0.4), np.sin(0.4), 0])
    np.testing.assert_allclose(there.translation - here.translation, moved, atol=1e-9)


def test_screws_and_their_jacobian_agree_with_pinocchio(robot):
    chain = chain_of(robot)
    q = random_q(robot, 20)
    pose, jacobian = chain.forward_jacobian(q)
    for k, row in enumerate(q):
        np.testing.assert_allclose(pose[k], robot.tip_pose(row).homogeneous, atol=1e-9)
        for j in range(7):
            step = np.zeros(7)
            step[j] = 1e-6
            change = chain.forward(np.array([row + step, row - step]))
            slope = (change[0, :3, 3] - change[1, :3, 3]) / 2e-6
            np.testing.assert_allclose(jacobian[k, :3, j], slope, atol=1e-7)


def test_inverse_kinematics_solves_the_arm_at_places_along_the_track(robot):
    poses = np.array([robot.tip_pose(row).homogeneous for row in random_q(robot, 3)])
    found = inverse(robot, poses)
    for row, k in zip(found.q_rad, found.pose):
        assert np.abs(robot.tip_pose(row).homogeneous - poses[k]).max() < 10 * TOLERANCE
    assert np.all(found.q_rad >= robot.q_lower_rad - 1e-9)
    assert np.all(found.q_rad <= robot.q_upper_rad + 1e-9)
    places, seen = np.linspace(-1.2, 1.2, 6), 0
    for place in places:
        turn = pin.utils.rotate("z", 0.4)
        base = pin.SE3(turn, turn @ np.array([place, 0, 0]))
        alone = inverse(load_robot("ur10e_class").with_base(base), poses)
        here = np.abs(found.q_rad[:, 0] - place) < 1e-12
        assert (
            np.bincount(found.pose[here], minlength=3).tolist()
            == np.bincount(alone.pose, minlength=3).tolist()
        )
        seen += int(here.sum())
    assert seen == len(found.q_rad) > 0


def test_line_torques_are_those_of_inverse_dynamics(robot):
    start, goal = random_q(robot, 2)
    rule = np.array([[1.0, 0.3, 0.7, 1.9]])
    ((still2, mixed, moved2),) = line_sums(robot.model, start[None], goal[None], rule)
    data, d = robot.model.createData(), goal - start
    q, v, a = start + 0.3 * d, 0.7 * d, 1.9 * d
    torque = pin.rnea(robot.model, data, q, v, a)
    gravity = pin.computeGeneralizedGravity(robot.model, data, q)
    u = torque - gravity
    wanted = [gravity @ gravity, 2 * gravity @ u, u @ u]
    np.testing.assert_allclose([still2, mixed, moved2], wanted, rtol=1e-9)
    assert not arm_model(robot.model).joints[0].revolute


def test_the_controller_counts_the_track_in_millimetres(robot):
    section = {"vendor": "kuka", "coupling": "minus_axis_2", "sign": [-1, 1, 1, 1, 1, 1, 1]}
    section["offset_deg"] = [500, 0, -90, 0, 0, 0, 0]
    controller = controller_from_mapping(section, 7, robot.slides)
    q = np.array([0.3, *np.radians([10, 20, 30, 40, 50, 60])])
    np.testing.assert_allclose(controller.degrees(q), [200, 10, -70, 100, 40, 50, 60])
    np.testing.assert_allclose(controller.radians(controller.degrees(q)), q, atol=1e-12)


@pytest.mark.parametrize(("format", "read"), [("rapid", read_rapid), ("krl", read_krl)])
def test_programs_move_the_track_as_an_external_axis(robot, tmp_path, format, read):
    start = np.array([-0.4, 0, -1.2, 1.3, 0.2, 0.3, 0])
    goal = np.array([0.5, 0.4, -1.0, 1.0, 0.1, 0.5, 0.3])
    motion = Motion(Status.CONVERGED, "refined", quintic(robot, start, goal, 4.0), cost=1.0)
    item = CycleMotion("m000", "here", "there", "travel", motion)
    run = write_motions("track", robot, [item], Cost(), tmp_path / "run", seed=0)
    (path,) = export_run(run, format, tmp_path).files
    last = read(path)["m000"].degrees[-1]
    np.testing.assert_allclose(last, [*np.degrees(goal[1:]), 500], atol=1e-5)
    with pytest.raises(InputError) as caught:
        export_run(run, "urscript", tmp_path)
    assert caught.value.faults[0].code == "export-joints"


def test_every_robot_of_the_package_turns_only():
    assert not any(load_robot(name).slides.any() for name in available_robots())
