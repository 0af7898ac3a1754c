"""What a mesh file may be: every broken one has a code, and nothing else is ever raised."""

import struct
import zipfile

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
    (tmp_path / "part.iges").write_text("ISO")
    assert code_of(tmp_path, "part.iges") == "mesh-kind"


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


def three_mf(folder, build='<item objectid="2"/>', unit='unit="inch"', change=("", "")):
    """A box of 0.4, 0.6, 0.8 units as a component that is moved."""
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in BOX.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in BOX.faces)
    text = (
        f'<model {unit} xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f'<resources><object id="1"><mesh><vertices>{points}</vertices>'
        f'<triangles>{faces}</triangles></mesh></object><object id="2"><components>'
        '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 10 0 0"/></components></object>'
        f"</resources><build>{build}</build></model>"
    )
    assert change[0] in text
    with zipfile.ZipFile(folder / "part.3mf", "w") as archive:
        archive.writestr("3D/3dmodel.model", text.replace(*change, 1))


@pytest.mark.parametrize(("unit", "metres", "grown"), [('unit="inch"', 0.0254, 1), ("", 1e-3, 100)])
def test_a_3mf_says_its_unit_and_places(tmp_path, unit, metres, grown):
    matrix = f"{grown} 0 0 0 {grown} 0 0 0 {grown} 0 5 0"
    three_mf(tmp_path, unit=unit, build=f'<item objectid="2" transform="{matrix}"/>')
    mesh = load_mesh("part.3mf", tmp_path, "m")
    assert mesh.watertight
    centre = mesh.vertices_m.mean(axis=0)
    assert centre == pytest.approx([10 * grown * metres, 5 * metres, 0], abs=1e-9)
    # A quarter turn about z, rows times the matrix: x goes to y.
    across = np.array([0.6, 0.4, 0.8]) * grown * metres
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx(across)


def test_a_mirrored_3mf_stays_outside_out(tmp_path):
    three_mf(tmp_path, build='<item objectid="2" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>')
    mesh = load_mesh("part.3mf", tmp_path, "m")
    assert trimesh.Trimesh(mesh.vertices_m, mesh.faces).volume > 0


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (("<build>", "<built>"), "mesh-syntax"),
        (('unit="inch"', 'unit="mile"'), "mesh-syntax"),
        (('objectid="1"', 'objectid="2"'), "mesh-syntax"),
        (('objectid="1"', 'objectid="7"'), "mesh-syntax"),
        (('objectid="1"', 'p:path="/3D/o.model" objectid="1" xmlns:p="p"'), "mesh-syntax"),
        (("0 1 0 -1 0", "0 1 0 -1_0"), "mesh-syntax"),
        (("0 1 0 -1 0", "0 1 0"), "mesh-syntax"),
        (('v1="', 'v1="9'), "mesh-index"),
        (('<vertex x="', '<vertex x="nan'), "mesh-syntax"),
        (('<item objectid="2"/>', ""), "mesh-empty"),
        (("<model", "<!DOCTYPE a [<!ENTITY b 'c'>]><model"), "mesh-syntax"),
    ],
)
def test_a_broken_3mf_is_refused(tmp_path, change, code):
    three_mf(tmp_path, change=change)
    assert code_of(tmp_path, "part.3mf") == code


def test_what_says_its_own_unit_is_not_scaled(tmp_path):
    three_mf(tmp_path)
    assert code_of(tmp_path, "part.3mf", "mm") == "mesh-unit"
    (tmp_path / "part.3mf").write_bytes(b"PK no archive")
    assert code_of(tmp_path, "part.3mf") == "mesh-syntax"


QUADS = (
    ((0, 2, 3, 1), (0, 0, -1)),
    ((4, 5, 7, 6), (0, 0, 1)),
    ((0, 1, 5, 4), (0, -1, 0)),
    ((2, 6, 7, 3), (0, 1, 0)),
    ((0, 4, 6, 2), (-1, 0, 0)),
    ((1, 3, 7, 5), (1, 0, 0)),
)


