"""Triangles from STL and OBJ files, read by us so that a broken file is a fault, not a surprise."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

Triangles = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]
_TRIMESH_FAULTS = (
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    struct.error,
    OSError,
    EOFError,
    ImportError,
    NotImplementedError,
    AssertionError,
    OverflowError,
)


class MeshSyntaxError(ValueError):
    """The file is not what its name says; `code` is the stable code of the fault."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


def read_triangles(path: Path) -> Triangles:
    """Vertices (V, 3) in the file's unit and faces (F, 3); equal vertices are merged.

    STL (binary, text) and OBJ are read here, GLB and PLY by trimesh. Raises `MeshSyntaxError`.
    """
    kind = path.suffix.lower()
    content = path.read_bytes()
    if not content:
        raise MeshSyntaxError("mesh-empty", "a file of 0 bytes")
    if kind == ".stl":
        soup = _stl(content)
        faces = np.arange(len(soup)).reshape(-1, 3)
    elif kind == ".obj":
        soup, faces = _obj(content)
    else:
        soup, faces = _other(path)
    if len(faces) == 0:
        raise MeshSyntaxError("mesh-empty", "no triangle")
    if faces.min() < 0 or faces.max() >= len(soup):
        raise MeshSyntaxError("mesh-index", f"a face names vertex {faces.max()} of {len(soup)}")
    vertices, inverse = np.unique(soup, axis=0, return_inverse=True)
    return vertices, inverse.reshape(-1)[faces].astype(np.int64)


def _stl(content: bytes) -> npt.NDArray[np.float64]:
    if len(content) >= 84:
        count = struct.unpack("<I", content[80:84])[0]
        if len(content) == 84 + 50 * count:
            records = np.frombuffer(content, dtype=np.uint8, offset=84).reshape(count, 50)
            values = np.ascontiguousarray(records[:, 12:48]).view("<f4").reshape(-1, 3)
            return values.astype(np.float64)
    if content.lstrip()[:5].lower() == b"solid" and b"facet" in content[:4096]:
        return _text_stl(content)
    if len(content) < 84:
        raise MeshSyntaxError("mesh-truncated", f"{len(content)} bytes: shorter than an STL header")
    raise MeshSyntaxError(
        "mesh-truncated",
        f"header promises {count} triangles ({84 + 50 * count} bytes), file has {len(content)}",
    )


def _text_stl(content: bytes) -> npt.NDArray[np.float64]:
    text = content.decode("latin-1")
    if "endsolid" not in text:
        raise MeshSyntaxError("mesh-truncated", "text STL without endsolid")
    rows = [line.split()[1:] for line in text.splitlines() if line.strip().startswith("vertex")]
    try:
        soup = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise MeshSyntaxError("mesh-syntax", f"vertex line: {error}") from error
    if len(soup) == 0:
        raise MeshSyntaxError("mesh-empty", "no triangle")
    if soup.ndim != 2 or soup.shape[1] != 3 or len(soup) % 3:
        raise MeshSyntaxError("mesh-syntax", f"{len(soup)} vertex lines do not make triangles")
    return soup


def _obj(content: bytes) -> Triangles:
    points: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(content.decode("latin-1").splitlines(), start=1):
        words = line.split()
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                points.append([float(word) for word in words[1:4]])
                if len(words) < 4:
                    raise ValueError("fewer than three coordinates")
            else:
                corner = [int(word.split("/")[0]) for word in words[1:]]
                corner = [c - 1 if c > 0 else len(points) + c for c in corner]
                faces += [(corner[0], corner[i], corner[i + 1]) for i in range(1, len(corner) - 1)]
        except ValueError as error:
            raise MeshSyntaxError("mesh-syntax", f"line {number}: {error}") from error
    return (
        np.array(points, dtype=np.float64).reshape(-1, 3),
        np.array(faces, dtype=np.int64).reshape(-1, 3),
    )


def _other(path: Path) -> Triangles:
    try:
        loaded = trimesh.load(path, force="mesh", process=False)
        return (
            np.array(loaded.vertices, dtype=np.float64).reshape(-1, 3),
            np.array(loaded.faces, dtype=np.int64).reshape(-1, 3),
        )
    except _TRIMESH_FAULTS as error:
        raise MeshSyntaxError("mesh-syntax", f"{type(error).__name__}: {error}"[:200]) from error


def write_binary_stl(path: Path, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
    """Write a binary STL (normals computed, same bytes for the same triangles)."""
    corners = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)].astype("<f4")
    edges = corners.astype(np.float64)
    normal = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    record = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attr", "<u2")]
    )
    record["normal"], record["corners"] = np.round(normal, 5) + 0.0, corners
    header = b"dmoc generated mesh, unit metre".ljust(80, b" ")
    path.write_bytes(header + struct.pack("<I", len(record)) + record.tobytes())
