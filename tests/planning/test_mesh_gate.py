"""What a mesh file may be: every broken one has a code, and nothing else is ever raised."""

import struct

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dmoc.errors import DmocError
from planning.geometry.mesh import is_watertight, load_mesh
from planning.geometry.mesh_file import write_binary_stl

BOX = trimesh.creation.box((0.4, 0.6, 0.8))


def stl(folder, vertices=BOX.vertices, faces=BOX.faces):
    write_binary_stl(folder / "part.stl", vertices, faces)
    return (folder / "part.stl").read_bytes()


def code_of(folder, name="part.stl", unit="m"):
    with pytest.raises(DmocError) as caught:
        load_mesh(name, folder, unit, "station.yaml", "obstacles[0].mesh")
    fault = caught.value.faults[0]
    assert fault.file == "station.yaml"
    assert fault.field == "obstacles[0].mesh"
    assert fault.legal
    assert fault.fix
    return fault.code


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply", "glb"])
def test_formats_agree(tmp_path, kind):
    name = "part." + kind.removesuffix("_ascii")
    BOX.export(tmp_path / name, file_type=kind)
    mesh = load_mesh(name, tmp_path, "m")
    assert mesh.vertices_m.shape == (8, 3)
    assert mesh.watertight
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([0.4, 0.6, 0.8])


def stl_dialects():
    text = BOX.export(file_type="stl_ascii")
    binary = BOX.export(file_type="stl")
    solid = "solid part\n" + text.split("\n", 1)[1]
    yield "upper case", solid.upper().encode()
    yield "blank before", b"\n \t" + solid.encode()
    yield "byte order mark", b"\xef\xbb\xbf" + solid.encode()
    yield "blank tail", solid.encode() + b"\n" * 900
    yield "two words", solid.replace("end", "end ").replace("end solid", "end solid x").encode()
    yield "old Mac", solid.replace("\n", "\r").encode()
    yield "one line", " ".join(solid.split()).encode()
    yield "facet in the name", solid.replace("solid part", "solid a facet of it", 1).encode()
    half = solid.splitlines()
    first, second = half[: 1 + 7 * 6], half[1 + 7 * 6 :]
    yield "two solids", "\n".join([*first, "endsolid part", "solid rest", *second]).encode()
    yield "binary, header of text", b"solid of 12 facet normals".ljust(80) + binary[80:]
    yield "binary, odd tail", binary + b"\r\n"
    yield "binary, blank tail", binary + bytes(200)


@pytest.mark.parametrize(("name", "content"), stl_dialects(), ids=[n for n, _ in stl_dialects()])
def test_every_dialect_of_stl_is_the_same_box(tmp_path, name, content):
    (tmp_path / "part.stl").write_bytes(content)
    mesh = load_mesh("part.stl", tmp_path, "m")
    assert len(mesh.faces) == 12
    assert mesh.watertight
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([0.4, 0.6, 0.8])


def test_a_lost_facet_is_never_read_over(tmp_path):
    binary, text = BOX.export(file_type="stl"), BOX.export(file_type="stl_ascii")
    fewer = binary[:80] + struct.pack("<I", 11) + binary[84:]
    for content in (fewer, text.replace("vertex", "vertx", 1).encode(),
                    text.replace("endfacet", "", 1).encode(),
                    text.replace("facet normal", "facet", 1).encode()):  # fmt: off
        (tmp_path / "part.stl").write_bytes(content)
        assert code_of(tmp_path) in ("mesh-truncated", "mesh-syntax")
    ply = BOX.export(file_type="ply", encoding="ascii")
    (tmp_path / "part.ply").write_bytes(b"\n".join(ply.splitlines()[:-2]))
    assert code_of(tmp_path, "part.ply") in ("mesh-truncated", "mesh-syntax")


def test_millimetres(tmp_path):
    stl(tmp_path, 1000 * BOX.vertices)
    mesh = load_mesh("part.stl", tmp_path, "mm")
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([0.4, 0.6, 0.8])
    assert code_of(tmp_path, unit="m") == "mesh-unit"
    stl(tmp_path)
    assert code_of(tmp_path, unit="mm") == "mesh-unit"


def test_open_and_turned_meshes_are_not_watertight():
    assert is_watertight(BOX.faces)
    assert not is_watertight(BOX.faces[1:])
    turned = BOX.faces.copy()
    turned[0] = turned[0, ::-1]
    assert not is_watertight(turned)


def test_broken_files(tmp_path):
    good = stl(tmp_path)
    path = tmp_path / "part.stl"
    for content, code in (
        (b"", "mesh-empty"),
        (good[:-7], "mesh-truncated"),
        (good[:50], "mesh-truncated"),
        (good + good[84:134], "mesh-truncated"),
        (b"\0" * 80 + struct.pack("<I", 0), "mesh-empty"),
        (b"solid x\nfacet normal 0 0 1\nvertex 0 0 0\n", "mesh-truncated"),
        (b"solid x\nfacet\nvertex 0 a 0\nendsolid", "mesh-syntax"),
        (b"solid x\nfacet\nvertex 0 0 0\nendsolid", "mesh-syntax"),
        (good[:96] + struct.pack("<f", np.nan) + good[100:], "mesh-nan"),
    ):
        path.write_bytes(content)
        assert code_of(tmp_path) == code, content[:20]
    flat = np.zeros((3, 3))
    flat[1, 0] = flat[2, 0] = 1.0
    stl(tmp_path, flat, [[0, 1, 2]])
    assert code_of(tmp_path) == "mesh-empty"
    for text, code in (
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "mesh-index"),
        ("v 0 0 x\n", "mesh-syntax"),
        ("# nothing\n", "mesh-empty"),
    ):
        (tmp_path / "part.obj").write_text(text)
        assert code_of(tmp_path, "part.obj") == code
    for name in ("part.glb", "part.ply"):
        (tmp_path / name).write_bytes(good)
        assert code_of(tmp_path, name) == "mesh-syntax"


def test_places(tmp_path):
    stl(tmp_path)
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "link.stl").symlink_to(tmp_path / "part.stl")
    assert code_of(tmp_path / "inner", "../part.stl") == "path-outside"
    assert code_of(tmp_path / "inner", "link.stl") == "path-outside"
    assert code_of(tmp_path, str(tmp_path.parent / "part.stl")) == "path-outside"
    assert code_of(tmp_path, "none.stl") == "mesh-missing"
    assert code_of(tmp_path, "inner") == "mesh-missing"
    (tmp_path / "part.step").write_text("ISO")
    assert code_of(tmp_path, "part.step") == "mesh-kind"


@given(st.data())
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_mutated_files_never_raise_anything_else(tmp_path, data):
    kind = data.draw(st.sampled_from(["stl", "stl_ascii", "obj", "ply", "glb"]))
    content = (
        bytearray(BOX.export(file_type=kind), "utf-8")
        if kind in ("stl_ascii", "obj")
        else bytearray(BOX.export(file_type=kind))
    )
    start = data.draw(st.integers(0, len(content) - 1))
    size = data.draw(st.integers(0, 30))
    content[start : start + size] = data.draw(st.binary(max_size=30))
    name = "part." + kind.removesuffix("_ascii")
    (tmp_path / name).write_bytes(bytes(content))
    try:
        mesh = load_mesh(name, tmp_path, "m")
    except DmocError:
        return
    assert np.all(np.isfinite(mesh.vertices_m))
