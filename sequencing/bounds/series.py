r"""Gravity and mass matrix of an arm as trigonometric polynomials of the joint angles.

With revolute joints, g(q) has degree 1 and M(q) degree 2 in every angle, so samples on 3 and 5
equally spaced angles a joint determine them exactly, for all angles. Two *bearing* joints, those
with the largest gravity torques, keep their angles x; the others are left open: a coefficient that
depends on them is bounded by its modulus.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from dmoc.arrays import Array
from dmoc.physics.state import mass_matrices
from dmoc.robot.robot import Robot


@dataclass(frozen=True)
class ArmSeries:
    """Fourier coefficients, split by bearing joints (harmonics k) and the others (harmonics r).

    `bearing` (2,) are joint indices. `gravity` (Kg, 2) are the coefficients of ĝ, the gravity
    torque of the bearing joints averaged over the other angles, at the harmonics `gravity_k`
    (Kg, 2); `spread` (2,) bounds |g − ĝ| and `slope` (2, n) its derivative by every angle.
    `mass` (R, Km, n, n) are those of M at `mass_k` (Km, 2); r = 0 is the mean over the others.
    """

    bearing: tuple[int, int]
    gravity: np.ndarray
    gravity_k: Array
    spread: Array
    slope: Array
    mass: np.ndarray
    mass_k: Array

    def mean_gravity(self, x: Array) -> Array:
        """ĝ (P, 2) [N·m] at bearing angles x (P, 2)."""
        return np.asarray((np.exp(1j * x @ self.gravity_k.T) @ self.gravity).real)

    def mean_gravity_slope(self, x: Array) -> Array:
        """∂ĝ_l/∂x_m (P, 2, 2), component l first."""
        wave = np.exp(1j * x @ self.gravity_k.T)
        parts = [(wave @ (1j * self.gravity_k[:, [m]] * self.gravity)).real for m in (0, 1)]
        return np.stack(parts, axis=-1)


def arm_series(robot: Robot) -> ArmSeries:
    """The series of a robot with at least two joints."""
    n = robot.num_joints
    gravity, frequency = _transform(robot.gravity_torque_nm(_grid((3,) * n)), (3,) * n)
    weight = np.abs(gravity).sum(axis=0)
    # Ties are broken towards the base, whatever the sorting does.
    order = sorted(range(n), key=lambda j: (-round(float(weight[j]), 6), j))
    first, second = sorted(order[:2])
    bearing, others = [first, second], [j for j in range(n) if j not in (first, second)]
    mine = gravity[:, bearing]
    fixed = ~np.any(frequency[:, others] != 0, axis=1)
    rest = np.abs(mine[~fixed])
    # Turning joint 1 turns the whole arm: M does not depend on it.
    counts = (1,) + (5,) * (n - 1)
    mass, waves = _transform(mass_matrices(robot, _grid(counts)), counts)
    labels = np.unique(waves[:, others], axis=0)
    # M is real: of two opposite harmonics one stands for both (factor 2 below).
    labels = labels[[tuple(row) >= tuple(-row) for row in labels]]
    labels = labels[np.argsort(np.abs(labels).sum(axis=1), kind="stable")]
    keys = np.unique(waves[:, bearing], axis=0)
    place = {tuple(row): i for i, row in enumerate(waves[:, bearing + others])}
    table = np.array([[mass[place[(*key, *label)]] for key in keys] for label in labels])
    table[1:] *= 2.0
    return ArmSeries(
        bearing=(first, second),
        gravity=mine[fixed],
        gravity_k=frequency[fixed][:, bearing],
        spread=rest.sum(axis=0),
        slope=rest.T @ np.abs(frequency[~fixed]),
        mass=table,
        mass_k=keys,
    )


def _grid(counts: tuple[int, ...]) -> Array:
    return np.array(list(product(*(2 * np.pi * np.arange(c) / c for c in counts))))


def _transform(values: Array, counts: tuple[int, ...]) -> tuple[np.ndarray, Array]:
    """Coefficients (K, ...) and their harmonics (K, n) of samples on a full grid."""
    axes = tuple(range(len(counts)))
    shaped = values.reshape(*counts, *values.shape[1:])
    coefficients = np.fft.fftn(shaped, axes=axes) / np.prod(counts)
    harmonics = np.array(list(product(*(np.fft.fftfreq(c, 1 / c) for c in counts))))
    return coefficients.reshape(values.shape), np.round(harmonics)
