r"""A polyline in joint space with parabolic blends at its corners, as a smooth function q(s).

Segments run at constant dq/ds; at a corner P with directions d⁻ = dq/ds before and d⁺ after, the
blend of half-length a is the parabola

.. math:: q(\sigma) = P - a d^- + d^- \sigma + \frac{d^+ - d^-}{4a}\,\sigma^2,
          \qquad 0 \le \sigma \le 2a,

which leaves the polyline by at most a‖d⁺ − d⁻‖/4 and is C¹ at both ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array

FreeTest = Callable[[Array], npt.NDArray[np.bool_]]
_LEAST_SHARE = 1e-3
_SMALLEST_STEP_RAD = 1e-9


@dataclass(frozen=True)
class BlendedPath:
    """Quadratic pieces: q(s) = c0 + c1 σ + c2 σ², σ = s − breaks[i] on piece i.

    `breaks` (P+1,) is increasing from 0; `c0`, `c1`, `c2` are (P, n).
    """

    breaks: Array
    c0: Array
    c1: Array
    c2: Array

    @property
    def length(self) -> float:
        """The last value of s."""
        return float(self.breaks[-1])

    def evaluate(self, s: Array) -> tuple[Array, Array, Array]:
        """q, dq/ds and d²q/ds² (K, n) at s (K,), of the piece to the right at a break."""
        s = np.asarray(s, dtype=float)
        piece = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        sigma = (s - self.breaks[piece])[:, None]
        c0, c1, c2 = self.c0[piece], self.c1[piece], self.c2[piece]
        return c0 + sigma * (c1 + sigma * c2), c1 + 2 * sigma * c2, 2 * c2

    def grid(self, least_points: int) -> Array:
        """Values of s that hold every break, at least two steps a piece, and no long step."""
        longest = self.length / max(1, least_points - 1)
        parts = [
            np.linspace(a, b, max(3, int(np.ceil((b - a) / longest)) + 1))[:-1]
            for a, b in zip(self.breaks[:-1], self.breaks[1:])
        ]
        return np.concatenate([*parts, self.breaks[-1:]])


def blend_corners(
    points: Array,
    joint_scale: Array,
    *,
    pinned: Array | None = None,
    pinned_deviation: float = 1e-3,
    is_free: FreeTest | None = None,
) -> BlendedPath:
    """Blend the corners of the polyline `points` (K, n) [rad].

    `joint_scale` (n,) [rad/s] (the speed limits) measures length: s of a segment is
    max_j |Δq_j| / joint_scale_j, about seconds at full speed. Every corner starts with the longest
    blend that leaves room for its neighbours and is halved until `is_free` (rows of q → bool)
    holds on it, down to a thousandth of the segment. Corners where `pinned` (K,) is true are
    left by no more than `pinned_deviation` [rad, 2-norm].
    """
    points = np.asarray(points, dtype=float)
    keep = np.r_[True, np.max(np.abs(np.diff(points, axis=0)), axis=1) > _SMALLEST_STEP_RAD]
    pins = np.zeros(len(points), dtype=bool) if pinned is None else np.asarray(pinned, dtype=bool)
    points, pins = points[keep], pins[keep]
    if len(points) < 2:
        points = np.vstack([points[:1], points[:1] + _SMALLEST_STEP_RAD])
        pins = np.zeros(2, dtype=bool)
    step = np.diff(points, axis=0)
    length = np.max(np.abs(step) / joint_scale, axis=1)
    direction = step / length[:, None]
    turn = np.linalg.norm(np.diff(direction, axis=0), axis=1)
    room = 0.5 * np.minimum(length[:-1], length[1:])
    half = np.where(
        pins[1:-1], np.minimum(room, 4 * pinned_deviation / np.maximum(turn, 1e-12)), room
    )
    if is_free is not None:
        half = _shrink_until_free(points, direction, half, room, is_free)
    return _assemble(points, direction, length, half)


def _shrink_until_free(
    points: Array, direction: Array, half: Array, room: Array, is_free: FreeTest
) -> Array:
    half = half.copy()
    sigma = np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75])
    open_corners = np.arange(len(half))
    while open_corners.size:
        a = half[open_corners][:, None, None]
        before, after = direction[open_corners][:, None], direction[open_corners + 1][:, None]
        x = sigma[None, :, None]
        q = points[open_corners + 1][:, None] + a * (
            before * (x - 1) + 0.25 * x * x * (after - before)
        )
        free = np.asarray(is_free(q.reshape(-1, q.shape[-1]))).reshape(q.shape[:2]).all(axis=1)
        blocked = open_corners[~free]
        half[blocked] *= 0.5
        open_corners = blocked[half[blocked] > _LEAST_SHARE * room[blocked]]
    return half


def _assemble(points: Array, direction: Array, length: Array, half: Array) -> BlendedPath:
    corner_s = np.concatenate([[0.0], np.cumsum(length)])
    breaks, c0, c1, c2 = [0.0], [], [], []

    def piece(end: float, start_q: Array, slope: Array, curve: Array) -> None:
        if end - breaks[-1] > 1e-12:
            breaks.append(end)
            c0.append(start_q)
            c1.append(slope)
            c2.append(curve)

    zero = np.zeros(points.shape[1])
    ahead = 0.0
    for i, d in enumerate(direction):
        a = half[i] if i < len(half) else 0.0
        piece(corner_s[i + 1] - a, points[i] + ahead * d, d, zero)
        if i < len(half):
            curve = (direction[i + 1] - d) / (4 * a)
            piece(corner_s[i + 1] + a, points[i + 1] - a * d, d, curve)
        ahead = a
    return BlendedPath(np.array(breaks), np.array(c0), np.array(c1), np.array(c2))
