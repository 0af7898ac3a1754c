"""Cut a triangle mesh into convex pieces that cover it, solid included.

Cells are cut by axis-parallel planes, best gain first. Each cut closes both halves with a cap (a
fan over every loop of the cut), so a half's hull holds every extreme point of the solid in it:
the pieces cover the surface always, and the inside of a watertight mesh too.
"""

from __future__ import annotations

import heapq

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from dmoc.arrays import Array
from planning.convex import convex_shape
from planning.mesh_gate import Mesh
from planning.shapes import Shape

__all__ = ["mesh_pieces", "split_by_plane"]

_FRACTIONS = (0.2, 0.35, 0.5, 0.65, 0.8)
_DIRECTIONS = np.random.default_rng(0).normal(size=(60, 3))


def mesh_pieces(mesh: Mesh, max_pieces: int = 64, tolerance_m: float = 0.004) -> tuple[Shape, ...]:
    """Convex pieces (at most `max_pieces`) that cover `mesh`.

    A cell is cut while that saves more volume than a slab of `tolerance_m` over the cell's
    largest side: about how far a piece may stand off the mesh.
    """
    heap: list[tuple[float, int, Array, tuple[Array, Array] | None]] = []
    count = 0

    def push(soup: Array) -> None:
        nonlocal count
        gain, halves = _best_cut(soup)
        size = np.sort(np.ptp(soup.reshape(-1, 3), axis=0))
        worth = halves is not None and gain > tolerance_m * size[1] * size[2]
        heapq.heappush(heap, (-gain if worth else 0.0, count, soup, halves if worth else None))
        count += 1

    push(mesh.vertices_m[mesh.faces])
    while len(heap) < max_pieces and heap[0][3] is not None:
        _, _, _, halves = heapq.heappop(heap)
        assert halves is not None
        for half in halves:
            push(half)
    order = sorted(heap, key=lambda item: item[1])
    return tuple(convex_shape(np.unique(item[2].reshape(-1, 3), axis=0)) for item in order)


def split_by_plane(mesh: Mesh, normal: Array, offset: float) -> tuple[Mesh | None, Mesh | None]:
    """The parts of `mesh` with n·x <= offset and n·x >= offset, closed by caps (None if empty)."""
    parts: list[Mesh | None] = []
    for soup in _cut(mesh.vertices_m[mesh.faces], np.asarray(normal, dtype=float), offset):
        if len(soup) == 0:
            parts.append(None)
            continue
        vertices, index = np.unique(soup.reshape(-1, 3), axis=0, return_inverse=True)
        parts.append(Mesh(vertices, index.reshape(-1, 3), mesh.watertight))
    return parts[0], parts[1]


def _best_cut(soup: Array) -> tuple[float, tuple[Array, Array] | None]:
    """The axis-parallel cut that saves most hull volume, and that volume [m³]."""
    points = np.unique(soup.reshape(-1, 3), axis=0)
    whole = _hull_volume(points)
    if whole <= 0.0:
        return 0.0, None
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    best, cut = 0.0, None
    for axis in range(3):
        for fraction in _FRACTIONS:
            offset = low[axis] + fraction * size[axis]
            gain = whole - sum(_hull_volume(half) for half in _rough_halves(soup, axis, offset))
            if gain > best:
                best, cut = gain, (axis, offset)
    if cut is None:
        return 0.0, None
    first, second = _cut(soup, np.eye(3)[cut[0]], cut[1])
    if len(first) == 0 or len(second) == 0:
        return 0.0, None
    exact = whole - sum(_hull_volume(half.reshape(-1, 3)) for half in (first, second))
    return exact, (first, second)


def _rough_halves(soup: Array, axis: int, offset: float) -> tuple[Array, Array]:
    """Points of both halves without building them (for scoring only)."""
    height = soup[:, :, axis] - offset
    crossing = (height.min(axis=1) < 0) & (height.max(axis=1) > 0)
    cut = _cut_points(soup[crossing], height[crossing])[0].reshape(-1, 3)
    points, side = soup.reshape(-1, 3), height.reshape(-1)
    return (
        np.concatenate([points[side <= 0], cut]),
        np.concatenate([points[side >= 0], cut]),
    )


