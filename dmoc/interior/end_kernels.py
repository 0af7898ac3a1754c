"""Kernels of the last stages, which have as many rows as unknowns (see `riccati_kernels`)."""

from __future__ import annotations

from typing import NamedTuple

from dmoc.arrays import Array
from dmoc.jit import njit


class End(NamedTuple):
    """Factor of the last stages: `lu` (t, t), `pivot` (t,), `map` Y (t, S), `hess` (t, t+S) =
    (H_yy, H_ys)."""

    lu: Array
    pivot: Array
    map: Array
    hess: Array


@njit
def factorise_end(  # type: ignore[no-untyped-def]
    hess, rows, sigma, delta, place, n, first, end, value, scratch
):
    """The square last stages m = `first`..N: Y = −B_y⁻¹ B_s and the cost to go of their state.

    `place` (N+1−m, F) maps their frames to (state, y) or −1. Outputs: `end`, `value` (S, S).
    Workspace: `scratch` (S+t, S+t). False where the rows are dependent.
    """
    end_lu, end_pivot, end_map, end_hess = end
    count, size_f, size_s = hess.shape[0], hess.shape[1], 3 * n + 1
    many = end_lu.shape[0]
    size = size_s + many
    for i in range(size):
        for j in range(size):
            scratch[i, j] = 0.0
    for k in range(first, count):
        for i in range(size_f):
            p = place[k - first, i]
            if p >= 0:
                for j in range(size_f):
                    q = place[k - first, j]
                    if q >= 0:
                        scratch[p, q] += hess[k, i, j]
    for i in range(n):
        scratch[size_s + i, size_s + i] += sigma[2 * n * (first + 1) + i] + delta
    for k in range(first, count):
        at = size_s + n + (k - first) * n
        for i in range(n):
            scratch[at + i, at + i] += sigma[2 * n * k + n + i] + delta
    for i in range(many):
        for j in range(many):
            end_hess[i, j] = scratch[size_s + i, size_s + j]
            end_lu[i, j] = 0.0
        for j in range(size_s):
            end_hess[i, many + j] = scratch[size_s + i, j]
            end_map[i, j] = 0.0
    for k in range(first, count + 1):
        for i in range(n):
            row = (k - first) * n + i
            for j in range(size_f):
                p = place[k - first, j]
                if p >= size_s:
                    end_lu[row, p - size_s] += rows[k, i, j]
                elif p >= 0:
                    end_map[row, p] -= rows[k, i, j]
    if not _lu(end_lu, end_pivot):
        return False
    for i in range(many):
        p = end_pivot[i]
        if p != i:
            for j in range(size_s):
                end_map[i, j], end_map[p, j] = end_map[p, j], end_map[i, j]
        for m in range(i):
            factor = end_lu[i, m]
            if factor != 0.0:
                for j in range(size_s):
                    end_map[i, j] -= factor * end_map[m, j]
    for i in range(many - 1, -1, -1):
        for m in range(i + 1, many):
            factor = end_lu[i, m]
            if factor != 0.0:
                for j in range(size_s):
                    end_map[i, j] -= factor * end_map[m, j]
        factor = 1.0 / end_lu[i, i]
        for j in range(size_s):
            end_map[i, j] *= factor
    # V = H_ss + Yᵀ T + Tᵀ Y with T = H_ys + ½ H_yy Y.
    for i in range(size_s):
        for j in range(size_s):
            value[i, j] = scratch[i, j]
    for i in range(many):
        for j in range(size_s):
            scratch[i, j] = end_hess[i, many + j]
        for m in range(many):
            factor = 0.5 * end_hess[i, m]
            if factor != 0.0:
                for j in range(size_s):
                    scratch[i, j] += factor * end_map[m, j]
    for p in range(size_s):
        for i in range(many):
            left, right = end_map[i, p], scratch[i, p]
            for j in range(size_s):
                value[p, j] += left * scratch[i, j] + right * end_map[i, j]
    return True


