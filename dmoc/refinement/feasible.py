r"""How much of what the half-spaces ask for can be had at once inside the trust region.

Points that violate ask to be moved out; demands of different points can contradict each other or
the trust region, and an infeasible programme costs the solver more than ten feasible ones. The
linear programme

.. math:: \min \sum_r s_r \quad\text{s.t.}\quad
          g_r \cdot \big((1-\lambda_r)\Delta_i + \lambda_r \Delta_{i+1}\big) + s_r \ge w_r,
          \quad |\Delta| \le \text{radius}, \; s \ge 0

tells by how much each demand has to give way.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from dmoc.arrays import Array
from dmoc.nlp_types import PathRows

__all__ = ["yielding"]

# Of what can be had, this share is asked for: interior-point methods need an interior.
_SHARE = 0.9


def yielding(rows: PathRows, wanted: Array, radius: Array) -> Array:
    """`wanted` (R,) [m] of the rows, lowered until all can be met within `radius` (N+1, n) [rad].

    `wanted` is the change of distance demanded from each row: negative where there is room.
    """
    if not np.any(wanted > 0):
        return wanted
    count, n = len(wanted), radius.shape[1]
    share = rows.fraction[:, None]
    first = (rows.interval[:, None] * n + np.arange(n)).ravel()
    matrix = sparse.csr_matrix(
        (
            np.concatenate(
                [((1 - share) * rows.gradient).ravel(), (share * rows.gradient).ravel()]
            ),
            (np.tile(np.repeat(np.arange(count), n), 2), np.concatenate([first, first + n])),
        ),
        shape=(count, radius.size),
    )
    free = np.flatnonzero(radius.ravel() > 0)
    bound = radius.ravel()[free]
    # The overloads of scipy's stubs do not know sparse matrices.
    solve: Any = linprog
    result = solve(
        np.concatenate([np.zeros(len(free)), np.ones(count)]),
        A_ub=-sparse.hstack([matrix[:, free], sparse.identity(count, format="csr")]).tocsr(),
        b_ub=-wanted,
        bounds=np.column_stack(
            [
                np.concatenate([-bound, np.zeros(count)]),
                np.concatenate([bound, np.full(count, np.inf)]),
            ]
        ),
        method="highs",
    )
    if result.x is None:
        return np.minimum(wanted, 0.0)
    given = wanted - result.x[len(free) :]
    return np.where(given > 0, _SHARE * given, given)
