"""Triangles from mesh files, read in Python so that a broken file is a fault, not a surprise."""

from __future__ import annotations

import io
import re
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import trimesh

#: Kinds that say their own unit: they are read in metres.
OWN_UNIT = (".dae", ".3mf", ".step", ".stp")

Triangles = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]
_FILE_FAULTS = (
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
    NameError,
    OverflowError,
    SyntaxError,
    RecursionError,
)


class MeshSyntaxError(ValueError):
    """The file is not what its name says; `code` is the stable code of the fault."""

    def __init__(self, code: str, message: str, fix: str = "export the mesh again") -> None:
        super().__init__(message)
        self.code, self.fix = code, fix


def read_triangles(path: Path) -> Triangles:
    """Vertices (V, 3) in the file's unit (DAE, 3MF, STEP: in metres) and faces (F, 3).

    Equal vertices are merged. STL (binary, text), OBJ and 3MF are read here, DAE by pycollada, GLB
    and PLY by trimesh: all in Python, where a broken file cannot take the process along. A DAE's
    up_axis is ignored, as other tools do for robots. STEP is meshed by cascadio, where that is
    installed, in a process of its own. Raises `MeshSyntaxError`.
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
    elif kind == ".dae":
        soup, faces = _dae(content)
    elif kind == ".3mf":
        soup, faces = _3mf(content)
    elif kind in (".step", ".stp"):
        soup, faces = _step(path)
    else:
        soup, faces = _other(path)
    if kind == ".ply" and len(faces) < (promised := _ply_faces(content)):
        raise MeshSyntaxError("mesh-truncated", f"{len(faces)} faces of {promised}")
    if len(faces) == 0:
        raise MeshSyntaxError("mesh-empty", "no triangle")
    if faces.min() < 0 or faces.max() >= len(soup):
        raise MeshSyntaxError("mesh-index", f"a face names vertex {faces.max()} of {len(soup)}")
    vertices, inverse = np.unique(soup, axis=0, return_inverse=True)
    return vertices, inverse.reshape(-1)[faces].astype(np.int64)


def _stl(content: bytes) -> npt.NDArray[np.float64]:
    """Corners (3F, 3). Text cannot pass for binary: four letters promise 500 million triangles.

    After the records there may be a few bytes or a blank tail, but no further record: then the
    number in the header is wrong.
    """
    count = struct.unpack("<I", content[80:84])[0] if len(content) >= 84 else 0
    tail = len(content) - 84 - 50 * count
    if count > 0 and (0 <= tail < 50 or (tail > 0 and not content[-tail:].strip(b"\0 \t\r\n"))):
        records = np.frombuffer(content, np.uint8, 50 * count, 84).reshape(count, 50)
        values = np.ascontiguousarray(records[:, 12:48]).view("<f4").reshape(-1, 3)
        return values.astype(np.float64)
    start = content.removeprefix(b"\xef\xbb\xbf").lstrip()
    if start[:5].lower() == b"solid" and b"\0" not in content.rstrip(b"\0"):
        return _text_stl(start)
    if len(content) < 84:
        raise MeshSyntaxError("mesh-truncated", f"{len(content)} bytes: shorter than an STL header")
    if count == 0 and tail == 0:
        raise MeshSyntaxError("mesh-empty", "no triangle")
    raise MeshSyntaxError(
        "mesh-truncated",
        f"header promises {count} triangles ({84 + 50 * count} bytes), file has {len(content)}",
    )


_FACET = "facet normal # # # outer loop vertex # # # vertex # # # vertex # # # endloop endfacet"


def _text_stl(content: bytes) -> npt.NDArray[np.float64]:
    """Every dialect: any case, any white space, one or several solids, `end solid` in two words."""
    text = re.sub(r"\bend[ \t]+(facet|loop|solid)\b", r"end\1", content.decode("latin-1").lower())
    lines = text.rstrip("\0 \t\r\n").splitlines()
    if not lines or "endsolid" not in lines[-1]:
        raise MeshSyntaxError("mesh-truncated", "text STL without endsolid")
    # A solid's name may hold any words: it ends with its line, or before the first facet.
    body = re.sub(r"(?m)^[ \t]*(end)?solid\b.*?(?=\bfacet[ \t]+normal\b|$)", "", "\n".join(lines))
    words = re.sub(r"\bendsolid\b.*$", "", body, flags=re.M).split()
    if not words:
        raise MeshSyntaxError("mesh-empty", "no triangle")
    pattern = np.array(_FACET.split())
    if len(words) % len(pattern):
        raise MeshSyntaxError("mesh-syntax", f"{len(words)} words do not make facets of 21")
    table = np.array(words).reshape(-1, len(pattern))
    fixed = pattern != "#"
    wrong = np.argwhere(table[:, fixed] != pattern[fixed])
    if len(wrong):
        row, column = wrong[0]
        found, wanted = table[:, fixed][row, column], pattern[fixed][column]
        raise MeshSyntaxError("mesh-syntax", f"facet {row + 1}: {found}, where {wanted} belongs")
    try:
        return table[:, [8, 9, 10, 12, 13, 14, 16, 17, 18]].astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise MeshSyntaxError("mesh-syntax", f"vertex: {error}") from error


def _dae(content: bytes) -> Triangles:
    """All triangles of the scene where it places them, in metres."""
    import collada

    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise MeshSyntaxError("mesh-syntax", "a document type declaration")
    skipped = [collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError]
    points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    try:
        file = collada.Collada(io.BytesIO(content), ignore=skipped)
        size = file.assetInfo.unitmeter or 1.0
        solids = file.scene.objects("geometry") if file.scene is not None else ()
        for primitive in (p for solid in solids for p in solid.primitives()):
            cut = getattr(primitive, "triangleset", None)  # of polygons
            triangles = primitive if cut is None else cut()
            if not isinstance(triangles, collada.triangleset.BoundTriangleSet):
                continue  # lines
            if triangles.vertex is None or triangles.vertex_index is None:
                continue
            points.append(np.asarray(triangles.vertex, dtype=np.float64).reshape(-1, 3) * size)
            faces.append(np.asarray(triangles.vertex_index, dtype=np.int64).reshape(-1, 3) + count)
            count += len(points[-1])
    except (collada.DaeError, *_FILE_FAULTS) as error:
        raise MeshSyntaxError("mesh-syntax", f"{type(error).__name__}: {error}"[:200]) from error
    if file.errors:
        raise MeshSyntaxError("mesh-syntax", f"{file.errors[0]}"[:200])
    return np.concatenate(points), np.concatenate(faces)


_3MF_UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2}
_3MF_UNITS |= {"inch": 0.0254, "foot": 0.3048, "meter": 1.0}
_MOST_XML_BYTES = 500_000_000
_MOST_PARTS = 10_000


def _3mf(content: bytes) -> Triangles:
    """The build items of the model in the archive, in metres by its unit (millimetres without)."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = [n for n in archive.namelist() if n.lower().endswith(".model")]
            if len(names) != 1:
                raise MeshSyntaxError("mesh-syntax", f"{len(names)} models in the archive, not 1")
            if archive.getinfo(names[0]).file_size > _MOST_XML_BYTES:
                raise MeshSyntaxError("mesh-large", f"more than {_MOST_XML_BYTES} bytes of XML")
            text = archive.read(names[0])
        if b"<!DOCTYPE" in text:
            raise MeshSyntaxError("mesh-syntax", "a document type in the model")
        root = ElementTree.fromstring(text)
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]
        scale = _3MF_UNITS[root.get("unit", "millimeter")]
        objects = {item.attrib["id"]: item for item in root.iterfind("resources/object")}
        parts: list[Triangles] = []
        for item in root.iterfind("build/item"):
            _3mf_object(objects, item, np.eye(4), (), parts)
    except MeshSyntaxError:
        raise
    except (*_FILE_FAULTS, zipfile.BadZipFile, zlib.error) as error:
        raise MeshSyntaxError("mesh-syntax", f"{type(error).__name__}: {error}"[:200]) from error
    if not parts:
        raise MeshSyntaxError("mesh-empty", "no build item")
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, starts)])
    return scale * np.concatenate([vertices for vertices, _ in parts]), faces