@njit
def _lu(matrix, pivot):  # type: ignore[no-untyped-def]
    """LU with row pivots in place (whole rows are swapped); False where it is singular."""
    size = matrix.shape[0]
    largest = 0.0
    for i in range(size):
        for j in range(size):
            largest = max(largest, abs(matrix[i, j]))
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        pivot[k] = best
        if not abs(matrix[best, k]) > 1e-14 * largest:
            return False
        if best != k:
            for j in range(size):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for i in range(k + 1, size):
            if matrix[i, k] != 0.0:
                factor = matrix[i, k] / matrix[k, k]
                matrix[i, k] = factor
                for j in range(k + 1, size):
                    matrix[i, j] -= factor * matrix[k, j]
    return True


@njit
def start_from_end(  # type: ignore[no-untyped-def]
    gradient, defect, n, first, end, end_known, known
):
    """y_0 and the gradient of y (first rows of `end_known` (3, t)), and the gradient of the cost to
    go of the last stages' state (second row of `known`)."""
    end_lu, end_pivot, end_map, end_hess = end
    size_s, many = 3 * n + 1, end_lu.shape[0]
    y, g, v = end_known[0], end_known[1], known[1]
    for i in range(n):
        g[i] = gradient[2 * n * (first + 1) + i]
    for i in range(n, many):
        k = first + (i - n) // n
        g[i] = gradient[2 * n * k + n + (i - n) % n]
    for i in range(many):
        y[i] = -defect[first + i // n, i % n]
    for i in range(many):
        p = end_pivot[i]
        if p != i:
            y[i], y[p] = y[p], y[i]
        for m in range(i):
            y[i] -= end_lu[i, m] * y[m]
    for i in range(many - 1, -1, -1):
        for m in range(i + 1, many):
            y[i] -= end_lu[i, m] * y[m]
        y[i] /= end_lu[i, i]
    for p in range(size_s):
        v[p] = 0.0
    for i in range(many):
        total = g[i]
        for j in range(many):
            total += end_hess[i, j] * y[j]
        for p in range(size_s):
            v[p] += end_hess[i, many + p] * y[i] + end_map[i, p] * total


@njit
def finish_end(n, first, end, end_known, known, x, lam):  # type: ignore[no-untyped-def]
    """x and `lam` of the last stages, whose state is the last row of `known`."""
    end_lu, end_pivot, end_map, end_hess = end
    size_s, many, count = 3 * n + 1, end_lu.shape[0], lam.shape[0] - 1
    y, state, multipliers = end_known[0], known[2], end_known[2]
    for i in range(many):
        for p in range(size_s):
            y[i] += end_map[i, p] * state[p]
    for i in range(many):
        total = end_known[1, i]
        for j in range(many):
            total += end_hess[i, j] * y[j]
        for p in range(size_s):
            total += end_hess[i, many + p] * state[p]
        multipliers[i] = -total
    _solve_transposed(end_lu, end_pivot, multipliers)
    for k in range(first + 1, count + 1):  # knots after the last free one have no step
        for i in range(n):
            x[2 * n * k + i] = 0.0
    for i in range(n):
        x[2 * n * (first + 1) + i] = y[i]
    for k in range(first, count):
        for i in range(n):
            x[2 * n * k + n + i] = y[n + (k - first) * n + i]
    for k in range(first, count + 1):
        for i in range(n):
            lam[k, i] = multipliers[(k - first) * n + i]


@njit
def _solve_transposed(matrix, pivot, b):  # type: ignore[no-untyped-def]
    """Solve Aᵀ x = b in place with the factor of `_lu`."""
    size = matrix.shape[0]
    for i in range(size):
        b[i] /= matrix[i, i]
        for m in range(i + 1, size):
            b[m] -= matrix[i, m] * b[i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            b[i] -= matrix[m, i] * b[m]
    for i in range(size - 1, -1, -1):
        p = pivot[i]
        if p != i:
            b[i], b[p] = b[p], b[i]
