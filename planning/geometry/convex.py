"""Convex pieces: hulls, authored piece files, and the check that pieces cover a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from dmoc.arrays import Array
from dmoc.errors import MeshError
from dmoc.input_file import content_of
from planning.geometry.mesh import Mesh
from planning.geometry.shapes import Shape

#: Half thickness [m] given to a flat piece, which would otherwise have no inside.
FLAT_M = 5e-4
#: Hulls with more corners than this are worth simplifying.
MANY_CORNERS = 60


def convex_shape(points: npt.ArrayLike, slack_m: float = 0.0) -> Shape:
    """The hull of `points` (V, 3) [m] as a convex shape; flat sets get a thickness of 1 mm.

    With `slack_m` > 0 a hull of many corners is replaced by a simpler polytope around it whose
    corners stand at most that far off.
    """
    cloud = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    try:
        hull = ConvexHull(cloud)
    except QhullError:
        cloud = _thicken(cloud)
        try:
            hull = ConvexHull(cloud)
        except QhullError as error:
            raise MeshError.of(
                "mesh-hull",
                field="vertices_m",
                value=str(error).split("\n")[0][:120],
                legal="points whose hull has a volume",
                fix="check the numbers: points that coincide, or sizes far apart, have none",
            ) from error
    if slack_m > 0 and len(hull.vertices) > MANY_CORNERS:
        cloud = _simpler_around(hull, slack_m)
        hull = ConvexHull(cloud)
    order = np.sort(hull.vertices)
    index = np.full(len(cloud), -1)
    index[order] = np.arange(len(order))
    faces = index[hull.simplices]
    vertices = cloud[order]
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Shape("convex", vertices_m=vertices, faces=faces)


def _thicken(cloud: Array) -> Array:
    """Copies of a flat cloud moved by ±FLAT_M along its thin directions."""
    centre = cloud.mean(axis=0)
    _, extent, axes = np.linalg.svd(cloud - centre, full_matrices=True)
    extent = np.concatenate([extent, np.zeros(3 - len(extent))])
    for axis, size in zip(axes, extent, strict=True):
        if size < 4 * FLAT_M:
            cloud = np.concatenate([cloud - FLAT_M * axis, cloud + FLAT_M * axis])
    return cloud


def _simpler_around(hull: ConvexHull, slack_m: float) -> Array:
    """Corners of a polytope around `hull`: half-spaces of its own faces, the next one below each
    corner that stands more than `slack_m` off, until none does or there are too many corners."""
    planes = np.unique(np.round(hull.equations, 6), axis=0)
    planes = planes[:: max(1, len(planes) // 1500)].copy()
    corners = hull.points[hull.vertices]
    # Rounded normals are no unit vectors and may cut into the hull: normalise, push out to touch.
    planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    planes[:, 3] = -np.max(corners @ planes[:, :3].T, axis=0)
    inside = corners.mean(axis=0)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    chosen = np.column_stack([axes, -np.max(corners @ axes.T, axis=0)])
    for _ in range(12):
        polytope = np.unique(HalfspaceIntersection(chosen, inside).intersections, axis=0)
        off = np.max(polytope @ planes[:, :3].T + planes[:, 3], axis=1)
        if off.max() <= slack_m:
            return polytope
        if len(polytope) >= len(corners):
            return corners
        far = polytope[off > slack_m]
        below = np.unique(np.argmax(far @ planes[:, :3].T + planes[:, 3], axis=1))
        chosen = np.unique(np.vstack([chosen, planes[below]]), axis=0)
    return corners


def read_pieces(path: Path, scale: float, file: str, field: str) -> tuple[Shape, ...]:
    """Convex pieces of an OBJ file with one object (`o NAME`) a piece: the hull of its vertices.

    Errors: `MeshError` pieces-syntax naming the line.
    """
    groups: list[list[list[float]]] = []

    def refuse(value: str, line: int | None) -> MeshError:
        return MeshError.of(
            "pieces-syntax",
            file=str(path),
            line=line,
            field=field,
            value=value,
            legal="OBJ: o NAME and at least four v X Y Z lines a piece",
            fix="export the pieces as separate objects of one OBJ file",
        )

    try:
        lines = content_of(path).decode("latin-1").splitlines()
    except OSError as error:
        raise MeshError.of(
            "mesh-missing",
            file=file,
            field=field,
            value=path.name,
            legal="an existing, readable file",
            fix="check the name",
        ) from error
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        if words[0] == "o":
            groups.append([])
        elif words[0] == "v":
            try:
                point = [float(word) * scale for word in words[1:4]]
            except ValueError as error:
                raise refuse(str(error), number) from error
            if len(point) != 3 or not groups or not np.all(np.isfinite(point)):
                raise refuse(line[:60], number)
            groups[-1].append(point)
    if not groups or any(len(group) < 4 for group in groups):
        raise refuse(f"{len(groups)} pieces, one of them with fewer than four points", None)
    return tuple(convex_shape(group) for group in groups)


def write_pieces(path: Path, pieces: Sequence[tuple[str, Any]]) -> None:
    """Write named pieces ((name, points (V, 3)), …) as OBJ, in micrometres precision."""
    lines = ["# dmoc convex pieces, unit metre"]
    count = 0
    for name, points in pieces:
        shape = convex_shape(np.round(points, 6))
        assert shape.vertices_m is not None
        assert shape.faces is not None
        lines.append(f"o {name}")
        lines += [
            "v " + " ".join(f"{value + 0.0:.6f}" for value in row) for row in shape.vertices_m
        ]
        lines += ["f " + " ".join(str(i + 1 + count) for i in face) for face in shape.faces]
        count += len(shape.vertices_m)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def sample_surface(mesh: Mesh, count: int, seed: int) -> Array:
    """`count` points spread by area over the triangles, and every vertex (count + V, 3)."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices_m[mesh.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = rng.choice(len(area), size=count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), size=count)
    points = np.einsum("ij,ijk->ik", weights, corners[chosen])
    return np.concatenate([points, mesh.vertices_m])


def cover_gap_m(pieces: Sequence[Shape], points: Array) -> Array:
    """How far each point (P, 3) lies outside the nearest piece's faces (P,); <= 0 is covered.

    For every piece the largest signed distance to its face planes; the minimum over the pieces.
    It is exact for covered points and never larger than the distance to the pieces outside.
    """
    gap = np.full(len(points), np.inf)
    for piece in pieces:
        assert piece.vertices_m is not None
        hull = ConvexHull(piece.vertices_m)
        planes = np.unique(np.round(hull.equations, 12), axis=0)
        local = (points - piece.pose[:3, 3]) @ piece.pose[:3, :3]
        outside = np.full(len(points), -np.inf)
        for plane in planes:
            np.maximum(outside, local @ plane[:3] + plane[3], out=outside)
        np.minimum(gap, outside, out=gap)
    return gap
