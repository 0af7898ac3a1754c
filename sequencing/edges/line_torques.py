"""Torques along straight joint-space lines, for as many pairs as a station has.

The recursive Newton–Euler equations in body axes, once with gravity alone and once with the motion
as well: both share the turns of the joints. Sums are made in one order on every machine.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.jit import njit
from dmoc.physics.dynamics import arm_model


@njit(inner=True)
def _cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(inner=True)
def _into(turn, x, y, z):  # type: ignore[no-untyped-def]
    """turnᵀ (x, y, z): from the parent's axes into the body's."""
    return (
        turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z,
        turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z,
        turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z,
    )


@njit(inner=True)
def _times(turn, x, y, z):  # type: ignore[no-untyped-def]
    """turn (x, y, z): from the body's axes into the parent's, or a matrix times a vector."""
    return (
        turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
        turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
        turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
    )


@njit(inner=True)
def _turned(fixed, axis, angle, out):  # type: ignore[no-untyped-def]
    """fixed · rotation about `axis` by `angle`, by Rodrigues' formula, into out."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    for i in range(3):
        u, v, w = fixed[i, 0], fixed[i, 1], fixed[i, 2]
        out[i, 0] = u * (c + d * x * x) + v * (d * x * y + s * z) + w * (d * x * z - s * y)
        out[i, 1] = u * (d * x * y - s * z) + v * (c + d * y * y) + w * (d * y * z + s * x)
        out[i, 2] = u * (d * x * z + s * y) + v * (d * y * z - s * x) + w * (c + d * z * z)


@njit
def _torques(arm, q, v, a, turns, state, load, still, moved):  # type: ignore[no-untyped-def]
    """Torques into still (n,), of gravity alone, and moved (n,), of the motion too."""
    fixed, offset, axis, mass, moment, inertia, armature, gravity, track = arm
    n = len(q)
    for i in range(n):
        _turned(fixed[i], axis[i], 0.0 if track and i == 0 else q[i], turns[i])
        turn, p = turns[i], offset[i]
        if i == 0:  # the base stands, and gravity is an acceleration upwards
            gx, gy, gz = _into(turn, -gravity[0], -gravity[1], -gravity[2])
            lx, ly, lz = gx, gy, gz
            wx, wy, wz = 0.0, 0.0, 0.0
            bx, by, bz = 0.0, 0.0, 0.0
        else:
            b = state[i - 1]
            gx, gy, gz = _into(turn, b[9], b[10], b[11])
            cx, cy, cz = _cross(b[0], b[1], b[2], p[0], p[1], p[2])
            ex, ey, ez = _cross(b[0], b[1], b[2], cx, cy, cz)
            fx, fy, fz = _cross(b[3], b[4], b[5], p[0], p[1], p[2])
            lx, ly, lz = _into(turn, b[6] + ex + fx, b[7] + ey + fy, b[8] + ez + fz)
            wx, wy, wz = _into(turn, b[0], b[1], b[2])
            bx, by, bz = _into(turn, b[3], b[4], b[5])
        if track and i == 0:
            lx, ly, lz = lx + axis[0, 0] * a[0], ly + axis[0, 1] * a[0], lz + axis[0, 2] * a[0]
        else:
            ux, uy, uz = axis[i, 0] * v[i], axis[i, 1] * v[i], axis[i, 2] * v[i]
            cx, cy, cz = _cross(wx, wy, wz, ux, uy, uz)
            bx, by, bz = (
                bx + cx + axis[i, 0] * a[i],
                by + cy + axis[i, 1] * a[i],
                bz + cz + axis[i, 2] * a[i],
            )
            wx, wy, wz = wx + ux, wy + uy, wz + uz
        s, h, m = state[i], moment[i], mass[i]
        s[0], s[1], s[2], s[3], s[4], s[5] = wx, wy, wz, bx, by, bz
        s[6], s[7], s[8], s[9], s[10], s[11] = lx, ly, lz, gx, gy, gz
        cx, cy, cz = _cross(wx, wy, wz, h[0], h[1], h[2])
        ex, ey, ez = _cross(wx, wy, wz, cx, cy, cz)
        fx, fy, fz = _cross(bx, by, bz, h[0], h[1], h[2])
        f = load[i]
        f[0], f[1], f[2] = m * lx + ex + fx, m * ly + ey + fy, m * lz + ez + fz
        cx, cy, cz = _times(inertia[i], bx, by, bz)
        ex, ey, ez = _times(inertia[i], wx, wy, wz)
        ex, ey, ez = _cross(wx, wy, wz, ex, ey, ez)
        fx, fy, fz = _cross(h[0], h[1], h[2], lx, ly, lz)
        f[3], f[4], f[5] = cx + ex + fx, cy + ey + fy, cz + ez + fz
        f[6], f[7], f[8] = m * gx, m * gy, m * gz
        f[9], f[10], f[11] = _cross(h[0], h[1], h[2], gx, gy, gz)
    for i in range(n - 1, -1, -1):
        f = load[i]
        k = 0 if track and i == 0 else 3  # the force along a slide, else the moment
        moved[i] = axis[i, 0] * f[k] + axis[i, 1] * f[k + 1] + axis[i, 2] * f[k + 2]
        moved[i] += armature[i] * a[i]
        still[i] = axis[i, 0] * f[k + 6] + axis[i, 1] * f[k + 7] + axis[i, 2] * f[k + 8]
        if i > 0:
            turn, p, b = turns[i], offset[i], load[i - 1]
            for k in (0, 6):
                cx, cy, cz = _times(turn, f[k], f[k + 1], f[k + 2])
                ex, ey, ez = _cross(p[0], p[1], p[2], cx, cy, cz)
                fx, fy, fz = _times(turn, f[k + 3], f[k + 4], f[k + 5])
                b[k] += cx
                b[k + 1] += cy
                b[k + 2] += cz
                b[k + 3] += fx + ex
                b[k + 4] += fy + ey
                b[k + 5] += fz + ez


