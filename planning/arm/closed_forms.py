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
    return np.where(size > 1e-24, np.arctan2(sine, cosine), 0.0)


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


def rotate_to_angle(
    axis: Array, start: Array, direction: Array, goal: Array
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Both θ (K, 2) that turn `start` as far from `direction` as `goal` (K, 3) is; all unit.

    As `rotate_to_height`, but sharp where goal ≈ ±direction: there a cosine keeps half its digits,
    and the missing factor of size² − c² = (size − c)(size + c) comes from the cross product.
    Also the aligned angle (K,), at which `start` comes nearest to ±direction, and existence.
    """
    level = (start @ axis) * (direction @ axis)
    a = direction @ start - level
    b = direction @ np.cross(axis, start)
    size, height = float(np.hypot(a, b)), goal @ direction
    if size < 1e-12:
        angles, exists = rotate_to_height(axis, start, direction, height)
        return angles, angles[:, 0], exists
    cross = np.sum(np.cross(goal, direction) ** 2, axis=-1)
    above, below = level + size - height, height - (level - size)
    exists = np.minimum(above, below) >= -SLACK * size
    if abs(level + size - 1.0) < 1e-12:
        above = np.where(height > 0, cross / (1.0 + np.abs(height)), above)
    if abs(level - size + 1.0) < 1e-12:
        below = np.where(height < 0, cross / (1.0 + np.abs(height)), below)
    half = np.arctan2(np.sqrt(np.maximum(above * below, 0.0)), height - level)
    centre = float(np.arctan2(b, a))
    aligned = np.where(height > 0, centre, centre + np.pi)
    return np.stack([centre + half, centre - half], axis=-1), aligned, exists


Branches = tuple[Array, npt.NDArray[np.bool_]]
_NEAR = 1e-9

#: A wrist within this of straight (the sine between its axes) has a free joint for all practice.
STRAIGHT = 1e-6
_EXACTLY_STRAIGHT = 1e-10
#: Values of the free joint of a straight wrist that are tried, all around.
SAMPLES = 16
#: Branches of a wrist that is not straight; those after them are samples.
NUM_BRANCHES = 8


def closed_form(chain: ScrewAxes) -> Callable[[Array], Branches] | None:
    """The solver of this arm's family, or None.

    It maps end poses (K, 4, 4) to angles (K, B, 6), not wrapped to limits, and whether each
    branch exists (K, B). After the first `NUM_BRANCHES` come samples of the free joint of straight
    wrists (sine below `STRAIGHT`), which leave that sine as their error; at a sine below 1e-10 they
    take the place of the branches.
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
    q = np.full((count, NUM_BRANCHES + 4 * SAMPLES, 6), np.nan)
    found = np.zeros(q.shape[:2], dtype=bool)
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
            shoulder = np.column_stack([q1, q2[:, j], q3[:, j]])
            sampled = NUM_BRANCHES + SAMPLES * (2 * i + j) + np.arange(SAMPLES)
            columns = np.concatenate([4 * i + 2 * j + np.arange(2), sampled])
            q[:, columns, :3] = shoulder[:, None]
            q[:, columns, 3:], exists_3 = _wrist(chain, turn)
            found[:, columns] = (exists_1 & exists_2)[:, None] & exists_3
    return _without_unused(q, found)


def _without_unused(q: Array, found: npt.NDArray[np.bool_]) -> Branches:
    """The branches alone where no pose has a straight wrist."""
    if found[:, NUM_BRANCHES:].any():
        return q, found
    return q[:, :NUM_BRANCHES], found[:, :NUM_BRANCHES]


def _wrist(chain: ScrewAxes, turn: Array) -> Branches:
    """(q4, q5, q6) (K, 2 + SAMPLES, 3) with R4 R5 R6 = turn (K, 3, 3): two, and samples of q4."""
    h4, h5, h6 = chain.axis[3:]
    pointing = turn @ h6
    sine = np.linalg.norm(np.cross(pointing, h4), axis=1)
    fifth, aligned, reached = rotate_to_angle(h5, h6, h4, pointing)
    count = len(turn)
    q = np.empty((count, 2 + SAMPLES, 3))
    exists = np.repeat(reached[:, None], 2 + SAMPLES, axis=1)
    exists[:, :2] &= (sine >= _EXACTLY_STRAIGHT)[:, None]
    exists[:, 2:] &= (sine < STRAIGHT)[:, None]
    for k in range(2 + SAMPLES):
        if not exists[:, k].any():
            q[:, k] = np.nan
            continue
        q5 = fifth[:, k] if k < 2 else aligned
        free = np.full(count, 2.0 * np.pi * (k - 2) / SAMPLES)
        q4 = rotate_onto(h4, _turned(h5, q5, h6), pointing) if k < 2 else free
        rest = np.swapaxes(rotation_about(h4, q4) @ rotation_about(h5, q5), 1, 2) @ turn
        # Any vector across axis 6 shows q6.
        across = np.cross(h6, h5)
        q6 = rotate_onto(h6, np.broadcast_to(across, pointing.shape), rest @ across)
        q[:, k] = np.column_stack([q4, q5, q6])
    return q, exists


def _three_parallel(chain: ScrewAxes, corner: Array, poses: Array) -> Branches:
    axis, point, count = chain.axis, chain.point, len(poses)
    h2, h6 = axis[1], axis[5]
    motion = poses @ np.linalg.inv(chain.home)
    target = motion[:, :3, :3] @ corner + motion[:, :3, 3]
    q = np.full((count, NUM_BRANCHES + 4 * SAMPLES, 6), np.nan)
    found = np.zeros(q.shape[:2], dtype=bool)
    first, exists_1 = rotate_to_height(
        -axis[0], target - point[0], h2, np.full(count, h2 @ (corner - point[0]))
    )
    for i in (0, 1):
        q1 = first[:, i]
        back = np.swapaxes(rotation_about(axis[0], q1), 1, 2)
        turn = back @ motion[:, :3, :3]
        pointing = turn @ h6
        sine = np.linalg.norm(np.cross(pointing, h2), axis=1)
        straight = exists_1 & (sine < STRAIGHT)
        fifth, aligned, exists_2 = rotate_to_angle(axis[4], h6, h2, pointing)
        # Where the shoulder chain must bring the axis-4 point: undo 6, 5, then carry it.
        local = point[0] + np.einsum("kij,kj->ki", back, target - point[0])
        choices = [(4 * i + 2 * k, 1, fifth[:, k], sine >= _EXACTLY_STRAIGHT) for k in (0, 1)]
        if straight.any():
            totals, reachable = _free_totals(chain, point[3] - corner, local)
            start = NUM_BRANCHES + 2 * SAMPLES * i
            choices += [(start + s, SAMPLES, aligned, straight & reachable) for s in range(SAMPLES)]
        for number, (column, stride, q5, taken) in enumerate(choices):
            if number < 2:
                fixed = _turned(axis[4], -q5, h2)
                q6 = rotate_onto(h6, np.swapaxes(turn, 1, 2) @ h2, fixed)
                last = rotation_about(axis[4], q5) @ rotation_about(h6, q6)
                arm = turn @ np.swapaxes(last, 1, 2)  # rotation about h2 by the sum of 2, 3, 4
                across = np.cross(h2, _any_other(h2))
                total = rotate_onto(h2, np.broadcast_to(across, (count, 3)), arm @ across)
            else:
                total = totals[:, number - 2]
                arm = rotation_about(h2, total)
                across = np.cross(h6, _any_other(h6))
                rest = np.swapaxes(arm @ rotation_about(axis[4], q5), 1, 2) @ turn
                q6 = rotate_onto(h6, np.broadcast_to(across, (count, 3)), rest @ across)
            goal = local + np.einsum("kij,j->ki", arm, point[3] - corner)
            q2, q3, exists_3 = _elbow(chain, point[3], goal)
            signs = np.sign(axis[2:4] @ h2)
            for j in (0, 1):
                q4 = signs[1] * (total - q2[:, j] - signs[0] * q3[:, j])
                branch = column + stride * j
                q[:, branch] = np.column_stack([q1, q2[:, j], q3[:, j], q4, q5, q6])
                found[:, branch] = exists_1 & exists_2 & exists_3 & taken
    return _without_unused(q, found)


def _free_totals(
    chain: ScrewAxes, lever: Array, local: Array
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Sums of joints 2, 3, 4 (K, SAMPLES) at which the elbow reaches a straight wrist (K, 3).

    The axis-4 point lies on a circle around the wrist: at an angle ψ from the line that leads away
    from axis 2 its distance d has d² = c² + r² + 2 c r cos ψ, and the elbow spans a ring. The
    samples divide the ψ of the ring evenly, on both sides. And whether there are any (K,).
    """
    axis, o2, o3 = chain.axis[1], chain.point[1], chain.point[2]
    flat = np.eye(3) - np.outer(axis, axis)
    centre, spoke = (local - o2) @ flat, flat @ lever
    far, radius = np.linalg.norm(centre, axis=1), float(np.linalg.norm(spoke))
    upper = float(np.linalg.norm(flat @ (o3 - o2)))
    fore = float(np.linalg.norm(flat @ (chain.point[3] - o3)))
    product = np.maximum(2.0 * far * radius, 1e-12)
    cosine = [(d**2 - far**2 - radius**2) / product for d in (upper + fore, abs(upper - fore))]
    reachable = (cosine[0] >= -1.0 - SLACK) & (cosine[1] <= 1.0 + SLACK)
    nearest, furthest = (np.arccos(np.clip(c, -1.0, 1.0)) for c in cosine)
    share = (np.arange(SAMPLES // 2) + 0.5) / (SAMPLES // 2)
    angle = nearest[:, None] + share * (furthest - nearest)[:, None]
    outward = rotate_onto(axis, np.broadcast_to(spoke, centre.shape), centre)
    return outward[:, None] + np.concatenate([angle, -angle], axis=1), reachable


def _any_other(vector: Array) -> Array:
    return np.eye(3)[int(np.argmin(np.abs(vector)))]
