"""RRT-Connect in compiled code: a path in milliseconds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from planning.collision.kernels.segment import Scan
from planning.collision.kernels.tree import grow_trees

#: Nodes of one tree at most.
MOST_NODES = 20_000


class TreePath(NamedTuple):
    """Knots (K, n) or None, iterations of the planner, checked segments, and how often each piece
    pair was in the way (M,).
    """

    q_rad: Array | None
    iterations: int
    checks: int
    blocked: npt.NDArray[np.int64]


def tree_path(
    scan: Scan,
    start: Array,
    goal: Array,
    *,
    limits: tuple[Array, Array],
    scale: Array,
    reach_m: float,
    seed: int,
    max_iterations: int,
) -> TreePath:
    """A path from start to goal (n,) within `limits`, by at most so many random configurations.

    `reach_m` is how far a tree grows in one step, in the metric Σ (scale_j Δq_j)². Same seed, same
    path, wherever it runs.
    """
    n = len(start)
    lower, upper = (np.asarray(side, dtype=float) for side in limits)
    drawn = lower + np.random.default_rng(seed).random((max_iterations, n)) * (upper - lower)
    nodes = np.empty((2, MOST_NODES, n))
    nodes[0, 0], nodes[1, 0] = start, goal
    parent = np.empty((2, MOST_NODES), dtype=np.int64)
    parent[:, 0] = -1
    blocked = np.zeros(len(scan.scene.pairs.body), dtype=np.int64)
    count, meeting = np.ones(2, dtype=np.int64), np.empty(2, dtype=np.int64)
    iterations, checks = grow_trees(
        scan,
        np.asarray(scale, dtype=float),
        reach_m,
        drawn,
        nodes,
        parent,
        count,
        meeting,
        blocked,
    )
    if meeting[0] < 0:
        return TreePath(None, int(iterations), int(checks), blocked)
    ways = []
    for tree in (0, 1):
        way, at = [], int(meeting[tree])
        while at >= 0:
            way.append(nodes[tree, at])
            at = int(parent[tree, at])
        ways.append(way)
    path = np.array([*ways[0][::-1], *ways[1][1:]])
    return TreePath(path, int(iterations), int(checks), blocked)
