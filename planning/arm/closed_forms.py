"""Closed-form inverse kinematics of six-axis arms, all branches at once, batched.

Two families, recognised from the screw axes (no parameter table): *spherical wrist* (axes 4, 5, 6
meet in a point, 2 ∥ 3: Pieper's case, nearly every industrial arm) and *three parallel* (2 ∥ 3 ∥
4, axes 5 and 6 meet: Universal Robots and relatives). Sources: Pieper (1968); Paden's geometric
subproblems; Elias and Wen, "IK-Geo" (2022) for the parallel case.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from planning.arm.screws import ScrewAxes, rotation_about

#: How far (relative) a cosine may exceed one and still count as the double solution.
SLACK = 1e-9


def rotate_onto(axis: Array, start: Array, goal: Array) -> Array:
    """Angles θ (K,) with R(axis, θ)·start nearest to goal; both (K, 3), axis (3,) unit.

    Zero where start or goal lie on the axis.
    """
    start = start - (start @ axis)[..., None] * axis
    goal = goal - (goal @ axis)[..., None] * axis
    sine = np.cross(start, goal) @ axis
    cosine = np.einsum("...i,...i->...", start, goal)
    size = np.linalg.norm(start, axis=-1) * np.linalg.norm(goal, axis=-1)
    return np.where(size > 1e-14, np.arctan2(sine, cosine), 0.0)


def rotate_to_height(
    axis: Array, start: Array, direction: Array, height: Array
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Both θ (K, 2) with direction · R(axis, θ) · start = height, and whether they exist (K,).

    `start` and `direction` are (K, 3) or (3,), `height` (K,). With s∥, s⊥ the parts of `start`
    along and across the axis: a cos θ + b sin θ = c, a = d·s⊥, b = d·(axis × s⊥), c = h − d·s∥.
    Where both a and b vanish every θ serves (or none does): 0 is returned twice.
    """
    along = (start @ axis)[..., None] * axis
    across = start - along
    a = np.sum(direction * across, axis=-1)
    b = np.sum(direction * np.cross(axis, across), axis=-1)
    c = height - np.sum(direction * along, axis=-1)
    a, b, c = np.broadcast_arrays(a, b, c)
    size = np.hypot(a, b)
    free = size < 1e-12
    ratio = c / np.where(free, 1.0, size)
    exists = np.where(free, np.abs(c) < 1e-9, np.abs(ratio) <= 1.0 + SLACK)
    centre = np.arctan2(b, a)
    half = np.arccos(np.clip(ratio, -1.0, 1.0))
    half, centre = np.where(free, 0.0, half), np.where(free, 0.0, centre)
    return np.stack([centre + half, centre - half], axis=-1), exists


Branches = tuple[Array, npt.NDArray[np.bool_]]
_NEAR = 1e-9


def closed_form(chain: ScrewAxes) -> Callable[[Array], Branches] | None:
    """The solver of this arm's family, or None.

    It maps end poses (K, 4, 4) to angles (K, 8, 6), not wrapped to limits, and whether each
    branch exists (K, 8).
    """
    if chain.num_joints != 6 or not _parallel(chain, 1, 2):
        return None
    if abs(abs(chain.axis[0] @ chain.axis[1]) - 1.0) < _NEAR:
        return None
    wrist = _meeting_point(chain, (3, 4, 5))
    if wrist is not None and not _parallel(chain, 3, 4) and not _parallel(chain, 4, 5):
        return lambda poses: _spherical_wrist(chain, wrist, poses)
    if _parallel(chain, 2, 3) and not _parallel(chain, 3, 4) and not _parallel(chain, 4, 5):
        corner = _meeting_point(chain, (4, 5))
        if corner is not None:
            return lambda poses: _three_parallel(chain, corner, poses)
    return None


def _parallel(chain: ScrewAxes, i: int, j: int) -> bool:
    return bool(np.linalg.norm(np.cross(chain.axis[i], chain.axis[j])) < _NEAR)


def _meeting_point(chain: ScrewAxes, joints: tuple[int, ...]) -> Array | None:
    """The point common to the axes, by least squares over the lines, if there is one."""
    normal = np.zeros((3, 3))
    right = np.zeros(3)
    for i in joints:
        across = np.eye(3) - np.outer(chain.axis[i], chain.axis[i])
        normal += across
        right += across @ chain.point[i]
    if np.linalg.eigvalsh(normal)[0] < 1e-9:
        return None
    point = np.linalg.solve(normal, right)
    for i in joints:
        if np.linalg.norm(np.cross(chain.axis[i], point - chain.point[i])) > _NEAR:
            return None
    return np.asarray(point, dtype=np.float64)


def _turned(axis: Array, angle: Array, vector: Array) -> Array:
    """R(axis, angle (K,)) · vector ((K, 3) or (3,))."""
    return np.einsum(
        "kij,kj->ki", rotation_about(axis, angle), np.broadcast_to(vector, (len(angle), 3))
    )


