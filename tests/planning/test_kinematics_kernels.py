"""Compiled forward kinematics against pinocchio, on random trees with every kind of joint."""

import numpy as np
import pinocchio as pin
import pytest

from dmoc.errors import RobotError
from planning.collision.kernels.poses import joint_poses, point_gradient, relative_motion
from planning.collision.packed import pack_chain


def random_tree(rng: np.random.Generator, joints: int) -> pin.Model:
    model = pin.Model()
    for i in range(joints):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        kinds = (
            pin.JointModelRX(),
            pin.JointModelRY(),
            pin.JointModelRZ(),
            pin.JointModelPY(),
            pin.JointModelRevoluteUnaligned(axis),
            pin.JointModelPrismaticUnaligned(axis),
        )
        parent = int(rng.integers(0, model.njoints))
        model.addJoint(parent, kinds[rng.integers(6)], pin.SE3.Random(), f"joint_{i}")
    return model


def test_poses_and_point_gradients_match_pinocchio() -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        model = random_tree(rng, int(rng.integers(1, 9)))
        chain, data = pack_chain(model), model.createData()
        q = rng.uniform(-3, 3, model.nq)
        out = np.zeros((model.njoints, 15))
        joint_poses(chain.info, chain.frame, q, out)
        pin.computeJointJacobians(model, data, q)
        for j in range(1, model.njoints):
            assert np.allclose(out[j, :9].reshape(3, 3), data.oMi[j].rotation, atol=1e-12)
            assert np.allclose(out[j, 9:12], data.oMi[j].translation, atol=1e-12)
            local, normal = rng.normal(size=3), rng.normal(size=3)
            jacobian = pin.getJointJacobian(
                model, data, j, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            ).reshape(6, -1)
            arm = data.oMi[j].rotation @ local
            expected = normal @ (jacobian[:3] - pin.skew(arm) @ jacobian[3:])
            found = np.zeros(model.nv)
            point_gradient(
                out,
                chain,
                j,
                data.oMi[j].translation + arm,
                normal,
                2.0,
                found,
            )
            assert np.allclose(found, 2 * expected, atol=1e-10)


def test_only_joints_between_two_bodies_move_them_against_each_other() -> None:
    model = pin.Model()
    for i, parent in enumerate((0, 1, 2, 1)):  # a fork above joint 1
        model.addJoint(parent, pin.JointModelRX(), pin.SE3.Identity(), f"joint_{i}")
    above = pack_chain(model).above
    ra, rb, delta = np.full(4, 10.0), np.full(4, 1.0), np.array([1.0, 2.0, 3.0, 4.0])
    assert relative_motion(above, 0, 3, ra, rb, delta) == 6.0
    assert relative_motion(above, 1, 3, ra, rb, delta) == 5.0
    assert relative_motion(above, 3, 4, ra, rb, delta) == 10.0 * 5.0 + 4.0


def test_a_joint_with_two_coordinates_is_refused() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelRUBX(), pin.SE3.Identity(), "endless")
    with pytest.raises(RobotError, match="endless"):
        pack_chain(model)
