"""Convex pieces of a mesh, remembered between runs by the mesh's content."""

from __future__ import annotations

import hashlib
import os
import zipfile
from pathlib import Path

import numpy as np

from dmoc.codegen import cache_folder
from planning.convex import convex_shape
from planning.decompose import mesh_pieces
from planning.mesh_gate import Mesh
from planning.shapes import Shape

__all__ = ["cached_pieces"]

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
        found = [np.asarray(piece.vertices_m) for piece in
                 mesh_pieces(mesh, MAX_PIECES, TOLERANCE_M)]  # fmt: skip
        _write(path, found)
    # Both ways end in the same hulls, so a cached run equals a fresh one.
    return tuple(convex_shape(vertices) for vertices in found)


def _read(path: Path) -> list[np.ndarray] | None:
    try:
        with np.load(path, allow_pickle=False) as data:
            rows, counts = data["vertices_m"], data["counts"]
        if rows.ndim != 2 or rows.shape[1] != 3 or counts.sum() != len(rows) or counts.min() < 4:
            return None
        return np.split(rows, np.cumsum(counts)[:-1])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None  # absent or damaged: cut again


def _write(path: Path, vertices: list[np.ndarray]) -> None:
    part = path.with_name(f"{path.stem}.{os.getpid()}.npz")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(part, vertices_m=np.concatenate(vertices),
                 counts=np.array([len(rows) for rows in vertices]))  # fmt: skip
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)  # no place for a cache: the next run cuts again
