"""Batched forward kinematics of a serial arm: plain arrays, no Python loop over configurations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class ScrewAxes:
    """Screw axes of an arm in its zero configuration, in world axes.

    `axis` (n, 3) unit vectors h_i, `point` (n, 3) points o_i on them [m], `home` (4, 4) the end
    frame at q = 0, `lower_rad`, `upper_rad` (n,). The end frame at q is
    exp(h_1, o_1; q_1) … exp(h_n, o_n; q_n) · home. Joints in `slides` (n,) move along their axis
    (their q and limits in m).
    """

    axis: Array
    point: Array
    home: Array
    lower_rad: Array
    upper_rad: Array
    slides: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(16, dtype=np.bool_))

    @property
    def num_joints(self) -> int:
        """n."""
        return len(self.axis)

    def forward(self, q_rad: Array) -> Array:
        """End frames (K, 4, 4) at rows of q (K, n)."""
        return self._products(q_rad)[-1] @ self.home

    def forward_jacobian(self, q_rad: Array) -> tuple[Array, Array]:
        """End frames (K, 4, 4) and Jacobians (K, 6, n): linear velocity of the frame's origin
        over angular velocity, both in world axes."""
        products = self._products(q_rad)
        pose = products[-1] @ self.home
        jacobian = np.empty((len(pose), 6, self.num_joints))
        for i in range(self.num_joints):
            axis = products[i][:, :3, :3] @ self.axis[i]
            if self.slides[i]:
                jacobian[:, :3, i], jacobian[:, 3:, i] = axis, 0.0
                continue
            point = products[i][:, :3, :3] @ self.point[i] + products[i][:, :3, 3]
            jacobian[:, :3, i] = np.cross(axis, pose[:, :3, 3] - point)
            jacobian[:, 3:, i] = axis
        return pose, jacobian

    def _products(self, q_rad: Array) -> list[Array]:
        """Motions of the links 0 … n from their place at q = 0, each (K, 4, 4)."""
        q = np.atleast_2d(np.asarray(q_rad, dtype=float))
        motion = np.tile(np.eye(4), (len(q), 1, 1))
        products = [motion]
        for i in range(self.num_joints):
            step = np.tile(np.eye(4), (len(q), 1, 1))
            if self.slides[i]:
                step[:, :3, 3] = q[:, i, None] * self.axis[i]
            else:
                step[:, :3, :3] = rotation_about(self.axis[i], q[:, i])
                step[:, :3, 3] = self.point[i] - step[:, :3, :3] @ self.point[i]
            motion = motion @ step
            products.append(motion)
        return products


def chain_of(robot: Robot) -> ScrewAxes:
    """The chain from the world to the robot's tool tip."""
    model = robot.model
    pose = np.eye(4)
    axes, points = [], []
    for i in range(1, model.njoints):
        pose = pose @ model.jointPlacements[i].homogeneous
        # S = (v, ω) of a joint in its own frame: ω is the axis of one that turns, v of a slide.
        screw = np.array(model.joints[i].createData().S).reshape(6)
        local = screw[:3] if robot.slides[i - 1] else screw[3:]
        axes.append(pose[:3, :3] @ local)
        points.append(pose[:3, 3].copy())
    frame = model.frames[robot.flange_id]
    home = pose @ frame.placement.homogeneous @ robot.tool.tip.homogeneous
    limits = robot.q_lower_rad, robot.q_upper_rad
    return ScrewAxes(np.array(axes), np.array(points), home, *limits, robot.slides)


def rotation_about(axis: Array, angle_rad: Array) -> Array:
    """Rotation matrices (K, 3, 3) about one unit axis (3,): Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


def rotation_log(rotation: Array) -> Array:
    """Rotation vectors (K, 3) of rotation matrices (K, 3, 3); angles up to π."""
    skew = 0.5 * np.stack(
        [
            rotation[:, 2, 1] - rotation[:, 1, 2],
            rotation[:, 0, 2] - rotation[:, 2, 0],
            rotation[:, 1, 0] - rotation[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(skew, axis=1)
    cosine = 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)
    vector = skew * scale[:, None]
    # Half turns: the skew part vanishes, the axis is a column of R + 1.
    half = (sine <= 1e-6) & (cosine < 0)
    for k in np.flatnonzero(half):
        matrix = rotation[k] + np.eye(3)
        column = matrix[:, int(np.argmax(np.diag(matrix)))]
        vector[k] = angle[k] * column / np.linalg.norm(column)
    return vector


def pose_error(goal: Array, pose: Array) -> Array:
    """What moves `pose` onto `goal` (K, 6): metres over radians, both in world axes."""
    turn = goal[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], 1, 2)
    return np.concatenate([goal[:, :3, 3] - pose[:, :3, 3], rotation_log(turn)], axis=1)
