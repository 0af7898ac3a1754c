"""Where joints and pieces are, and how far a piece can move with each joint."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.jit import njit


@njit(plain=True)
def joint_poses(info: Any, frame: Any, q: Any, out: Any) -> None:
    """T_world_joint as rows (R row-major, t) in `out` (J, 12) and world axes in `out[:, 12:15]`.

    Revolute: R = R_parent R_placement exp(q [a]×); prismatic: t += q R a.
    """
    for j in range(15):
        out[0, j] = 0.0
    out[0, 0] = out[0, 4] = out[0, 8] = 1.0
    for j in range(1, info.shape[0]):
        p = info[j, 0]
        angle = q[j - 1]
        # Rotation of the joint in its own frame (Rodrigues), identity for a prismatic one.
        ax, ay, az = frame[j, 12], frame[j, 13], frame[j, 14]
        c, s = 1.0, 0.0
        if info[j, 1] == 0:
            c, s = np.cos(angle), np.sin(angle)
        k = 1.0 - c
        m00, m01, m02 = c + ax * ax * k, ax * ay * k - az * s, ax * az * k + ay * s
        m10, m11, m12 = ay * ax * k + az * s, c + ay * ay * k, ay * az * k - ax * s
        m20, m21, m22 = az * ax * k - ay * s, az * ay * k + ax * s, c + az * az * k
        for r in range(3):
            a, b, d = out[p, 3 * r], out[p, 3 * r + 1], out[p, 3 * r + 2]
            # Row r of R_parent R_placement.
            e0 = a * frame[j, 0] + b * frame[j, 3] + d * frame[j, 6]
            e1 = a * frame[j, 1] + b * frame[j, 4] + d * frame[j, 7]
            e2 = a * frame[j, 2] + b * frame[j, 5] + d * frame[j, 8]
            out[j, 3 * r] = e0 * m00 + e1 * m10 + e2 * m20
            out[j, 3 * r + 1] = e0 * m01 + e1 * m11 + e2 * m21
            out[j, 3 * r + 2] = e0 * m02 + e1 * m12 + e2 * m22
            axis = e0 * ax + e1 * ay + e2 * az
            out[j, 12 + r] = axis
            t = out[p, 9 + r] + a * frame[j, 9] + b * frame[j, 10] + d * frame[j, 11]
            if info[j, 1] == 1:
                t += angle * axis
            out[j, 9 + r] = t


@njit(plain=True, inner=True)
def place_piece(joints: Any, solids: Any, p: int, pose: Any) -> None:
    """T_world_piece = T_world_joint T_joint_piece into `pose[p]`; 12:15 get the ball's centre."""
    j, frame, size = solids.info[p, 0], solids.frame, solids.size
    for r in range(3):
        a, b, c = joints[j, 3 * r], joints[j, 3 * r + 1], joints[j, 3 * r + 2]
        for k in range(3):
            pose[p, 3 * r + k] = a * frame[p, k] + b * frame[p, 3 + k] + c * frame[p, 6 + k]
        pose[p, 9 + r] = joints[j, 9 + r] + (a * frame[p, 9] + b * frame[p, 10] + c * frame[p, 11])
        pose[p, 12 + r] = pose[p, 9 + r] + (
            pose[p, 3 * r] * size[p, 6]
            + pose[p, 3 * r + 1] * size[p, 7]
            + pose[p, 3 * r + 2] * size[p, 8]
        )


@njit(plain=True, inner=True)
def place_pieces(joints: Any, solids: Any, moving: int, pose: Any) -> None:
    """Poses of pieces 0 … moving−1 in `pose` (P, 15)."""
    for p in range(moving):
        place_piece(joints, solids, p, pose)


@njit(plain=True)
def point_gradient(
    joints: Any, chain: Any, joint: int, point: Any, normal: Any, sign: float, out: Any
) -> None:
    """out_j += sign · n·∂p/∂q_j for a point p of the body on `joint`; out is (n,)."""
    info, above = chain.info, chain.above
    x, y, z, nx, ny, nz = point[0], point[1], point[2], normal[0], normal[1], normal[2]
    for j in range(1, info.shape[0]):
        if not above[joint, j]:
            continue
        ax, ay, az = joints[j, 12], joints[j, 13], joints[j, 14]
        if info[j, 1] == 0:
            rx, ry, rz = x - joints[j, 9], y - joints[j, 10], z - joints[j, 11]
            dx, dy, dz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        else:
            dx, dy, dz = ax, ay, az
        out[j - 1] += sign * (nx * dx + ny * dy + nz * dz)


