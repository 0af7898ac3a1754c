"""Cut a triangle mesh into convex pieces that cover it, solid included.

Cells are cut by axis-parallel planes, best gain first. Of a watertight mesh a cell keeps, besides
its triangles, the polygons in which the planes cut the solid (caps, as closed sets of edges with
even-odd inside). Every extreme point of the solid in a cell is then an end of a triangle's or a
cap's edge, so the hull of those points covers the solid there, also where a cell lies wholly
inside. Of an open mesh the surface alone is covered.
"""

from __future__ import annotations

import hashlib
import heapq
import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from dmoc.arrays import Array, arrays_of
from dmoc.input_file import content_of
from dmoc.programme.codegen import cache_folder
from planning.geometry.convex import convex_shape
from planning.geometry.mesh import Mesh, is_watertight
from planning.geometry.shapes import Shape

#: Changes whenever `mesh_pieces` would cut differently.
_VERSION = 1
MAX_PIECES, TOLERANCE_M = 64, 0.004


def cached_pieces(mesh: Mesh) -> tuple[Shape, ...]:
    """`mesh_pieces`, from the cache folder if this mesh was cut before."""
    digest = hashlib.sha256(f"{_VERSION}|{MAX_PIECES}|{TOLERANCE_M}".encode())
    digest.update(mesh.vertices_m.tobytes())
    digest.update(mesh.faces.tobytes())
    path = cache_folder() / "pieces" / f"{digest.hexdigest()[:40]}.npz"
    found = _read(path)
    if found is None:
        found = [
            np.asarray(piece.vertices_m) for piece in mesh_pieces(mesh, MAX_PIECES, TOLERANCE_M)
        ]
        _write(path, found)
    # Both ways end in the same hulls, so a cached run equals a fresh one.
    return tuple(convex_shape(vertices) for vertices in found)


def _read(path: Path) -> list[np.ndarray] | None:
    try:
        data = arrays_of(content_of(path))
        rows, counts = data["vertices_m"], data["counts"]
        if rows.ndim != 2 or rows.shape[1] != 3 or counts.sum() != len(rows) or counts.min() < 4:
            return None
        return np.split(rows, np.cumsum(counts)[:-1])
    except (OSError, ValueError, KeyError):
        return None  # absent or damaged: cut again


def _write(path: Path, vertices: list[np.ndarray]) -> None:
    part = path.with_name(f"{path.stem}.{os.getpid()}.npz")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(
            part,
            vertices_m=np.concatenate(vertices),
            counts=np.array([len(rows) for rows in vertices]),
        )
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)  # no place for a cache: the next run cuts again


_FRACTIONS = (0.2, 0.35, 0.5, 0.65, 0.8)
_DIRECTIONS = np.random.default_rng(0).normal(size=(40, 3))


@dataclass(frozen=True)
class _Cell:
    """Triangles (T, 3, 3) and, per plane that bounds the cell, the cap's edges (E, 2, 3)."""

    triangles: Array
    caps: tuple[Array, ...]
    low: tuple[float, ...] = (-np.inf,) * 3
    high: tuple[float, ...] = (np.inf,) * 3

    def solid_volume(self) -> float | None:
        """Volume [m³] of the solid in the cell, if planes cut it on one side at most of some axis.

        Divergence theorem with the field (x − c) along that axis, c the cutting plane: the caps
        add nothing.
        """
        for axis in range(3):
            if np.isfinite(self.low[axis]) and np.isfinite(self.high[axis]):
                continue
            plane = self.low[axis] if np.isfinite(self.low[axis]) else self.high[axis]
            plane = plane if np.isfinite(plane) else 0.0
            corners = self.triangles
            area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            return float(np.sum((corners[:, :, axis].mean(axis=1) - plane) * area[:, axis]))
        return None

    @cached_property
    def points(self) -> Array:
        """Distinct points (P, 3) whose hull covers the cell's part of the mesh, in lexicographic
        order (`np.unique` of rows takes four times as long).
        """
        parts = [self.triangles.reshape(-1, 3), *(cap.reshape(-1, 3) for cap in self.caps)]
        rows = np.concatenate(parts)
        rows = rows[np.lexsort(rows.T[::-1])]
        first = np.ones(len(rows), dtype=bool)
        first[1:] = (rows[1:] != rows[:-1]).any(axis=1)
        return np.asarray(rows[first])


