"""Per-joint electrical power along a path, in numba; `dmoc.drive` is its oracle."""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np

from dmoc.drive import REST_RAD_S
from dmoc.jit import njit


@njit(fastmath=True)
def exact_kernel(static, speed, velocity, acceleration, drive, override, out):
    """Fill out (P,) [W]: tau = static + override^2 speed, qd = override velocity, (P, n) each.

    `drive` (9, n): f_c, f_v, f_s, J_x, (R + r_0)/(n k_t)^2, k_e n^2, k_h n, v_0/(n k_t), P_0.
    """
    samples, joints = static.shape
    square = override * override
    root = np.sqrt(override)
    for p in range(samples):
        total = 0.0
        for j in range(joints):
            v = override * velocity[p, j]
            sign = 1.0 if v >= REST_RAD_S else (-1.0 if v <= -REST_RAD_S else 0.0)
            friction = drive[0, j] * sign + drive[1, j] * v
            if drive[2, j] > 0.0:
                friction += drive[2, j] * sign * root * np.sqrt(abs(velocity[p, j]))
            torque = static[p, j] + square * speed[p, j] + friction
            torque += drive[3, j] * square * acceleration[p, j]
            total += torque * v + drive[4, j] * torque * torque + drive[5, j] * v * v
            total += drive[6, j] * v * sign + drive[7, j] * abs(torque) + drive[8, j]
        out[p] = total