@njit(plain=True, inner=True)
def _corner(pose: Any, size: Any, p: int, k: int) -> tuple[float, float, float]:
    """Corner k (0–7) of the box around piece p, in the world."""
    u = size[p, 6] + (size[p, 9] if k & 1 else -size[p, 9])
    v = size[p, 7] + (size[p, 10] if k & 2 else -size[p, 10])
    w = size[p, 8] + (size[p, 11] if k & 4 else -size[p, 11])
    return (
        pose[p, 9] + pose[p, 0] * u + pose[p, 1] * v + pose[p, 2] * w,
        pose[p, 10] + pose[p, 3] * u + pose[p, 4] * v + pose[p, 5] * w,
        pose[p, 11] + pose[p, 6] * u + pose[p, 7] * v + pose[p, 8] * w,
    )


@njit(plain=True, inner=True)
def reach_of_piece(joints: Any, chain: Any, solids: Any, pose: Any, p: int, out: Any) -> None:
    """R_j of piece p: the largest ‖∂x/∂q_j‖ over its points x, into `out` (n,).

    The distance to an axis is convex, so the corners of a box around the piece bound it.
    """
    info, above, joint, size = chain.info, chain.above, solids.info[p, 0], solids.size
    for j in range(1, info.shape[0]):
        out[j - 1] = 0.0
        if above[joint, j] and info[j, 1] == 1:
            out[j - 1] = 1.0
    for k in range(8):
        x, y, z = _corner(pose, size, p, k)
        for j in range(1, info.shape[0]):
            if not above[joint, j] or info[j, 1] == 1:
                continue
            ax, ay, az = joints[j, 12], joints[j, 13], joints[j, 14]
            rx, ry, rz = x - joints[j, 9], y - joints[j, 10], z - joints[j, 11]
            dx, dy, dz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
            squared = dx * dx + dy * dy + dz * dz
            if squared > out[j - 1]:
                out[j - 1] = squared
    for j in range(1, info.shape[0]):
        if info[j, 1] == 0:
            out[j - 1] = np.sqrt(out[j - 1])


@njit(plain=True, inner=True)
def ball_reach(joints: Any, chain: Any, solids: Any, pose: Any, p: int, out: Any) -> None:
    """R_j of piece p from the ball around it: cheaper than its corners, and larger."""
    info, above, joint, radius = chain.info, chain.above, solids.info[p, 0], solids.size[p, 12]
    for j in range(1, info.shape[0]):
        if not above[joint, j]:
            out[j - 1] = 0.0
            continue
        if info[j, 1] == 1:
            out[j - 1] = 1.0
            continue
        ax, ay, az = joints[j, 12], joints[j, 13], joints[j, 14]
        rx = pose[p, 12] - joints[j, 9]
        ry = pose[p, 13] - joints[j, 10]
        rz = pose[p, 14] - joints[j, 11]
        dx, dy, dz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        out[j - 1] = np.sqrt(dx * dx + dy * dy + dz * dz) + radius


@njit(plain=True)
def relative_motion(above: Any, ja: int, jb: int, ra: Any, rb: Any, delta: Any) -> float:
    """Σ_j R_j δ_j over the joints that move one of two pieces and not both [m].

    Seen from piece a, no point of piece b moves farther while |Δq_j| ≤ δ_j.
    """
    total = 0.0
    for j in range(delta.shape[0]):
        moves_a, moves_b = above[ja, j + 1], above[jb, j + 1]
        if moves_b and not moves_a:
            total += rb[j] * delta[j]
        elif moves_a and not moves_b:
            total += ra[j] * delta[j]
    return total


@njit(plain=True, inner=True)
def weight_of_piece(joints: Any, chain: Any, solids: Any, pose: Any, p: int, out: Any) -> None:
    """out_j = max(out_j, max_x ‖∂x/∂q_j‖₁) over the corners of the box around piece p."""
    info, above, joint, size = chain.info, chain.above, solids.info[p, 0], solids.size
    for k in range(8):
        x, y, z = _corner(pose, size, p, k)
        for j in range(1, info.shape[0]):
            if not above[joint, j]:
                continue
            ax, ay, az = joints[j, 12], joints[j, 13], joints[j, 14]
            if info[j, 1] == 0:
                rx, ry, rz = x - joints[j, 9], y - joints[j, 10], z - joints[j, 11]
                total = abs(ay * rz - az * ry) + abs(az * rx - ax * rz) + abs(ax * ry - ay * rx)
            else:
                total = abs(ax) + abs(ay) + abs(az)
            if total > out[j - 1]:
                out[j - 1] = total
