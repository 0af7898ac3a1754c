"""Convex pieces: hulls, authored piece files, and the check that pieces cover a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from dmoc.arrays import Array
from dmoc.errors import Fault, MeshError
from planning.mesh_gate import Mesh
from planning.shapes import Shape

__all__ = ["convex_shape", "cover_gap_m", "read_pieces", "sample_surface", "write_pieces"]

#: Half thickness [m] given to a flat piece, which would otherwise have no inside.
FLAT_M = 5e-4


def convex_shape(points: npt.ArrayLike, pose: Array | None = None) -> Shape:
    """The hull of `points` (V, 3) [m] as a convex shape; flat sets get a thickness of 1 mm."""
    cloud = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    try:
        hull = ConvexHull(cloud)
    except QhullError:
        cloud = _thicken(cloud)
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
    return Shape("convex", vertices_m=vertices, faces=faces,
                 pose=np.eye(4) if pose is None else pose)  # fmt: skip


def _thicken(cloud: Array) -> Array:
    """Copies of a flat cloud moved by ±FLAT_M along its thin directions."""
    centre = cloud.mean(axis=0)
    _, extent, axes = np.linalg.svd(cloud - centre, full_matrices=True)
    extent = np.concatenate([extent, np.zeros(3 - len(extent))])
    for axis, size in zip(axes, extent, strict=True):
        if size < 4 * FLAT_M:
            cloud = np.concatenate([cloud - FLAT_M * axis, cloud + FLAT_M * axis])
    return cloud


def read_pieces(path: Path, scale: float, file: str, field: str) -> tuple[Shape, ...]:
    """Convex pieces of an OBJ file with one object (`o NAME`) a piece: the hull of its vertices.

    Errors: `MeshError` pieces-syntax naming the line.
    """
    groups: list[list[list[float]]] = []

    def refuse(value: str, line: int | None) -> MeshError:
        return MeshError(
            Fault("pieces-syntax", file=str(path), line=line, field=field, value=value,
                  legal="OBJ: o NAME and at least four v X Y Z lines a piece",
                  fix="export the pieces as separate objects of one OBJ file")
        )  # fmt: skip

    try:
        lines = path.read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise MeshError(
            Fault("mesh-missing", file=file, field=field, value=path.name,
                  legal="an existing, readable file", fix="check the name")
        ) from error  # fmt: skip
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
        lines += ["v " + " ".join(f"{value + 0.0:.6f}" for value in row)
                  for row in shape.vertices_m]  # fmt: skip
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
        gap = np.minimum(gap, np.max(local @ planes[:, :3].T + planes[:, 3], axis=1))
    return gap