def _3mf_object(
    objects: dict[str, ElementTree.Element],
    named: ElementTree.Element,
    outer: npt.NDArray[np.float64],
    above: tuple[str, ...],
    parts: list[Triangles],
) -> None:
    """Append what a build item or component names; rows of vertices times the transform."""
    own = np.eye(4)
    if "transform" in named.attrib:
        own[:, :3] = np.array(_plain(named.attrib["transform"]).split(), float).reshape(4, 3)
    place, name = own @ outer, named.attrib["objectid"]
    if any(key.endswith("path") for key in named.attrib):
        raise MeshSyntaxError("mesh-syntax", "parts in other files of the archive")
    if name in above or len(parts) >= _MOST_PARTS:
        raise MeshSyntaxError("mesh-syntax", f"object {name} holds itself, or too many parts")
    for component in objects[name].iterfind("components/component"):
        _3mf_object(objects, component, place, (*above, name), parts)
    mesh = objects[name].find("mesh")
    if mesh is None:  # it counts as a part: an archive cannot name others without end
        parts.append((np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)))
        return
    points = [[float(_plain(v.attrib[k])) for k in "xyz"] for v in mesh.iterfind("vertices/vertex")]
    triangles = mesh.iterfind("triangles/triangle")
    corners = [[int(_plain(t.attrib[k])) for k in ("v1", "v2", "v3")] for t in triangles]
    vertices, faces = np.array(points).reshape(-1, 3), np.array(corners, dtype=np.int64)
    faces = faces.reshape(-1, 3)
    if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise MeshSyntaxError("mesh-index", f"a face names vertex {faces.max()} of {len(vertices)}")
    if np.linalg.det(place[:3, :3]) < 0:  # a mirror image: its faces look inwards
        faces = faces[:, ::-1]
    parts.append((vertices @ place[:3, :3] + place[3, :3], faces))