def _hull_volume(points: Array) -> float:
    if len(points) < 4:
        return 0.0
    if len(points) > 2000:  # extremes along fixed directions are enough for a score
        chosen = np.unique(np.argmax(points @ _DIRECTIONS.T, axis=0))
        points = points[chosen]
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _cut_points(soup: Array, height: Array) -> tuple[Array, Array]:
    """For crossing triangles (T, 3, 3): the two cut points (T, 2, 3) and the lone corner (T,)."""
    above = height > 0
    # The corner that stands alone on its side; corners on the plane count as below.
    lone = np.where(above.sum(axis=1) == 1, np.argmax(above, axis=1), np.argmin(above, axis=1))
    rows = np.arange(len(soup))
    ends = []
    for step in (1, 2):
        other = (lone + step) % 3
        a, b = soup[rows, lone], soup[rows, other]
        ha, hb = height[rows, lone], height[rows, other]
        # One order for both triangles of an edge, so that they share the point exactly.
        swap = _later(a, b)
        a, b = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
        ha, hb = np.where(swap, hb, ha), np.where(swap, ha, hb)
        fraction = ha / (ha - hb)
        ends.append(a + fraction[:, None] * (b - a))
    if not len(soup):
        return np.zeros((0, 2, 3)), lone
    return np.stack(ends, axis=1), lone


def _later(a: Array, b: Array) -> Array:
    """Whether row of a comes after row of b in lexicographic order."""
    result = np.zeros(len(a), dtype=bool)
    tied = np.ones(len(a), dtype=bool)
    for axis in range(a.shape[1] if a.ndim == 2 else 0):
        result |= tied & (a[:, axis] > b[:, axis])
        tied &= a[:, axis] == b[:, axis]
    return result


def _cut(soup: Array, normal: Array, offset: float) -> tuple[Array, Array]:
    """Closed halves below and above the plane, as triangle soups (T, 3, 3)."""
    height = soup @ normal - offset
    below, above = height.max(axis=1) <= 0, height.min(axis=1) >= 0
    crossing = ~below & ~above
    parts: tuple[list[Array], list[Array]] = ([soup[below]], [soup[above & ~below]])
    cross, level = soup[crossing], height[crossing]
    if len(cross):
        ends, lone = _cut_points(cross, level)
        rows = np.arange(len(cross))
        corner = cross[rows, lone]
        second, third = cross[rows, (lone + 1) % 3], cross[rows, (lone + 2) % 3]
        first_end, last_end = ends[:, 0], ends[:, 1]
        tip = np.stack([corner, first_end, last_end], axis=1)
        quad = (
            np.stack([first_end, second, third], axis=1),
            np.stack([first_end, third, last_end], axis=1),
        )
        is_above = level[rows, lone] > 0
        for side, chosen in ((0, ~is_above), (1, is_above)):
            parts[side].append(tip[chosen])
            parts[1 - side] += [part[chosen] for part in quad]
        cap = _cap(ends)
        parts[0].append(cap)
        parts[1].append(cap[:, ::-1])
    low, high = (np.concatenate(part) for part in parts)
    return low, high


def _cap(segments: Array) -> Array:
    """A fan of triangles over each connected loop of cut segments (S, 2, 3)."""
    points, index = np.unique(np.round(segments.reshape(-1, 3), 10), axis=0, return_inverse=True)
    pairs = index.reshape(-1, 2)
    graph = coo_matrix(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points))
    )
    _, label = connected_components(graph, directed=False)
    _, hub = np.unique(label, return_index=True)
    centre = points[hub][label[pairs[:, 0]]]
    return np.stack([centre, segments[:, 0], segments[:, 1]], axis=1)
