"""What a mesh may be: present, inside its folder, complete, finite, in a believable unit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array, StaysReadonly, readonly
from dmoc.errors import Fault, MeshError
from dmoc.input_file import confined
from planning.geometry.mesh_file import MeshSyntaxError, read_triangles

UNITS = {"m": 1.0, "mm": 1e-3}
_KINDS = (".stl", ".obj", ".glb", ".ply")
_MOST_BYTES = 300_000_000
#: Bounding-box diagonals [m] that a part or tool of a station can have.
_DIAGONAL_M = (0.005, 60.0)


@dataclass(frozen=True)
class Mesh(StaysReadonly):
    """Triangles in metres: `vertices_m` (V, 3), `faces` (F, 3). `watertight`: closed, oriented."""

    vertices_m: Array
    faces: npt.NDArray[np.int64]
    watertight: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices_m", readonly(self.vertices_m, "vertices_m", 2))
        faces = np.array(self.faces, dtype=np.int64)
        faces.setflags(write=False)
        object.__setattr__(self, "faces", faces)


def load_mesh(
    relative: str, folder: Path, unit: Literal["m", "mm"], file: str = "", field: str = "mesh"
) -> Mesh:
    """The triangles of `folder/relative`, scaled to metres.

    Errors: `MeshError` (codes path-outside, mesh-missing, mesh-kind, mesh-large, mesh-empty,
    mesh-truncated, mesh-syntax, mesh-index, mesh-nan, mesh-unit) naming `file` and `field`.
    """

    def refuse(code: str, value: str, legal: str, fix: str) -> MeshError:
        return MeshError(Fault(code, file=file, field=field, value=value, legal=legal, fix=fix))

    path = confined(relative, folder, file, field)
    if not path.is_file():
        raise refuse("mesh-missing", relative, "an existing file", "check the name of the file")
    if path.suffix.lower() not in _KINDS:
        raise refuse("mesh-kind", path.suffix, ", ".join(_KINDS), "export it as STL or OBJ")
    if path.stat().st_size > _MOST_BYTES:
        raise refuse(
            "mesh-large", f"{path.stat().st_size} bytes", f"<= {_MOST_BYTES}", "reduce the mesh"
        )
    try:
        vertices, faces = read_triangles(path)
    except MeshSyntaxError as error:
        raise refuse(
            error.code, f"{relative}: {error}", "a complete mesh file", "export the mesh again"
        ) from error
    except OSError as error:
        raise refuse("mesh-missing", str(error), "a readable file", "check its rights") from error
    wrong = int(np.sum(~np.isfinite(vertices).all(axis=1)))
    if wrong:
        raise refuse(
            "mesh-nan",
            f"{wrong} vertices of {relative} are NaN or infinite",
            "finite numbers",
            "export the mesh again",
        )
    vertices = vertices * UNITS[unit]
    diagonal = float(np.linalg.norm(np.ptp(vertices[faces.ravel()], axis=0)))
    if not _DIAGONAL_M[0] <= diagonal <= _DIAGONAL_M[1]:
        other = "mm" if unit == "m" else "m"
        raise refuse(
            "mesh-unit",
            f"{relative} is {diagonal:.4g} m across with unit: {unit}",
            f"{_DIAGONAL_M[0]:g} m to {_DIAGONAL_M[1]:g} m across",
            f"write unit: {other} if that is the unit it was drawn in",
        )
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    if not np.any(area > 0):
        raise refuse(
            "mesh-empty",
            f"every triangle of {relative} has zero area",
            "a surface",
            "export the mesh again",
        )
    return Mesh(vertices, faces, is_watertight(faces))


def is_watertight(faces: npt.NDArray[np.int64]) -> bool:
    """Whether every directed edge is matched by exactly one opposite edge."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward, count = np.unique(edges, axis=0, return_counts=True)
    if np.any(count != 1):
        return False
    return bool(np.array_equal(forward, np.unique(edges[:, ::-1], axis=0)))
