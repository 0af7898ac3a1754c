r"""How far each solid of an arm can have moved between two times of a fixed path: a proven bound.

Between two times every point of solid c moves at most

    int sum_{j carries c} r_{cj} |dq_j|,

r_{cj} bounding its distance from joint j's axis. The path is cut into P pieces; in a piece r_{cj}
is the larger distance at the two ends plus what the joints behind j can add, and int |dq_j| is
bounded by the Bernstein coefficients of the speed, a quadratic between knots.
"""

# mypy: disallow-untyped-defs=False

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dmoc.jit import njit
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from sequencing.timing.clearance.arms import ArmShapes, joint_axis, joint_frames


class SweptPath(NamedTuple):
    """Capsules along a path at P + 1 equally spaced times.

    `ends_m` (P+1, C, 2, 3) in the world, `radius_m` (C,), `travel_m` (P+1, C) the cumulated bound
    on the way of any point, `box_m` (2, 3) a box that contains all solids at all times, `moving`
    (C,) whether a solid moves at all.
    """

    duration_s: float
    ends_m: np.ndarray
    radius_m: np.ndarray
    travel_m: np.ndarray
    box_m: np.ndarray
    moving: np.ndarray


def swept_path(
    robot: Robot, shapes: ArmShapes, trajectory: JointTrajectory, pieces: int = 256
) -> SweptPath:
    """Sweep `shapes` along `trajectory` in `pieces` equal time steps."""
    t = np.linspace(0.0, trajectory.duration_s, pieces + 1) + trajectory.t_s[0]
    bare = trajectory.on(None)
    rotation, origin = joint_frames(robot, bare.sample(t).q_rad)
    joint = shapes.joint
    ends = (
        np.einsum("kcab,ceb->kcea", rotation[:, joint], shapes.ends_m)
        + origin[:, joint][:, :, None, :]
    )
    turn = joint_travel(bare, t)
    lever = _levers(robot, shapes, rotation, origin, ends, turn)
    step = np.einsum("pcj,pj->pc", lever, turn)
    travel = np.vstack([np.zeros(step.shape[1]), np.cumsum(step, axis=0)])
    slack = (shapes.radius_m + step.max(axis=0))[None, :, None, None]
    box = np.array([(ends - slack).min(axis=(0, 1, 2)), (ends + slack).max(axis=(0, 1, 2))])
    return SweptPath(
        trajectory.duration_s,
        np.ascontiguousarray(ends),
        shapes.radius_m,
        travel,
        box,
        travel[-1] > 0.0,
    )


def joint_travel(trajectory: JointTrajectory, t_s: np.ndarray) -> np.ndarray:
    """Upper bound of int |dq_j/dt| dt over each of the P intervals of `t_s` (P+1,): (P, n)."""
    inner = trajectory.t_s[(trajectory.t_s > t_s[0]) & (trajectory.t_s < t_s[-1])]
    edges = np.unique(np.concatenate([t_s, inner]))
    left, right = edges[:-1], edges[1:]
    width = right - left
    # Samples just inside a piece, so that both belong to the same cubic.
    nudge = 1e-9 * width
    times = np.concatenate([left + nudge, right - nudge, 0.5 * (left + right)])
    v0, v1, middle = np.split(trajectory.sample(times).velocity_rad_s, 3)
    control = 2.0 * middle - 0.5 * (v0 + v1)
    bound = np.maximum(np.maximum(np.abs(v0), np.abs(v1)), np.abs(control)) * (1 + 1e-6)
    piece = np.clip(np.searchsorted(t_s, 0.5 * (left + right)) - 1, 0, len(t_s) - 2)
    total = np.zeros((len(t_s) - 1, bound.shape[1]))
    np.add.at(total, piece, bound * width[:, None])
    return total


def _levers(
    robot: Robot,
    shapes: ArmShapes,
    rotation: np.ndarray,
    origin: np.ndarray,
    ends: np.ndarray,
    turn: np.ndarray,
) -> np.ndarray:
    """r (P, C, n): largest distance of a point of solid c from the axis of joint j in a piece."""
    model = robot.model
    lever = np.zeros((turn.shape[0], len(shapes.joint), model.nv))
    axes = np.zeros((len(rotation), model.njoints, 3))
    slides = np.zeros(model.njoints, dtype=np.bool_)
    column = np.zeros(model.njoints, dtype=np.int64)
    for j in range(1, model.njoints):
        revolute, axis = joint_axis(robot, j)
        slides[j], column[j] = not revolute, model.joints[j].idx_v
        axes[:, j] = rotation[:, j] @ axis
    _lever_kernel(
        np.ascontiguousarray(ends),
        shapes.radius_m,
        np.ascontiguousarray(origin),
        axes,
        _chain(robot, shapes),
        turn,
        slides,
        column,
        lever,
    )
    return lever


@njit
def _lever_kernel(ends, radius, origin, axes, reach, turn, slides, column, lever):
    """Fill lever (P, C, n); `reach` (C, J) is 0 where joint j does not carry solid c."""
    pieces, solids = lever.shape[0], lever.shape[1]
    joints = reach.shape[1]
    across = np.empty(pieces + 1)
    for c in range(solids):
        for j in range(1, joints):
            if reach[c, j] <= 0.0:
                continue
            if slides[j]:
                lever[:, c, column[j]] = 1.0
                continue
            for k in range(pieces + 1):
                largest = 0.0
                for e in range(2):
                    x = ends[k, c, e, 0] - origin[k, j, 0]
                    y = ends[k, c, e, 1] - origin[k, j, 1]
                    z = ends[k, c, e, 2] - origin[k, j, 2]
                    along = x * axes[k, j, 0] + y * axes[k, j, 1] + z * axes[k, j, 2]
                    largest = max(largest, x * x + y * y + z * z - along * along)
                across[k] = np.sqrt(largest) + 1e-9
            for p in range(pieces):
                behind = 0.0
                for k in range(j + 1, joints):
                    behind += reach[c, k] * turn[p, column[k]]
                far = max(across[p], across[p + 1]) + radius[c] + behind
                lever[p, c, column[j]] = min(far, reach[c, j])


def _chain(robot: Robot, shapes: ArmShapes) -> np.ndarray:
    """(C, J): length of the chain from joint j to the far side of solid c, 0 if not carried."""
    model = robot.model
    reach = np.zeros((len(shapes.joint), model.njoints))
    for c in range(len(shapes.joint)):
        length = float(np.linalg.norm(shapes.ends_m[c], axis=1).max() + shapes.radius_m[c])
        j = int(shapes.joint[c])
        while j > 0:
            reach[c, j] = length
            length += float(np.linalg.norm(model.jointPlacements[j].translation))
            j = int(model.parents[j])
    return reach


def reaches(robot: Robot, shapes: ArmShapes) -> np.ndarray:
    """(C, n): metres that a point of solid c moves at most per radian of joint j, at any q."""
    model = robot.model
    chain = _chain(robot, shapes)
    out = np.zeros((len(shapes.joint), model.nv))
    for j in range(1, model.njoints):
        slides = not joint_axis(robot, j)[0]
        out[:, model.joints[j].idx_v] = (chain[:, j] > 0.0) if slides else chain[:, j]
    return out