def mesh_pieces(mesh: Mesh, max_pieces: int = 64, tolerance_m: float = 0.004) -> tuple[Shape, ...]:
    """Convex pieces (at most `max_pieces`) that cover `mesh`.

    A cell is cut while that promises to save more volume than a slab of `tolerance_m` over its two
    largest sides: about how far a piece may stand off the mesh. Pieces with many corners are
    replaced by simpler ones around them, at most half the tolerance or 0.5 % of their size larger.
    """
    heap: list[tuple[float, int, _Cell, tuple[_Cell, _Cell] | None]] = []
    count = 0

    def push(cell: _Cell) -> None:
        nonlocal count
        gain, halves = _best_cut(cell, mesh.watertight)
        size = np.sort(np.ptp(cell.points, axis=0))
        worth = halves is not None and gain > tolerance_m * size[1] * size[2]
        heapq.heappush(heap, (-gain if worth else 0.0, count, cell, halves if worth else None))
        count += 1

    push(_Cell(mesh.vertices_m[mesh.faces], ()))
    while len(heap) < max_pieces and heap[0][3] is not None:
        halves = heapq.heappop(heap)[3]
        assert halves is not None
        for half in halves:
            push(half)
    cells = [item[2] for item in sorted(heap, key=lambda item: item[1])]
    pieces = []
    for cell in cells:
        points = cell.points
        slack = max(0.5 * tolerance_m, 0.005 * float(np.linalg.norm(np.ptp(points, axis=0))))
        pieces.append(convex_shape(points, slack_m=slack))
    return tuple(pieces)


def split_by_plane(mesh: Mesh, normal: Array, offset: float) -> tuple[Mesh | None, Mesh | None]:
    """The parts of `mesh` with n·x <= offset and n·x >= offset (None if empty).

    Both are closed with a fan over the cut, which is exact where the cut is star-shaped.
    """
    cell = _Cell(mesh.vertices_m[mesh.faces], ())
    parts: list[Mesh | None] = []
    halves = _cut(cell, np.asarray(normal, dtype=float), offset, mesh.watertight)
    for half, turn in zip(halves, (1, -1), strict=True):
        if len(half.triangles) == 0:
            parts.append(None)
            continue
        soup = [half.triangles]
        for cap in half.caps:
            hub = np.broadcast_to(cap.reshape(-1, 3).mean(axis=0), (len(cap), 3))
            soup.append(np.stack([hub, cap[:, 0], cap[:, 1]], axis=1)[:, ::turn])
        vertices, index = np.unique(
            np.concatenate(soup).reshape(-1, 3), axis=0, return_inverse=True
        )
        faces = index.reshape(-1, 3)
        parts.append(Mesh(vertices, faces, is_watertight(faces)))
    return parts[0], parts[1]


def _best_cut(cell: _Cell, solid: bool) -> tuple[float, tuple[_Cell, _Cell] | None]:
    """The axis-parallel cut that saves most hull volume, and the volume [m³] worth saving.

    A first cut of a ring saves nothing, so the worth is what the hull holds beyond the solid; the
    cut that saves most at once is made, or the longest side is halved if none does.
    """
    points = cell.points
    whole = _hull_volume(points)
    if whole <= 0.0:
        return 0.0, None
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    longest = int(np.argmax(size))
    best, chosen = 0.02 * whole, (longest, float(low[longest] + 0.5 * size[longest]))
    most = 0.0
    for axis in range(3):
        for fraction in _FRACTIONS:
            offset = float(low[axis] + fraction * size[axis])
            cut = _crossings(cell, axis, offset)
            below = np.concatenate([points[points[:, axis] <= offset], cut])
            above = np.concatenate([points[points[:, axis] >= offset], cut])
            gain = whole - _hull_volume(below) - _hull_volume(above)
            most = max(most, gain)
            if gain > best:
                best, chosen = gain, (axis, offset)
    held = cell.solid_volume() if solid else None
    worth = most if held is None else max(most, whole - held)
    halves = _cut(cell, np.eye(3)[chosen[0]], chosen[1], solid)
    if min(len(half.points) for half in halves) < 3:
        return 0.0, None
    axis, plane = chosen
    first = replace(halves[0], low=cell.low, high=_with(cell.high, axis, plane))
    second = replace(halves[1], low=_with(cell.low, axis, plane), high=cell.high)
    return worth, (first, second)


def _with(values: tuple[float, ...], axis: int, value: float) -> tuple[float, ...]:
    return (*values[:axis], value, *values[axis + 1 :])


def _crossings(cell: _Cell, axis: int, offset: float) -> Array:
    """Where the surface crosses the plane (for scoring only)."""
    height = cell.triangles[:, :, axis] - offset
    crossing = (height.min(axis=1) <= 0) & (height.max(axis=1) > 0)
    if not crossing.any():
        return np.zeros((0, 3))
    return _cut_points(cell.triangles[crossing], height[crossing])[0].reshape(-1, 3)


def _hull_volume(points: Array) -> float:
    """Volume of the hull, from extremes along fixed directions where there are many points."""
    if len(points) > 400:
        chosen = np.unique(
            np.concatenate(
                [
                    np.argmax(points @ _DIRECTIONS.T, axis=0),
                    np.argmin(points @ _DIRECTIONS.T, axis=0),
                    np.argmax(points, axis=0),
                    np.argmin(points, axis=0),
                ]
            )
        )
        points = points[chosen]
    if len(points) < 4:
        return 0.0
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _later(a: Array, b: Array) -> Array:
    """Whether rows of a (K, 3) come after rows of b in lexicographic order."""
    result = np.zeros(len(a), dtype=bool)
    tied = np.ones(len(a), dtype=bool)
    for axis in range(3):
        result |= tied & (a[:, axis] > b[:, axis])
        tied &= a[:, axis] == b[:, axis]
    return result


