r"""The Newton–Euler recursion in link frames and its reverse sweep, compiled.

With E = R(q)ᵀ Pᵀ from the parent's frame to the link's, s the axis, r the joint's offset, c the
centre of mass and p the parent, outwards

    w = E w_p + s v,   dw = E dw_p + s a + (E w_p) × s v,
    acc = E (acc_p + dw_p × r + w_p × (w_p × r)),
    F = m (acc + dw × c + w × (w × c)),   N = I dw + w × I w,

and inwards, with the child's quantities marked by +,

    f = F + E₊ᵀ f₊,   t = N + c × F + E₊ᵀ t₊ + r₊ × E₊ᵀ f₊,   τ = s·t + J_m a.

The reverse sweep runs the two loops backwards; d(E x)/dq = −s × E x and d(Eᵀ y)/dq = Eᵀ (s × y).
Source of the recursion: Luh, Walker and Paul (1980).
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit


@njit
def _turn(rotation, axis, angle, out):  # type: ignore[no-untyped-def]
    """out = R(angle, axis)ᵀ rotationᵀ, by Rodrigues' formula."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    t = np.empty((3, 3))
    t[0, 0], t[0, 1], t[0, 2] = c + x * x * k, x * y * k + z * s, x * z * k - y * s
    t[1, 0], t[1, 1], t[1, 2] = x * y * k - z * s, c + y * y * k, y * z * k + x * s
    t[2, 0], t[2, 1], t[2, 2] = x * z * k + y * s, y * z * k - x * s, c + z * z * k
    for i in range(3):
        for j in range(3):
            total = 0.0
            for m in range(3):
                total += t[i, m] * rotation[j, m]
            out[i, j] = total


