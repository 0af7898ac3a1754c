"""Poses over time for the 3-D scene."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from sequencing.runs.clock import CycleTimeline, trajectory_of


def frame_times(duration_s: float, frames_per_s: float, max_frames: int) -> Array:
    """Equally spaced times (K,) from 0 to the end, K ≤ `max_frames`."""
    count = int(np.clip(np.ceil(duration_s * frames_per_s) + 1, 2, max_frames))
    return np.linspace(0.0, duration_s, count)


def joint_frames(robot: Robot, q_rad: Array) -> Array:
    """T_parent_joint of every joint for rows of `q_rad` (K, n): (K, joints, 7) as x y z w qx qy qz.

    Rounded to 1e-5, so that pictures in which a joint rests compare equal and compress well.
    """
    data = robot.model.createData()
    frames = np.empty((len(q_rad), robot.model.njoints - 1, 7))
    for k, q in enumerate(q_rad):
        pin.forwardKinematics(robot.model, data, q)
        for joint in range(1, robot.model.njoints):
            pose = pin.SE3ToXYZQUAT(data.liMi[joint])
            frames[k, joint - 1] = pose[[0, 1, 2, 6, 3, 4, 5]]
    return frames.round(5).astype(np.float64)


def tip_path(
    line: CycleTimeline, robot: Robot, samples: int = 60
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Segments (S, 2, 3) [m] of the tip's path and the number (S,) of the motion each is of."""
    pieces, which = [], []
    for segment in line.segments:
        if segment.kind != "motion":
            continue
        curve = trajectory_of(line.motions[segment.index])
        times = np.linspace(curve.t_s[0], curve.t_s[-1], samples)
        points = np.array([robot.tip_pose(q).translation for q in curve.sample(times).q_rad])
        pieces.append(np.stack([points[:-1], points[1:]], axis=1))
        which.append(np.full(samples - 1, segment.index, dtype=np.int64))
    if not pieces:
        return np.zeros((0, 2, 3)), np.zeros(0, dtype=np.int64)
    return np.concatenate(pieces), np.concatenate(which)