def box_step(x_mm, y_mm, z_mm):
    """A box as a STEP file (AP214): planes, lines and points."""
    rows, edges = [], {}

    def add(kind, *values):
        rows.append(f"#{len(rows) + 1}={kind}({','.join(values)});")
        return f"#{len(rows)}"

    def row(text):
        rows.append(f"#{len(rows) + 1}={text};")
        return f"#{len(rows)}"

    def triple(kind, values):
        return add(kind, "''", f"({','.join(f'{x:.1f}' for x in values)})")

    def place(origin, z, x):
        parts = [triple("CARTESIAN_POINT", origin), triple("DIRECTION", z), triple("DIRECTION", x)]
        return add("AXIS2_PLACEMENT_3D", "''", *parts)

    points = [(i * x_mm, j * y_mm, k * z_mm) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    corners = [add("VERTEX_POINT", "''", triple("CARTESIAN_POINT", p)) for p in points]

    def edge(i, j):
        if (j, i) in edges:
            return edges[j, i], ".F."
        along = np.subtract(points[j], points[i]) / np.linalg.norm(
            np.subtract(points[j], points[i])
        )
        vector = add("VECTOR", "''", triple("DIRECTION", along), "1.")
        line = add("LINE", "''", triple("CARTESIAN_POINT", points[i]), vector)
        edges[i, j] = add("EDGE_CURVE", "''", corners[i], corners[j], line, ".T.")
        return edges[i, j], ".T."

    faces = []
    for loop, normal in QUADS:
        ends = zip(loop, loop[1:] + loop[:1])
        sides = [add("ORIENTED_EDGE", "''", "*", "*", *edge(i, j)) for i, j in ends]
        bound = add("FACE_OUTER_BOUND", "''", add("EDGE_LOOP", "''", f"({','.join(sides)})"), ".T.")
        plane = add("PLANE", "''", place(points[loop[0]], normal, np.roll(np.abs(normal), 1)))
        faces.append(add("ADVANCED_FACE", "''", f"({bound})", plane, ".T."))
    solid = add("MANIFOLD_SOLID_BREP", "''", add("CLOSED_SHELL", "''", f"({','.join(faces)})"))
    length = row("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")
    angle = row("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
    room = row(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle})) REPRESENTATION_CONTEXT('',''))"
    )
    axes = place((0, 0, 0), (0, 0, 1), (1, 0, 0))
    shape = add("ADVANCED_BREP_SHAPE_REPRESENTATION", "''", f"({axes},{solid})", room)
    use = add("APPLICATION_CONTEXT", "'design'")
    product = add(
        "PRODUCT", "'b'", "'b'", "''", f"({add('PRODUCT_CONTEXT', chr(39) * 2, use, '$')})"
    )
    formed = add("PRODUCT_DEFINITION_FORMATION", "''", "''", product)
    stage = add("PRODUCT_DEFINITION_CONTEXT", "''", use, "'design'")
    defined = add("PRODUCT_DEFINITION", "''", "''", formed, stage)
    add(
        "SHAPE_DEFINITION_REPRESENTATION",
        add("PRODUCT_DEFINITION_SHAPE", "''", "''", defined),
        shape,
    )
    head = "ISO-10303-21;HEADER;FILE_DESCRIPTION((''),'2;1');FILE_NAME('','',(''),(''),'','','');"
    head += "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));ENDSEC;DATA;"
    return "\n".join([head, *rows, "ENDSEC;END-ISO-10303-21;"])


def test_a_step_part_is_meshed_in_metres(tmp_path):
    pytest.importorskip("cascadio")
    (tmp_path / "part.step").write_text(box_step(100, 200, 300))
    mesh = load_mesh("part.step", tmp_path, "m")
    assert np.ptp(mesh.vertices_m, axis=0) == pytest.approx([0.1, 0.2, 0.3], abs=1e-6)
    assert mesh.watertight
    (tmp_path / "part.step").write_text("ISO-10303-21; nothing")
    assert code_of(tmp_path, "part.step") in ("mesh-syntax", "mesh-empty")


def test_step_without_its_package_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr("planning.geometry.mesh_file.find_spec", lambda name: None)
    (tmp_path / "part.stp").write_text("ISO-10303-21;")
    with pytest.raises(DmocError) as caught:
        load_mesh("part.stp", tmp_path, "m")
    (fault,) = caught.value.faults
    assert "cascadio" in fault.value
    assert "dmoc[step]" in fault.fix


def test_a_3mf_of_endless_components_ends(tmp_path):
    rows = "".join(
        f'<object id="{k}"><components>{f"""<component objectid="{k + 1}"/>""" * 3}</components>'
        "</object>"
        for k in range(40)
    )
    text = (
        f'<model><resources>{rows}<object id="40"/></resources><build><item objectid="0"/></build>'
    )
    with zipfile.ZipFile(tmp_path / "part.3mf", "w") as archive:
        archive.writestr("3D/3dmodel.model", f"{text}</model>")
    assert code_of(tmp_path, "part.3mf") == "mesh-syntax"
