"""What a mesh may be: present, inside its folder, complete, finite, in a believable unit."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array, StaysReadonly, readonly
from dmoc.errors import MeshError
from dmoc.input_file import confined
from dmoc.robot.description import LinkShape, Three
from dmoc.robot.robot import Robot
from planning.geometry.mesh_file import OWN_UNIT, MeshSyntaxError, read_triangles

UNITS = {"m": 1.0, "mm": 1e-3}
_KINDS = (".stl", ".obj", ".glb", ".ply", *OWN_UNIT)
_MOST_BYTES = 300_000_000
#: Bounding-box diagonals [m] that a part or tool of a station can have.
_DIAGONAL_M = (0.005, 60.0)
#: The same of a robot's link.
_LINK_DIAGONAL_M = (0.002, 15.0)


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
    path = confined(relative, folder, file, field)
    fix = f"write unit: {'mm' if unit == 'm' else 'm'} if that is the unit it was drawn in"
    how = f"with unit: {unit}"
    if path.suffix.lower() in OWN_UNIT and unit != "m":
        fix = "DAE, 3MF and STEP say their own unit: write unit: m"
        raise MeshError.of("mesh-unit", file, field, f"{relative} {how}", "m", fix)
    if path.suffix.lower() in OWN_UNIT:
        fix = "the file says its own unit: export it again in the right one"
    scale = UNITS[unit]
    return _read(path, relative, (scale, scale, scale), _DIAGONAL_M, how, fix, file, field)


def load_link_mesh(shape: LinkShape, file: str, field: str) -> Mesh:
    """The triangles of a robot link's mesh in the shape's frame, its scale applied.

    Errors: `MeshError` as of `load_mesh`.
    """
    assert shape.mesh is not None
    how = f"with scale {' '.join(f'{factor:g}' for factor in shape.scale)}"
    fix = 'say in the URDF what one of its units is: scale="0.001 0.001 0.001" for millimetres'
    try:
        changed = shape.mesh.stat().st_mtime_ns
    except OSError:
        changed = 0
    return _read_link(shape.mesh, shape.scale, changed, how, fix, file, field)


def shape_fingerprint(robot: Robot) -> str:
    """sha256 of the links' collision shapes: sizes, triangles and places, no file names.

    Dynamics don't see shapes, so `Robot.fingerprint` leaves them out.
    """
    digest = hashlib.sha256(repr(sorted(robot.allowed_collisions)).encode())
    for item in robot.link_shapes():
        digest.update(f"{item.link}|{item.joint}|{item.shape.kind}|{item.shape.size_m}".encode())
        digest.update(item.placement.homogeneous.tobytes())
        if item.shape.kind == "mesh":
            mesh = load_link_mesh(item.shape, str(robot.urdf), f"link {item.link}")
            digest.update(mesh.vertices_m.tobytes() + mesh.faces.tobytes())
    return digest.hexdigest()


@lru_cache(maxsize=128)
def _read_link(
    path: Path, scale: Three, changed_ns: int, how: str, fix: str, file: str, field: str
) -> Mesh:
    return _read(path, path.name, scale, _LINK_DIAGONAL_M, how, fix, file, field)


def _read(
    path: Path,
    name: str,
    scale: Three,
    across_m: tuple[float, float],
    how: str,
    fix: str,
    file: str,
    field: str,
) -> Mesh:
    def refuse(code: str, value: str, legal: str, fix: str) -> MeshError:
        return MeshError.of(code, file=file, field=field, value=value, legal=legal, fix=fix)

    if not path.is_file():
        raise refuse("mesh-missing", name, "an existing file", "check the name of the file")
    if path.suffix.lower() not in _KINDS:
        raise refuse("mesh-kind", path.suffix, ", ".join(_KINDS), "export it as STL or OBJ")
    size = path.stat().st_size
    if size > _MOST_BYTES:
        raise refuse("mesh-large", f"{size} bytes", f"<= {_MOST_BYTES}", "reduce the mesh")
    try:
        vertices, faces = read_triangles(path)
    except MeshSyntaxError as error:
        value, legal = f"{name}: {error}", "a complete mesh file"
        raise refuse(error.code, value, legal, error.fix) from error
    except OSError as error:
        raise refuse("mesh-missing", str(error), "a readable file", "check its rights") from error
    wrong = int(np.sum(~np.isfinite(vertices).all(axis=1)))
    if wrong:
        value = f"{wrong} vertices of {name} are NaN or infinite"
        raise refuse("mesh-nan", value, "finite numbers", "export the mesh again")
    vertices = vertices * np.array(scale)
    if np.prod(scale) < 0:  # a mirror image: its faces look inwards
        faces = faces[:, ::-1]
    diagonal = float(np.linalg.norm(np.ptp(vertices[faces.ravel()], axis=0)))
    if not across_m[0] <= diagonal <= across_m[1]:
        value = f"{name} is {diagonal:.4g} m across {how}"
        raise refuse("mesh-unit", value, f"{across_m[0]:g} m to {across_m[1]:g} m across", fix)
    corners = vertices[faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if not np.any(np.linalg.norm(sides, axis=1) > 0):
        value = f"every triangle of {name} has zero area"
        raise refuse("mesh-empty", value, "a surface", "export the mesh again")
    return Mesh(vertices, faces, is_watertight(faces))


def is_watertight(faces: npt.NDArray[np.int64]) -> bool:
    """Whether every directed edge is matched by exactly one opposite edge."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward, count = np.unique(edges, axis=0, return_counts=True)
    if np.any(count != 1):
        return False
    return bool(np.array_equal(forward, np.unique(edges[:, ::-1], axis=0)))
