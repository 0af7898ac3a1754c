r"""Half-spaces: linearised distances at points between the knots.

At a checked point q̂ of interval i with fraction λ, a pair at distance d with gradient g gives

.. math:: g \cdot \big((1-\lambda) q_i + \lambda q_{i+1}\big) \;\ge\;
          r - d + g \cdot \big((1-\lambda) \hat q_i + \lambda \hat q_{i+1}\big)

where r is what is demanded. Distance and gradient are taken on the interpolant; its offset from
the chord changes slowly and is exact where the iteration stands still.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.optimize import linprog

from dmoc.arrays import Array
from dmoc.programme.types import PathRows
from dmoc.refinement.iterate import Points
from dmoc.refinement.points import View

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


# A row may ask for at most this share of what the trust region can give: the programme stays
# feasible even where several rows pull.
_ATTAINABLE_SHARE = 0.8


def half_spaces(
    view: View,
    points: Points,
    required: Array,
    radius: Array,
    push_out_m: float,
    rows_per_point: int,
) -> PathRows:
    """The half-spaces of one outer iteration.

    `required` (P,) [m] is demanded at the points, `radius` (N+1, n) [rad] is the trust region (0 at
    fixed knots). A point that violates is asked to move by at most `push_out_m` and by no more
    than the trust region allows. Rows that cannot become active within the trust region are left
    out; of the others the `rows_per_point` with the smallest (d − r)/‖g‖₁ are kept at every point.
    """
    rows = view.rows
    point = rows.knot
    share = points.fraction[:, None]
    room = (1 - share) * radius[points.interval] + share * radius[points.interval + 1]
    swing = np.sum(np.abs(rows.gradient) * room[point], axis=1)
    slack = rows.distance_m - required[point]
    wanted = np.minimum(-slack, push_out_m)
    wanted = np.where(slack < 0, np.minimum(wanted, _ATTAINABLE_SHARE * swing), wanted)
    norm = np.maximum(np.sum(np.abs(rows.gradient), axis=1), 1e-9)
    keep = np.flatnonzero((slack < swing) & (swing > 1e-12))
    keep = _nearest(point[keep], (slack / norm)[keep], keep, rows_per_point)
    along = np.sum(rows.gradient[keep] * view.chord_rad[point[keep]], axis=1)
    asked = PathRows(
        interval=points.interval[point[keep]],
        fraction=points.fraction[point[keep]],
        gradient=rows.gradient[keep],
        lower=along,
    )
    return replace(asked, lower=along + yielding(asked, wanted[keep], radius))


def _nearest(
    point: npt.NDArray[np.int64], score: Array, index: npt.NDArray[np.intp], most: int
) -> npt.NDArray[np.intp]:
    """`index` of the `most` smallest scores of every point, in order of point and score."""
    order = np.lexsort((score, point))
    sorted_point = point[order]
    first = np.searchsorted(sorted_point, sorted_point, side="left")
    rank = np.arange(len(order)) - first
    return index[order[rank < most]]