@njit
def _sums(arm, start, goal, rule, room, out):  # type: ignore[no-untyped-def]
    """∫|g|², 2∫g·u, ∫|u|² of every pair into rows of out, u being the torque without gravity."""
    q, v, a, still, moved, turns, state, load = room
    for k in range(start.shape[0]):
        out[k, 0] = out[k, 1] = out[k, 2] = 0.0
        for row in range(rule.shape[0]):
            for j in range(start.shape[1]):
                d = goal[k, j] - start[k, j]
                q[j] = start[k, j] + rule[row, 1] * d
                v[j], a[j] = rule[row, 2] * d, rule[row, 3] * d
            _torques(arm, q, v, a, turns, state, load, still, moved)
            for j in range(start.shape[1]):
                u = moved[j] - still[j]
                out[k, 0] += rule[row, 0] * still[j] * still[j]
                out[k, 1] += 2.0 * rule[row, 0] * still[j] * u
                out[k, 2] += rule[row, 0] * u * u


def line_sums(model: pin.Model, start: Array, goal: Array, rule: Array) -> Array:
    """(K, 3): ∫|g|², 2∫g·u and ∫|u|² over straight lines between rows of start and goal (K, n).

    `rule` (M, 4) are weights, s, s', s'' of a time law at the points of a quadrature; u is the
    torque of inertia that it needs in unit time. Joints turn; the first may slide.
    """
    joints = arm_model(model).joints
    n = len(joints)
    arm = (
        np.array([j.rotation for j in joints]).reshape(n, 3, 3),
        np.array([j.offset_m for j in joints]),
        np.array([j.axis for j in joints]),
        np.array([j.mass_kg for j in joints]),
        np.array([j.first_moment for j in joints]),
        np.array([j.inertia for j in joints]).reshape(n, 3, 3),
        np.array([j.armature for j in joints]),
        np.array(arm_model(model).gravity),
        not joints[0].revolute,
    )
    room = (
        *(np.zeros(n) for _ in range(5)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 12)),
        np.zeros((n, 12)),
    )
    out = np.empty((len(start), 3))
    _sums(arm, np.array(start, dtype=float), np.array(goal, dtype=float), rule, room, out)
    return out