def _elbow(
    chain: ScrewAxes, point: Array, target: Array
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """q2, q3 (K, 2) that bring `point` (3,) to `target` (K, 3), and existence (K,).

    Axes 2 and 3 are parallel; heights along them must agree already. The distance of the moved
    point to axis 2, squared, is linear in cos q3, sin q3.
    """
    axis, o2, o3 = chain.axis[1], chain.point[1], chain.point[2]
    sign = np.sign(chain.axis[2] @ axis)
    flat = np.eye(3) - np.outer(axis, axis)
    arm, reach = flat @ (o3 - o2), flat @ (point - o3)
    goal = (target - o2) @ flat
    height = 0.5 * (np.sum(goal * goal, axis=1) - arm @ arm - reach @ reach)
    turn, exists = rotate_to_height(axis, reach, arm, height)
    q2 = np.stack(
        [rotate_onto(axis, arm + _turned(axis, turn[:, j], reach), goal) for j in (0, 1)], axis=1
    )
    return q2, np.asarray(sign * turn), exists


def _spherical_wrist(chain: ScrewAxes, wrist: Array, poses: Array) -> Branches:
    axis, count = chain.axis, len(poses)
    motion = poses @ np.linalg.inv(chain.home)
    target = motion[:, :3, :3] @ wrist + motion[:, :3, 3]
    q = np.full((count, 8, 6), np.nan)
    found = np.zeros((count, 8), dtype=bool)
    # Axis 2 sees the wrist at a fixed height: h2 · R1ᵀ (target − o1) = h2 · (wrist − o1).
    first, exists_1 = rotate_to_height(
        -axis[0],
        target - chain.point[0],
        axis[1],
        np.full(count, axis[1] @ (wrist - chain.point[0])),
    )
    for i in (0, 1):
        q1 = first[:, i]
        local = chain.point[0] + _turned(axis[0], -q1, target - chain.point[0])
        q2, q3, exists_2 = _elbow(chain, wrist, local)
        for j in (0, 1):
            arm = (
                rotation_about(axis[0], q1)
                @ rotation_about(axis[1], q2[:, j])
                @ rotation_about(axis[2], q3[:, j])
            )
            turn = np.swapaxes(arm, 1, 2) @ motion[:, :3, :3]
            wrists, exists_3 = _wrist(chain, turn)
            for k in (0, 1):
                branch = 4 * i + 2 * j + k
                q[:, branch] = np.column_stack([q1, q2[:, j], q3[:, j], *wrists[k].T])
                found[:, branch] = exists_1 & exists_2 & exists_3
    return q, found


def _wrist(chain: ScrewAxes, turn: Array) -> tuple[list[Array], npt.NDArray[np.bool_]]:
    """Both (q4, q5, q6) (K, 3) with R4 R5 R6 = turn (K, 3, 3). q4 = 0 where 4 and 6 align."""
    h4, h5, h6 = chain.axis[3:]
    pointing = turn @ h6
    fifth, exists = rotate_to_height(h5, h6, h4, pointing @ h4)
    results = []
    for k in (0, 1):
        q5 = fifth[:, k]
        middle = _turned(h5, q5, h6)
        aligned = np.linalg.norm(np.cross(middle, h4), axis=1) < 1e-7
        q4 = np.where(aligned, 0.0, rotate_onto(h4, middle, pointing))
        rest = np.swapaxes(rotation_about(h4, q4) @ rotation_about(h5, q5), 1, 2) @ turn
        # Any vector across axis 6 shows q6.
        across = np.cross(h6, h5)
        q6 = rotate_onto(h6, np.broadcast_to(across, pointing.shape), rest @ across)
        results.append(np.column_stack([q4, q5, q6]))
    return results, exists


def _three_parallel(chain: ScrewAxes, corner: Array, poses: Array) -> Branches:
    axis, point, count = chain.axis, chain.point, len(poses)
    h2, h6 = axis[1], axis[5]
    motion = poses @ np.linalg.inv(chain.home)
    target = motion[:, :3, :3] @ corner + motion[:, :3, 3]
    q = np.full((count, 8, 6), np.nan)
    found = np.zeros((count, 8), dtype=bool)
    first, exists_1 = rotate_to_height(
        -axis[0], target - point[0], h2, np.full(count, h2 @ (corner - point[0]))
    )
    for i in (0, 1):
        q1 = first[:, i]
        back = np.swapaxes(rotation_about(axis[0], q1), 1, 2)
        turn = back @ motion[:, :3, :3]
        fifth, exists_2 = rotate_to_height(axis[4], h6, h2, (turn @ h6) @ h2)
        for k in (0, 1):
            q5 = fifth[:, k]
            fixed = _turned(axis[4], -q5, h2)
            q6 = rotate_onto(h6, np.swapaxes(turn, 1, 2) @ h2, fixed)
            last = rotation_about(axis[4], q5) @ rotation_about(h6, q6)
            arm = turn @ np.swapaxes(last, 1, 2)  # rotation about h2 by the sum of 2, 3, 4
            across = np.cross(h2, _any_other(h2))
            total = rotate_onto(h2, np.broadcast_to(across, (count, 3)), arm @ across)
            # Where the shoulder chain must bring the axis-4 point: undo 6, 5, then carry it.
            local = point[0] + np.einsum("kij,kj->ki", back, target - point[0])
            goal = local + np.einsum("kij,j->ki", arm, point[3] - corner)
            q2, q3, exists_3 = _elbow(chain, point[3], goal)
            signs = np.sign(axis[2:4] @ h2)
            for j in (0, 1):
                q4 = signs[1] * (total - q2[:, j] - signs[0] * q3[:, j])
                branch = 4 * i + 2 * k + j
                q[:, branch] = np.column_stack([q1, q2[:, j], q3[:, j], q4, q5, q6])
                found[:, branch] = exists_1 & exists_2 & exists_3
    return q, found


def _any_other(vector: Array) -> Array:
    return np.eye(3)[int(np.argmin(np.abs(vector)))]