@njit
def _apply(matrix, vector, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@njit
def _apply_transposed(matrix, vector, out):  # type: ignore[no-untyped-def]
    for i in range(3):
        out[i] = matrix[0, i] * vector[0] + matrix[1, i] * vector[1] + matrix[2, i] * vector[2]


@njit
def _vec_cross(a, b, out):  # type: ignore[no-untyped-def]
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit
def _add_cross(a, b, scale, out):  # type: ignore[no-untyped-def]
    """out += scale · a × b."""
    out[0] += scale * (a[1] * b[2] - a[2] * b[1])
    out[1] += scale * (a[2] * b[0] - a[0] * b[2])
    out[2] += scale * (a[0] * b[1] - a[1] * b[0])


@njit
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit
def _outwards(  # type: ignore[no-untyped-def]
    q,
    v,
    a,
    rotation,
    offset,
    axis,
    mass,
    com,
    inertia,
    gravity,
    turn,
    w,
    dw,
    acc,
    carried_w,
    force,
    moment,
):
    """First loop for one sample; row 0 of w, dw, acc is the base."""
    n = q.shape[0]
    x, y = np.empty(3), np.empty(3)
    w[0, :] = 0.0
    dw[0, :] = 0.0
    for k in range(3):
        acc[0, k] = -gravity[k]
    for i in range(n):
        _turn(rotation[i], axis[i], q[i], turn[i])
        s, r, c = axis[i], offset[i], com[i]
        _apply(turn[i], w[i], carried_w[i])
        _apply(turn[i], dw[i], dw[i + 1])
        for k in range(3):
            w[i + 1, k] = carried_w[i, k] + s[k] * v[i]
            dw[i + 1, k] += s[k] * a[i]
        _add_cross(carried_w[i], s, v[i], dw[i + 1])
        _vec_cross(w[i], r, x)
        for k in range(3):
            y[k] = acc[i, k]
        _add_cross(dw[i], r, 1.0, y)
        _add_cross(w[i], x, 1.0, y)
        _apply(turn[i], y, acc[i + 1])
        _vec_cross(w[i + 1], c, x)
        for k in range(3):
            y[k] = acc[i + 1, k]
        _add_cross(dw[i + 1], c, 1.0, y)
        _add_cross(w[i + 1], x, 1.0, y)
        for k in range(3):
            force[i, k] = mass[i] * y[k]
        _apply(inertia[i], w[i + 1], x)
        _apply(inertia[i], dw[i + 1], moment[i])
        _add_cross(w[i + 1], x, 1.0, moment[i])


@njit
def _inwards(offset, com, turn, force, moment, f, t):  # type: ignore[no-untyped-def]
    """Second loop: forces f and moments t (n, 3) that each joint passes on."""
    n = force.shape[0]
    x = np.empty(3)
    for i in range(n - 1, -1, -1):
        for k in range(3):
            f[i, k] = force[i, k]
            t[i, k] = moment[i, k]
        _add_cross(com[i], force[i], 1.0, t[i])
        if i + 1 < n:
            _apply_transposed(turn[i + 1], f[i + 1], x)
            for k in range(3):
                f[i, k] += x[k]
            _add_cross(offset[i + 1], x, 1.0, t[i])
            _apply_transposed(turn[i + 1], t[i + 1], x)
            for k in range(3):
                t[i, k] += x[k]


@njit
def torque_kernel(  # type: ignore[no-untyped-def]
    q, v, a, rotation, offset, axis, mass, com, inertia, armature, gravity
):
    """τ (S, n) for samples q, v, a (S, n)."""
    samples, n = q.shape
    tau = np.empty((samples, n))
    turn = np.empty((n, 3, 3))
    w, dw, acc = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    carried, force, moment = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    f, t = np.empty((n, 3)), np.empty((n, 3))
    for m in range(samples):
        _outwards(
            q[m],
            v[m],
            a[m],
            rotation,
            offset,
            axis,
            mass,
            com,
            inertia,
            gravity,
            turn,
            w,
            dw,
            acc,
            carried,
            force,
            moment,
        )
        _inwards(offset, com, turn, force, moment, f, t)
        for i in range(n):
            tau[m, i] = _dot(axis[i], t[i]) + armature[i] * a[m, i]
    return tau


@njit
def adjoint_kernel(  # type: ignore[no-untyped-def]
    q, v, a, weight, rotation, offset, axis, mass, com, inertia, armature, gravity
):
    """Gradients (S, n) of weight·τ with respect to q, v, a for samples (S, n)."""
    samples, n = q.shape
    gq, gv, ga = np.zeros((samples, n)), np.zeros((samples, n)), np.zeros((samples, n))
    turn = np.empty((n, 3, 3))
    w, dw, acc = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    carried, force, moment = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    f, t = np.empty((n, 3)), np.empty((n, 3))
    bar_f, bar_t = np.empty((n, 3)), np.empty((n, 3))
    bar_force, bar_moment = np.empty((n, 3)), np.empty((n, 3))
    bar_w, bar_dw, bar_acc = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3))
    x, y, z, g = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for m in range(samples):
        _outwards(
            q[m],
            v[m],
            a[m],
            rotation,
            offset,
            axis,
            mass,
            com,
            inertia,
            gravity,
            turn,
            w,
            dw,
            acc,
            carried,
            force,
            moment,
        )
        _inwards(offset, com, turn, force, moment, f, t)
        bar_f[:, :] = 0.0
        bar_t[:, :] = 0.0
        bar_w[:, :] = 0.0
        bar_dw[:, :] = 0.0
        bar_acc[:, :] = 0.0
        for i in range(n):  # reverse of the second loop
            s = axis[i]
            ga[m, i] += weight[m, i] * armature[i]
            for k in range(3):
                bar_t[i, k] += weight[m, i] * s[k]
                bar_moment[i, k] = bar_t[i, k]
                bar_force[i, k] = bar_f[i, k]
            _add_cross(bar_t[i], com[i], 1.0, bar_force[i])
            if i + 1 < n:
                s = axis[i + 1]
                _apply(turn[i + 1], bar_t[i], x)
                _vec_cross(s, t[i + 1], y)
                gq[m, i + 1] += _dot(x, y)
                for k in range(3):
                    bar_t[i + 1, k] += x[k]
                    g[k] = bar_f[i, k]
                _add_cross(bar_t[i], offset[i + 1], 1.0, g)
                _apply(turn[i + 1], g, x)
                _vec_cross(s, f[i + 1], y)
                gq[m, i + 1] += _dot(x, y)
                for k in range(3):
                    bar_f[i + 1, k] += x[k]
        for i in range(n - 1, -1, -1):  # reverse of the first loop
            s, r, c = axis[i], offset[i], com[i]
            # N = I dw + w × I w
            _apply(inertia[i], bar_moment[i], x)
            for k in range(3):
                bar_dw[i + 1, k] += x[k]
            _apply(inertia[i], w[i + 1], x)
            _add_cross(x, bar_moment[i], 1.0, bar_w[i + 1])
            _vec_cross(bar_moment[i], w[i + 1], x)
            _apply(inertia[i], x, y)
            for k in range(3):
                bar_w[i + 1, k] += y[k]
                # F = m (acc + dw × c + w × (w × c))
                x[k] = mass[i] * bar_force[i, k]
                bar_acc[i + 1, k] += x[k]
            _add_cross(c, x, 1.0, bar_dw[i + 1])
            _vec_cross(w[i + 1], c, y)
            _add_cross(y, x, 1.0, bar_w[i + 1])
            _vec_cross(x, w[i + 1], y)
            _add_cross(c, y, 1.0, bar_w[i + 1])
            # acc = E (acc_p + dw_p × r + w_p × (w_p × r))
            _vec_cross(s, acc[i + 1], x)
            gq[m, i] -= _dot(bar_acc[i + 1], x)
            _apply_transposed(turn[i], bar_acc[i + 1], x)
            for k in range(3):
                bar_acc[i, k] += x[k]
            _add_cross(r, x, 1.0, bar_dw[i])
            _vec_cross(w[i], r, y)
            _add_cross(y, x, 1.0, bar_w[i])
            _vec_cross(x, w[i], y)
            _add_cross(r, y, 1.0, bar_w[i])
            # dw = E dw_p + s a + (E w_p) × s v
            ga[m, i] += _dot(bar_dw[i + 1], s)
            _vec_cross(carried[i], s, x)
            gv[m, i] += _dot(bar_dw[i + 1], x)
            for k in range(3):
                z[k] = bar_w[i + 1, k]
            _add_cross(s, bar_dw[i + 1], v[m, i], z)
            _apply(turn[i], dw[i], x)
            _vec_cross(s, x, y)
            gq[m, i] -= _dot(bar_dw[i + 1], y)
            _apply_transposed(turn[i], bar_dw[i + 1], x)
            for k in range(3):
                bar_dw[i, k] += x[k]
            # w = E w_p + s v
            gv[m, i] += _dot(bar_w[i + 1], s)
            _vec_cross(s, carried[i], y)
            gq[m, i] -= _dot(z, y)
            _apply_transposed(turn[i], z, x)
            for k in range(3):
                bar_w[i, k] += x[k]
    return gq, gv, ga