def _between(a: Array, b: Array, ha: Array, hb: Array) -> Array:
    """Points (K, 3) of the edges a–b at height 0; the same for a–b and b–a, to the last bit."""
    swap = _later(a, b)
    a, b = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
    ha, hb = np.where(swap, hb, ha), np.where(swap, ha, hb)
    return a + (ha / (ha - hb))[:, None] * (b - a)


def _cut_points(soup: Array, height: Array) -> tuple[Array, Array]:
    """For crossing triangles (T, 3, 3): the two cut points (T, 2, 3) and the lone corner (T,)."""
    above = height > 0
    # The corner that stands alone on its side; corners on the plane count as below.
    lone = np.where(above.sum(axis=1) == 1, np.argmax(above, axis=1), np.argmin(above, axis=1))
    rows = np.arange(len(soup))
    ends = []
    for step in (1, 2):
        other = (lone + step) % 3
        ends.append(
            _between(soup[rows, lone], soup[rows, other], height[rows, lone], height[rows, other])
        )
    return np.stack(ends, axis=1), lone


def _cut(cell: _Cell, normal: Array, offset: float, solid: bool) -> tuple[_Cell, _Cell]:
    """The halves below and above the plane n·x = offset, with their caps if `solid`."""
    halves, segments = _cut_triangles(cell.triangles, normal, offset)
    if not solid:
        return _Cell(halves[0], ()), _Cell(halves[1], ())
    caps: tuple[list[Array], list[Array]] = ([], [])
    for cap in cell.caps:
        parts, inner = _cut_cap(cap, normal, offset)
        for side in (0, 1):
            if len(parts[side]):
                caps[side].append(parts[side])
        segments = np.concatenate([segments, inner])
    if len(segments):
        caps[0].append(segments)
        caps[1].append(segments)
    return _Cell(halves[0], tuple(caps[0])), _Cell(halves[1], tuple(caps[1]))


def _cut_triangles(soup: Array, normal: Array, offset: float) -> tuple[tuple[Array, Array], Array]:
    """Triangles below and above, and the segments (S, 2, 3) in which the plane cuts them."""
    height = soup @ normal - offset
    above = height.min(axis=1) > 0
    crossing = ~above & (height.max(axis=1) > 0)
    parts: tuple[list[Array], list[Array]] = ([soup[~above & ~crossing]], [soup[above]])
    cross, level = soup[crossing], height[crossing]
    if not len(cross):
        return (parts[0][0], parts[1][0]), np.zeros((0, 2, 3))
    ends, lone = _cut_points(cross, level)
    rows = np.arange(len(cross))
    corner = cross[rows, lone]
    second, third = cross[rows, (lone + 1) % 3], cross[rows, (lone + 2) % 3]
    tip = np.stack([corner, ends[:, 0], ends[:, 1]], axis=1)
    quad = (
        np.stack([ends[:, 0], second, third], axis=1),
        np.stack([ends[:, 0], third, ends[:, 1]], axis=1),
    )
    is_above = level[rows, lone] > 0
    for side, chosen in ((0, ~is_above), (1, is_above)):
        parts[side].append(tip[chosen])
        parts[1 - side].extend(part[chosen] for part in quad)
    # Seen from above the plane the solid lies to one side of each directed segment.
    directed = np.where(is_above[:, None, None], ends, ends[:, ::-1])
    return (np.concatenate(parts[0]), np.concatenate(parts[1])), directed


def _cut_cap(cap: Array, normal: Array, offset: float) -> tuple[tuple[Array, Array], Array]:
    """Cap edges (E, 2, 3) below and above, both closed, and the closing segments inside."""
    height = cap @ normal - offset
    above, below = height.min(axis=1) > 0, height.max(axis=1) <= 0
    crossing = ~above & ~below
    if not crossing.any():
        return (cap[below], cap[above]), np.zeros((0, 2, 3))
    edge, level = cap[crossing], height[crossing]
    cut = _between(edge[:, 0], edge[:, 1], level[:, 0], level[:, 1])
    first_above = level[:, 0] > 0
    upper = np.stack([np.where(first_above[:, None], edge[:, 0], edge[:, 1]), cut], axis=1)
    lower = np.stack([np.where(first_above[:, None], edge[:, 1], edge[:, 0]), cut], axis=1)
    # Along the line of both planes the polygon is entered and left in turn.
    order = np.argsort(cut[:, int(np.argmax(np.ptp(cut, axis=0)))], kind="stable")
    inner = cut[order][: 2 * (len(cut) // 2)].reshape(-1, 2, 3)
    return (
        (np.concatenate([cap[below], lower, inner]), np.concatenate([cap[above], upper, inner])),
        inner,
    )
