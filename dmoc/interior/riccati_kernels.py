r"""Kernels of the Newton system: a Riccati recursion backwards over the stages, border h.

Stage k = 0..N−1 has the frame (a, b, e, h | c | u) = (q_{k−1}, q_k, û_{k−1}, h | q_{k+1} | û_k),
sizes (n, n, n, 1 | n | n): S = 3n + 1 is the state, X = 4n + 1, F = 5n + 1. With stage Hessians
H_k, momentum rows E_k y + c_k = 0 whose block on û_k is diagonal (D), gradients g, the system is

.. math:: \min \sum_k \tfrac12 y_k^T H_k y_k + g^T x \quad \text{s.t.}\quad E_k y_k + c_k = 0 .

Backwards, with V_{k+1} the cost to go as a function of the state of stage k + 1:
û_k = U (a, b, e, h, c) + u_0 from the momentum row, then the minimum over c = q_{k+1} by the
Cholesky factor of its (n, n) block, which exists for all k exactly if the reduced Hessian is
positive definite. The last stages have as many rows as unknowns y = (q_K, û_{K−1}, …, û_{N−1}), K
the last free knot: y = Y s + y_0 by one dense LU. h is in every state and minimised last.
Multipliers come from the stationarity of the û_k and, at the end, of y (`end_kernels`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dmoc.arrays import Array
from dmoc.jit import njit

# A pivot below this share of its diagonal is rounding and counts as not positive.
SMALLEST_PIVOT = 1e-15


class Factor(NamedTuple):
    """`slopes` U (N, n, X), `gains` K (N, n, S), `chols` (N, n, n), `hux` (N, n, X), `huu`
    (N, n, n)."""

    slopes: Array
    gains: Array
    chols: Array
    hux: Array
    huu: Array


@njit
def factorise(  # type: ignore[no-untyped-def]
    hess, rows, sigma, delta, fixed, first, n, factor_of, frame, value, scratch
):
    """Factor of stages m−1..0, m = `first`; the pivot of h, or a number ≤ 0 if the inertia is
    wrong.

    `hess` (N, F, F), `rows` (N+1, n, F), `sigma` (size,) and `delta` are added to the diagonal,
    `fixed` (size,) marks variables without a step; `value` (S, S) is the cost to go of the state of
    stage m (see `end_kernels`). Output: `factor_of`, a `Factor`. Workspace: `frame` (F, F),
    `scratch` (n, X).
    """
    slopes, gains, chols, hux, huu = factor_of
    count, size_f = hess.shape[0], hess.shape[1]
    size_s, size_x = 3 * n + 1, 4 * n + 1
    step = (2 * count + 1) * n
    for k in range(first - 1, -1, -1):
        base = 2 * n * k
        for i in range(size_f):
            for j in range(size_f):
                frame[i, j] = hess[k, i, j]
        for i in range(size_s):
            # The state (q_k, q_{k+1}, û_k, h) of the next stage in the frame of this one.
            at = n + i if i < n else (size_s + i - n if i < 2 * n else size_x + i - 2 * n)
            at = 3 * n if i == 3 * n else at
            for j in range(n):
                frame[at, n + j] += value[i, j]
                frame[at, size_s + j] += value[i, n + j]
                frame[at, size_x + j] += value[i, 2 * n + j]
            frame[at, 3 * n] += value[i, 3 * n]
        for i in range(n):
            frame[size_s + i, size_s + i] += sigma[base + 2 * n + i] + delta
            frame[size_x + i, size_x + i] += sigma[base + n + i] + delta
        for i in range(n):
            inverse = -1.0 / rows[k, i, size_x + i]
            for p in range(size_x):
                slopes[k, i, p] = inverse * rows[k, i, p]
        for i in range(n):
            for p in range(size_x):
                hux[k, i, p] = frame[size_x + i, p]
                scratch[i, p] = frame[size_x + i, p]
            for j in range(n):
                weight = frame[size_x + i, size_x + j]
                huu[k, i, j] = weight
                for p in range(size_x):
                    scratch[i, p] += 0.5 * weight * slopes[k, j, p]
        for p in range(size_x):  # from here on the lower triangle is enough
            for i in range(n):
                left, right = slopes[k, i, p], scratch[i, p]
                for j in range(p + 1):
                    frame[p, j] += left * scratch[i, j] + right * slopes[k, i, j]
        if not _eliminate_knot(frame, fixed, base + 2 * n, n, gains[k], chols[k], value):
            return -1.0
    if fixed[step]:
        return 1.0
    return value[3 * n, 3 * n] + sigma[step] + delta


@njit
def _eliminate_knot(frame, fixed, at, n, gain, chol, value):  # type: ignore[no-untyped-def]
    """Minimise over c: Cholesky factor, K = H_cc⁻¹ H_cs, and the cost to go of the state."""
    size_s = 3 * n + 1
    for i in range(n):
        if fixed[at + i]:
            for j in range(size_s + n):
                frame[size_s + i, j] = 0.0
            for j in range(n):
                frame[size_s + j, size_s + i] = 0.0
            frame[size_s + i, size_s + i] = 1.0
    for i in range(n):
        for j in range(i + 1):
            total = frame[size_s + i, size_s + j]
            for m in range(j):
                total -= chol[i, m] * chol[j, m]
            if i == j:
                if not total > SMALLEST_PIVOT * abs(frame[size_s + i, size_s + i]):
                    return False
                chol[i, i] = np.sqrt(total)
            else:
                chol[i, j] = total / chol[j, j]
    for i in range(n):  # W = L⁻¹ H_cs
        for p in range(size_s):
            gain[i, p] = frame[size_s + i, p]
        for m in range(i):
            factor = chol[i, m]
            for p in range(size_s):
                gain[i, p] -= factor * gain[m, p]
        factor = 1.0 / chol[i, i]
        for p in range(size_s):
            gain[i, p] *= factor
    for p in range(size_s):
        for j in range(p + 1):
            value[p, j] = frame[p, j]
        for i in range(n):
            factor = gain[i, p]
            for j in range(p + 1):
                value[p, j] -= factor * gain[i, j]
        for j in range(p):
            value[j, p] = value[p, j]
    for i in range(n - 1, -1, -1):  # K = L⁻ᵀ W
        for m in range(i + 1, n):
            factor = chol[m, i]
            for p in range(size_s):
                gain[i, p] -= factor * gain[m, p]
        factor = 1.0 / chol[i, i]
        for p in range(size_s):
            gain[i, p] *= factor
    return True


@njit
def solve(  # type: ignore[no-untyped-def]
    rows, gradient, defect, pivot_h, fixed, first, n, factor_of, push, known, x, lam
):
    """x up to knot m = `first` and multipliers `lam` (N+1, n) of rows 0..m−1 for `gradient` g
    (size,) and `defect` c (N+1, n).

    `known` (3, F): row 1 is the gradient of the cost to go of stage m on entry, row 2 its state at
    the end. Workspace: `push` (3, N, n) for û's gradient, the feed-forward of c and u_0.
    """
    slopes, gains, chols, hux, huu = factor_of
    count, size_f = slopes.shape[0], 5 * n + 1
    size_s, size_x = 3 * n + 1, 4 * n + 1
    step = (2 * count + 1) * n
    g, v, state = known[0], known[1], known[2]
    for k in range(first - 1, -1, -1):
        base = 2 * n * k
        for i in range(n):
            g[i], g[2 * n + i] = 0.0, 0.0
            g[n + i] = v[i]
            g[size_s + i] = gradient[base + 2 * n + i] + v[n + i]
            push[0, k, i] = gradient[base + n + i] + v[2 * n + i]
            push[2, k, i] = -defect[k, i] / rows[k, i, size_x + i]
        g[3 * n] = v[3 * n]
        for i in range(n):
            constant, total = push[2, k, i], push[0, k, i]
            for j in range(n):
                total += huu[k, i, j] * push[2, k, j]
            for p in range(size_x):
                g[p] += hux[k, i, p] * constant + slopes[k, i, p] * total
        for i in range(n):
            if fixed[base + 2 * n + i]:
                g[size_s + i] = 0.0
            push[1, k, i] = g[size_s + i]
        for p in range(size_s):
            v[p] = g[p]
        for i in range(n):
            factor = g[size_s + i]
            for p in range(size_s):
                v[p] -= gains[k, i, p] * factor
        for i in range(n):
            for m in range(i):
                push[1, k, i] -= chols[k, i, m] * push[1, k, m]
            push[1, k, i] /= chols[k, i, i]
        for i in range(n - 1, -1, -1):
            for m in range(i + 1, n):
                push[1, k, i] -= chols[k, m, i] * push[1, k, m]
            push[1, k, i] /= chols[k, i, i]
    for p in range(size_f):
        state[p] = 0.0
    if not fixed[step]:
        state[3 * n] = -(gradient[step] + v[3 * n]) / pivot_h
    x[step] = state[3 * n]
    for i in range(n):
        x[i] = 0.0
    for k in range(first):
        base = 2 * n * k
        for i in range(n):
            total = push[1, k, i]
            for p in range(size_s):
                total += gains[k, i, p] * state[p]
            state[size_s + i] = -total
        for i in range(n):
            total = push[2, k, i]
            for p in range(size_x):
                total += slopes[k, i, p] * state[p]
            state[size_x + i] = total
        for i in range(n):
            total = push[0, k, i]
            for p in range(size_x):
                total += hux[k, i, p] * state[p]
            for j in range(n):
                total += huu[k, i, j] * state[size_x + j]
            lam[k, i] = -total / rows[k, i, size_x + i]
        for i in range(n):
            x[base + n + i] = state[size_x + i]
            x[base + 2 * n + i] = state[size_s + i]
            state[i] = state[n + i]
            state[n + i] = state[size_s + i]
            state[2 * n + i] = state[size_x + i]