def _plain(number: str) -> str:
    """The text, unless Python alone would read a number in it (1_000)."""
    if "_" in number:
        raise ValueError(f"{number!r} is no number")
    return number


_MESH_STEP = "import sys, cascadio; sys.exit(cascadio.step_to_glb(*sys.argv[1:3], 0.1, 0.3))"


def _step(path: Path) -> Triangles:
    """Within 0.1 mm and 0.3 rad of the surfaces, in metres by the file's unit."""
    if find_spec("cascadio") is None:
        how = "pip install 'dmoc[step]', or export the part as STL, OBJ or 3MF"
        raise MeshSyntaxError("mesh-kind", "STEP needs the package cascadio, not installed", how)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "part.glb"
        command = [sys.executable, "-c", _MESH_STEP, str(path.resolve()), str(target)]
        done = subprocess.run(command, capture_output=True, check=False, cwd=folder)
        if done.returncode or not target.is_file():
            words = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise MeshSyntaxError("mesh-syntax", f"cannot be meshed ({done.returncode}) {words}")
        return _other(target)


def _ply_faces(content: bytes) -> int:
    """The number of faces that a PLY file's header promises."""
    found = re.search(rb"element\s+face\s+(\d+)", content[:10_000])
    return 0 if found is None else int(found.group(1))


_MOST_CORNERS = 1 << 40


def _obj(content: bytes) -> Triangles:
    points: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    text = content.decode("latin-1").replace("\\\n", " ").replace("\\\r\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
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
                if any(abs(c) > _MOST_CORNERS for c in corner):
                    raise ValueError("a corner of a number that no file can hold")
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
    except _FILE_FAULTS as error:
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
