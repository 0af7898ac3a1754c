"""The Newton system of a staged programme as one dense matrix."""

import numpy as np


def places(k: int, count: int, n: int) -> np.ndarray:
    """Positions of the frame (q⁻, q, û⁻, h, q⁺, û) of stage k in x, −1 for what is not there."""

    def knot(j: int) -> np.ndarray:
        return 2 * n * j + np.arange(n) if 0 <= j <= count else np.full(n, -1)

    def torque(j: int) -> np.ndarray:
        return 2 * n * j + n + np.arange(n) if 0 <= j < count else np.full(n, -1)

    step = [(2 * count + 1) * n]
    return np.concatenate([knot(k - 1), knot(k), torque(k - 1), step, knot(k + 1), torque(k)])


def dense_system(hess, rows, diagonal, fixed) -> tuple[np.ndarray, np.ndarray]:
    """[[W, Jᵀ], [J, 0]] for the variables that are not fixed, and which these are."""
    count, n = len(hess), rows.shape[1]
    size = len(diagonal)
    w, j = np.diag(diagonal), np.zeros(((count + 1) * n, size))
    for k in range(count + 1):
        at = places(k, count, n)
        here = at >= 0
        j[k * n : (k + 1) * n, at[here]] += rows[k][:, here]
        if k < count:
            w[np.ix_(at[here], at[here])] += hess[k][np.ix_(here, here)]
    free = np.flatnonzero(~fixed)
    j = j[:, free]
    return np.block([[w[np.ix_(free, free)], j.T], [j, np.zeros((len(j),) * 2)]]), free


def dense_solution(hess, rows, diagonal, fixed, gradient, defect) -> tuple[np.ndarray, np.ndarray]:
    """x and the multipliers of the rows."""
    matrix, free = dense_system(hess, rows, diagonal, fixed)
    found = np.linalg.solve(matrix, -np.concatenate([gradient[free], defect.ravel()]))
    x = np.zeros(len(diagonal))
    x[free] = found[: len(free)]
    return x, found[len(free) :]


def has_right_inertia(hess, rows, diagonal, fixed) -> bool:
    """As many positive eigenvalues as variables, the others negative."""
    matrix, free = dense_system(hess, rows, diagonal, fixed)
    values = np.linalg.eigvalsh(matrix)
    return (
        int(np.sum(values > 0)) == len(free)
        and int(np.sum(values < 0)) == rows.shape[0] * (rows.shape[1])
    )
