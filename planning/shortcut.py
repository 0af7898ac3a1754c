"""Shortcuts: a planner's path made short, by straight segments that stay free."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from dmoc.arrays import Array

__all__ = ["shortcut"]

#: Draws in a row without gain after which a path counts as short.
PATIENCE = 25


def shortcut(
    q_rad: Array,
    is_free: Callable[[Array, Array], bool],
    *,
    scale: Array,
    tries: int,
    seed: int,
) -> Array:
    """A path (K', n) from the first to the last row of `q_rad` (K, n), not longer than it.

    Each try draws two points on the path, uniformly by length in the metric Σ (scale_j Δq_j)²,
    and replaces what lies between them by a straight segment if `is_free(q0, q1)`. The straight
    line from end to end is tried first, then the removal of single knots. Stops after `tries`
    draws or `PATIENCE` draws without gain. Same seed, same path.
    """
    path = np.array(q_rad, dtype=float)
    if len(path) <= 2 or is_free(path[0], path[-1]):
        return path[[0, -1]]
    rng = np.random.default_rng(seed)
    path = _drop_knots(path, is_free)
    since = 0
    for _ in range(tries):
        if len(path) <= 2 or since >= PATIENCE:
            break
        since += 1
        steps = np.linalg.norm(np.diff(path, axis=0) * scale, axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        lo, hi = np.sort(rng.uniform(0.0, along[-1], 2))
        i = int(np.clip(np.searchsorted(along, lo, side="right") - 1, 0, len(steps) - 1))
        k = int(np.clip(np.searchsorted(along, hi, side="right") - 1, 0, len(steps) - 1))
        if i == k:
            continue
        first = path[i] + (lo - along[i]) / max(steps[i], 1e-12) * (path[i + 1] - path[i])
        last = path[k] + (hi - along[k]) / max(steps[k], 1e-12) * (path[k + 1] - path[k])
        gain = (hi - lo) - float(np.linalg.norm((last - first) * scale))
        if gain <= 1e-3 * along[-1] or not is_free(first, last):
            continue
        path = np.vstack([path[: i + 1], first, last, path[k + 1 :]])
        since = 0
    return _drop_knots(path, is_free)


def _drop_knots(path: Array, is_free: Callable[[Array, Array], bool]) -> Array:
    """Remove interior knots whose neighbours see each other, from the start on."""
    kept = [path[0]]
    for here, after in pairwise(path[1:]):
        if not is_free(kept[-1], after):
            kept.append(here)
    return np.vstack([*kept, path[-1]])
