"""Touching or not, at single configurations and batches of them.

"Touching" means not proven farther than `inflation`.
"""

from __future__ import annotations

from typing import Any

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, clearly_farther, gjk
from planning.collision.kernels.queries import place, skipped


@njit(plain=True, inner=True)
def contact_at(view: Any, q: Any, inflation: float) -> int:
    """A touching pair at q (n,), or −1."""
    solids, pose, piece, extra = view.solids, view.pose, view.pairs.piece, view.pairs.extra
    s, out, axis = view.work.s, view.work.out, view.work.axis
    place(view, q)
    for m in range(piece.shape[0]):
        a, b = piece[m, 0], piece[m, 1]
        limit = inflation + extra[m]
        if clearly_farther(pose, solids.size, a, b, limit) or skipped(view, m):
            continue
        axis[0] = axis[1] = axis[2] = 0.0
        status = gjk(solids, pose, a, b, axis, limit, limit, s, out)
        if status != FAR and out[7] <= limit:
            return m
    return -1


@njit(plain=True)
def first_contacts(view: Any, q: Any, inflation: float, first: Any) -> None:
    """first[k] = index of a touching pair at q[k] (K, n), or −1."""
    for k in range(q.shape[0]):
        first[k] = contact_at(view, q[k], inflation)
