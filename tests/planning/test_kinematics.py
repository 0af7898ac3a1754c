"""Inverse kinematics: every branch, exact, for both closed families and for other arms."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.robot.robot import Tool, load_robot
from planning.arm.closed_forms import closed_form
from planning.arm.inverse_kinematics import follow_line, inverse, wraps
from planning.arm.numeric import converge, multi_start
from planning.arm.screws import ScrewAxes, chain_of, pose_error, rotation_log

TOOL = Tool(
    mass_kg=1.0,
    tip_position_m=np.array([0.3, 0.02, -0.4]),
    tip_quaternion_xyzw=np.array([0.8, 0.0, 0.6, 0.0]),
)
BASE = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 2.0), np.array([0.4, -1.0, 0.3]))


@pytest.fixture(scope="module", params=["irb6640_class", "ur10e_class"])
def robot(request):
    return load_robot(request.param).with_tool(TOOL).with_base(BASE)


def random_q(robot, count, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (count, robot.num_joints))


def test_forward_kinematics_equals_pinocchio(robot):
    chain = chain_of(robot)
    q = random_q(robot, 50, 1)
    poses, jacobian = chain.forward_jacobian(q)
    frame = robot.flange_id
    data = robot.model.createData()
    for row, pose, rates in zip(q, poses, jacobian, strict=True):
        tip = robot.tip_pose(row)
        assert np.allclose(pose, tip.homogeneous, atol=1e-12)
        pin.computeJointJacobians(robot.model, data, row)
        pin.updateFramePlacements(robot.model, data)
        flange = pin.getFrameJacobian(
            robot.model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        arm = tip.translation - data.oMf[frame].translation
        assert np.allclose(rates[3:], flange[3:], atol=1e-12)
        assert np.allclose(rates[:3], flange[:3] + np.cross(flange[3:].T, arm).T, atol=1e-12)


def test_every_configuration_is_found_again(robot):
    q = random_q(robot, 200, 2)
    chain = chain_of(robot)
    poses = chain.forward(q)
    found = inverse(robot, poses)
    assert np.abs(pose_error(poses[found.pose], chain.forward(found.q_rad))).max() <= 1e-9
    assert np.all(found.q_rad >= robot.q_lower_rad)
    assert np.all(found.q_rad <= robot.q_upper_rad)
    for k, row in enumerate(q):
        assert np.abs(found.q_rad[found.pose == k] - row).max(axis=1).min() < 1e-8
    assert found.num_branches.max() == 8


def test_closed_form_finds_what_many_random_starts_find(robot):
    """Slow oracle: damped least squares from 300 starts finds no branch that is not there."""
    chain = chain_of(robot)
    full = ScrewAxes(chain.axis, chain.point, chain.home, np.full(6, -np.pi), np.full(6, np.pi))
    wide = robot.with_limits(q_lower_rad=-np.pi, q_upper_rad=np.pi)
    for k, pose in enumerate(chain.forward(random_q(robot, 3, 3))):
        slow = multi_start(full, pose, 300, seed=k)
        fast = inverse(wide, pose[None]).q_rad
        for row in slow:
            turn = (fast - row + np.pi) % (2 * np.pi) - np.pi
            assert np.abs(turn).max(axis=1).min() < 1e-6
        assert len(slow) == len(fast)


def test_singular_wrist_and_stretched_arm():
    robot = load_robot("irb6640_class")
    chain = chain_of(robot)
    straight = np.array([0.3, 0.2, -0.4, 0.0, 0.0, 0.5])
    found = inverse(robot, chain.forward(straight))
    assert (
        np.abs(
            pose_error(
                chain.forward(np.repeat(straight[None], len(found.q_rad), 0)),
                chain.forward(found.q_rad),
            )
        ).max()
        <= 1e-9
    )
    assert len(found.q_rad) >= 1
    reach = float(np.arctan2(0.2, 1.392))  # elbow offset: here the forearm continues the arm
    stretched = np.array([0.0, 0.5, -np.pi / 2 + reach, 0.7, 0.4, 0.1])
    found = inverse(robot, chain.forward(stretched))
    assert np.abs(found.q_rad - stretched).max(axis=1).min() < 1e-4


def test_out_of_reach_gives_nothing(robot):
    pose = np.eye(4)
    pose[0, 3] = 20.0
    found = inverse(robot, pose[None])
    assert len(found.q_rad) == 0
    assert found.num_branches[0] == 0


def test_wraps_are_all_turns_within_limits():
    rows = wraps(np.array([0.5, 3.0]), np.array([-7.0, -3.2]), np.array([7.0, 3.2]))
    assert sorted(np.round(rows[:, 0], 9)) == pytest.approx([0.5 - 2 * np.pi, 0.5, 0.5 + 2 * np.pi])
    assert len(wraps(np.array([0.5]), np.array([-0.4]), np.array([0.4]))) == 0
    # A limit that is met to rounding counts, and is returned as the limit itself.
    assert wraps(np.array([0.4 + 1e-12]), np.array([-0.4]), np.array([0.4]))[0, 0] == 0.4


def seven_joints():
    """A made-up arm with seven joints: an extra roll in front of the UR-class chain."""
    chain = chain_of(load_robot("ur10e_class"))
    axis = np.vstack([[1.0, 0, 0], chain.axis])
    point = np.vstack([[0.0, 0, 0.1], chain.point])
    return ScrewAxes(axis, point, chain.home, np.full(7, -2.9), np.full(7, 2.9))


def test_seven_joints_are_sampled_and_repeatable():
    chain = seven_joints()
    assert closed_form(chain) is None
    pose = chain.forward(np.array([[0.2, 0.3, -1.2, 1.0, -0.5, 1.0, 0.3]]))[0]
    first, again = (multi_start(chain, pose, 40, seed=5) for _ in range(2))
    assert np.array_equal(first, again)
    assert len(first) >= 5
    goal = np.broadcast_to(pose, (len(first), 4, 4))
    assert np.abs(pose_error(goal, chain.forward(first))).max() <= 1e-9


def test_lines_keep_orientation_and_branch(robot):
    chain = chain_of(robot)
    q = 0.5 * random_q(robot, 20, 6)
    offset = np.linspace(0, 0.03, 7)[None, :, None] * np.array([0.0, 0.6, 0.8])
    line, good = follow_line(chain, q, np.repeat(offset, 20, axis=0))
    start = chain.forward(q)
    for k in np.flatnonzero(good):
        goal = np.repeat(start[k][None], 7, axis=0)
        goal[:, :3, 3] += offset[0]
        assert np.abs(pose_error(goal, chain.forward(line[k]))).max() < 1e-9
        assert np.array_equal(line[k, 0], q[k])
        assert np.abs(np.diff(line[k], axis=0)).max() < 0.2
    assert good.sum() >= 10


def test_lines_out_of_reach_or_limits_are_refused():
    robot = load_robot("irb6640_class")
    chain = chain_of(robot)
    q = np.array([[0.0, 0.5, -1.3, 0.1, 0.3, 0.0]])
    far = np.linspace(0, 3.0, 5)[None, :, None] * np.array([1.0, 0.0, 0.0])
    assert not follow_line(chain, q, far)[1][0]
    tight = ScrewAxes(chain.axis, chain.point, chain.home, q[0] - 1e-3, q[0] + 1e-3)
    assert not follow_line(tight, q, far / 50)[1][0]


@given(st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3))
@settings(max_examples=60, deadline=None)
def test_rotation_log_is_the_inverse_of_exp(vector):
    turn = np.array(vector)
    if np.linalg.norm(turn) > np.pi - 1e-6:
        turn *= 3.0 / np.linalg.norm(turn)
    assert np.allclose(rotation_log(pin.exp3(turn)[None])[0], turn, atol=1e-7)


def test_converge_says_when_it_did_not_arrive():
    chain = chain_of(load_robot("irb6640_class"))
    pose = np.eye(4)
    pose[0, 3] = 9.0
    assert not converge(chain, pose[None], np.zeros((1, 6)), iterations=20)[1][0]


def straight_wrists(name, q5, count, seed):
    """The arm, its chain, and random q of it with joint 5 at `q5`."""
    robot = load_robot(name)
    turn = np.array([np.pi] * 4 + [2 * np.pi] + [np.pi])  # fewer wrap-arounds, sooner done
    robot = robot.with_limits(
        q_lower_rad=np.maximum(robot.q_lower_rad, -turn),
        q_upper_rad=np.minimum(robot.q_upper_rad, turn),
    )
    q = random_q(robot, count, seed)
    q[:, 4] = q5
    return robot, chain_of(robot), q


def with_rounded_quaternions(poses, digits):
    """The poses as a file with so many digits has them."""
    poses = poses.copy()
    for pose in poses:
        parts = np.round(pin.Quaternion(pose[:3, :3].copy()).coeffs(), digits)
        pose[:3, :3] = pin.Quaternion(parts / np.linalg.norm(parts)).matrix()
    return poses


ARMS = ["irb6640_class", "ur10e_class", "ur3e_class"]
TURNS = [0.0, 1e-12, 3e-10, 1e-9, 1e-8, -1e-8, 1e-7, -1e-7, 9e-7, 1e-6, 1e-5, 1e-3]


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("half_turns", [-2, -1, 0, 1, 2])
def test_no_straight_wrist_is_lost(name, half_turns):
    """Over all turns and arms some thousand poses, each reachable as it is made from a legal q."""
    limit = load_robot(name).q_upper_rad[4]
    if abs(half_turns) * np.pi > limit:
        pytest.skip("beyond the limits of joint 5")
    for k, turn in enumerate(TURNS):
        q5 = half_turns * np.pi + turn
        if abs(q5) > limit:
            q5 = half_turns * np.pi - turn
        robot, chain, q = straight_wrists(name, q5, 30, seed=11 * k + half_turns + 2)
        poses = chain.forward(q)
        found = inverse(robot, poses)
        assert set(found.pose) == set(range(30))
        assert np.abs(pose_error(poses[found.pose], chain.forward(found.q_rad))).max() <= 1e-9
        assert np.all((found.q_rad >= robot.q_lower_rad) & (found.q_rad <= robot.q_upper_rad))
        if abs(turn) >= 1e-7:  # nearer to straight q4 and q6 drown in rounding
            for row, index in zip(q, range(30), strict=True):
                away = np.abs(found.q_rad[found.pose == index] - row).max(axis=1).min()
                assert away < 2e-13 / abs(turn) + 1e-6  # angles within 1e-6 are one solution


@pytest.mark.parametrize("digits", [6, 7, 8])
@pytest.mark.parametrize("name", ARMS)
def test_straight_wrists_of_files_are_found(name, digits):
    for q5 in (0.0, 1e-8, 1e-7):
        robot, chain, q = straight_wrists(name, q5, 50, seed=digits)
        poses = with_rounded_quaternions(chain.forward(q), digits)
        found = inverse(robot, poses)
        assert set(found.pose) == set(range(50))
        error = np.abs(pose_error(poses[found.pose], chain.forward(found.q_rad)))
        assert error.max() <= 4 * 10.0**-digits


@pytest.mark.parametrize("name", ARMS)
def test_random_poses_of_files_are_found(name):
    robot = load_robot(name)
    chain = chain_of(robot)
    poses = with_rounded_quaternions(chain.forward(random_q(robot, 500, 21)), 8)
    found = inverse(robot, poses)
    assert np.abs(pose_error(poses[found.pose], chain.forward(found.q_rad))).max() <= 1e-9
    assert set(found.pose) == set(range(500))


@pytest.mark.parametrize("name", ["irb6640_class", "ur10e_class"])
def test_lines_lead_on_from_straight_wrists(name):
    """From the one q of a pose a line seldom leads on, as joint 4 would have to jump; of the
    samples one suits nearly every direction."""
    robot, chain, q = straight_wrists(name, 0.0, 25, seed=2)
    q[:, [0, 1, 2, 3, 5]] *= 0.5
    found = inverse(robot, chain.forward(q))
    way = np.random.default_rng(3).normal(size=(25, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    offset = np.linspace(0, 0.02, 5)[None, :, None] * way[found.pose][:, None]
    line, good = follow_line(chain, found.q_rad, offset)
    assert len(set(found.pose[good])) >= 22
    for k in np.flatnonzero(good)[:40]:
        goal = np.repeat(chain.forward(found.q_rad[k])[:1], 5, axis=0)
        goal[:, :3, 3] += offset[k]
        assert np.abs(pose_error(goal, chain.forward(line[k]))).max() < 1e-9


def test_line_in_the_plane_of_a_straight_wrist():
    _, chain, q = straight_wrists("irb6640_class", 0.0, 20, seed=5)
    q *= 0.4
    q[:, [3, 4]] = 0.0
    forward = np.stack([np.cos(q[:, 0]), np.sin(q[:, 0]), np.zeros(20)], axis=1)
    line, good = follow_line(chain, q, np.linspace(0, 0.03, 7)[None, :, None] * forward[:, None])
    assert good.sum() >= 18
    assert np.abs(line[good][:, -1, 4]).min() > 5e-4
