"""The two geometric equations from which closed-form inverse kinematics is made (batched)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array

__all__ = ["rotate_onto", "rotate_to_height"]

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
