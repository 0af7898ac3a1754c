"""Pieces cover: the surface of any mesh, the inside of a watertight one, the authored prisms."""

import numpy as np
import pytest
import trimesh

from authoring.stations import underbody
from dmoc.errors import MeshError
from planning.geometry.convex import (
    convex_shape,
    cover_gap_m,
    read_pieces,
    sample_surface,
    write_pieces,
)
from planning.geometry.decompose import cached_pieces, mesh_pieces, split_by_plane
from planning.geometry.mesh import Mesh, is_watertight
from planning.geometry.nearest import body_distance_m, triangle_distance_m
from planning.geometry.shapes import Body, Shape
from tests.naive.inside import inside


def mesh_of(shape):
    return Mesh(np.array(shape.vertices), np.array(shape.faces), is_watertight(shape.faces))


def bracket():
    """An L-shaped solid without overlaps: a polygon pushed up."""
    outline = np.array([[0, 0], [1, 0], [1, 0.2], [0.2, 0.2], [0.2, 1], [0, 1]])
    cap = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    low = np.column_stack([outline, np.zeros(6)])
    high = low + [0, 0, 0.3]
    sides = []
    for i in range(6):
        j = (i + 1) % 6
        sides += [[i, j, j + 6], [i, j + 6, i + 6]]
    faces = np.concatenate([cap[:, ::-1], cap + 6, sides])
    return Mesh(np.concatenate([low, high]), faces, is_watertight(faces))


def cavity():
    """A block with a hollow inside: most cells of it never see the outer surface."""
    outer, inner = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.4, 0.5, 0.3))
    vertices = np.concatenate([outer.vertices, inner.vertices + 0.05])
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)])
    return Mesh(vertices, faces, is_watertight(faces))


SOLIDS = {
    "cavity": cavity,
    "torus": lambda: mesh_of(trimesh.creation.torus(0.3, 0.1)),
    "bracket": bracket,
    "pipe": lambda: mesh_of(trimesh.creation.annulus(0.2, 0.3, 0.5)),
    "sphere": lambda: mesh_of(trimesh.creation.icosphere(subdivisions=3, radius=0.3)),
    "sheet": lambda: Mesh(*underbody.mesh(), True),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_pieces_cover_surface_and_inside(name):
    mesh = SOLIDS[name]()
    assert mesh.watertight
    pieces = mesh_pieces(mesh, max_pieces=32)
    assert cover_gap_m(pieces, sample_surface(mesh, 4000, seed=1)).max() < 1e-9
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    points = np.random.default_rng(2).uniform(low, high, (300, 3))
    held = points[inside(mesh.vertices_m, mesh.faces, points)]
    if len(held):
        assert cover_gap_m(pieces, held).max() < 1e-9


def test_pieces_stay_near_a_ring():
    """One hull would fill the hole; the pieces leave it open."""
    mesh = SOLIDS["torus"]()
    pieces = mesh_pieces(mesh)
    assert len(pieces) > 8
    hole = np.random.default_rng(0).normal(size=(200, 3))
    hole *= 0.17 / np.linalg.norm(hole, axis=1, keepdims=True)
    hole[:, 2] *= 0.2
    assert cover_gap_m(pieces, hole).min() > 0.005


def test_a_convex_mesh_is_one_piece():
    assert len(mesh_pieces(SOLIDS["sphere"]())) == 1


def test_halves_of_a_split_block_are_closed():
    block = mesh_of(trimesh.creation.box((1, 1, 1)))
    halves = split_by_plane(block, np.array([0, 0, 1.0]), 0.1)
    for half, volume in zip(halves, (0.6, 0.4), strict=True):
        assert half is not None
        assert half.watertight
        solid = trimesh.Trimesh(half.vertices_m, half.faces, process=False)
        assert solid.volume == pytest.approx(volume)
    whole, nothing = split_by_plane(block, np.array([0, 0, 1.0]), 2.0)
    assert whole is not None
    assert nothing is None


def test_authored_prisms_cover_the_sheet_and_stay_near_it():
    vertices, faces = underbody.mesh()
    assert is_watertight(faces)
    pieces = [convex_shape(points) for _, points in underbody.prisms()]
    mesh = Mesh(vertices, faces, True)
    assert cover_gap_m(pieces, sample_surface(mesh, 20_000, seed=3)).max() < 1e-5
    rng = np.random.default_rng(4)
    x, y = rng.uniform(1.12, 2.70, 4000), rng.uniform(-1.22, 1.22, 4000)
    above = np.stack([x, y, underbody.height_m(x, y) + 0.0045], axis=1)
    # 4.5 mm above the sheet no prism is left; on steep ramps that is nearer than 4.5 mm.
    assert cover_gap_m(pieces, above).min() > -1e-9
    below = np.stack([x, y, rng.uniform(0.745, underbody.height_m(x, y))], axis=1)
    assert cover_gap_m(pieces, below).max() < 1e-5


def test_mesh_is_the_height_field_with_its_studs():
    vertices, _ = underbody.mesh()
    top = vertices[: len(vertices) // 2]
    assert np.allclose(top[:, 2], underbody.height_m(top[:, 0], top[:, 1]), atol=1e-6)
    assert underbody.height_m(np.array(1.727), np.array(0.1)) == pytest.approx(0.9018, abs=1e-4)
    assert underbody.height_m(np.array(2.073), np.array(-0.15)) == pytest.approx(0.9267, abs=5e-4)


def test_flat_sets_get_a_thickness():
    piece = convex_shape([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert np.ptp(piece.vertices_m[:, 2]) == pytest.approx(1e-3)
    line = convex_shape([[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.2, 0, 0]])
    assert np.all(np.ptp(line.vertices_m, axis=0) > 5e-4)


def test_simplified_hulls_only_grow():
    points = np.random.default_rng(5).normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    simple = convex_shape(points, slack_m=0.03)
    assert len(simple.vertices_m) < 1000
    assert cover_gap_m([simple], points).max() < 1e-9
    assert np.linalg.norm(simple.vertices_m, axis=1).max() < 1.05


def test_hull_triangles_point_outwards():
    piece = convex_shape(np.random.default_rng(6).normal(size=(50, 3)))
    corners = piece.vertices_m[piece.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) - piece.vertices_m.mean(axis=0)
    assert np.all(np.einsum("ij,ij->i", normal, outward) > 0)


def test_piece_files(tmp_path):
    points = np.random.default_rng(7).normal(size=(12, 3))
    write_pieces(tmp_path / "p.obj", [("one", points), ("two", points + 3)])
    pieces = read_pieces(tmp_path / "p.obj", 1.0, "s", "pieces")
    assert cover_gap_m(pieces, np.concatenate([points, points + 3])).max() < 2e-6
    for text in ("v 0 0 0\n", "o a\nv 0 0\n", "o a\nv 0 0 0\n", "", "o a\nv 0 nan 0\n"):
        (tmp_path / "p.obj").write_text(text)
        with pytest.raises(MeshError, match="pieces-syntax"):
            read_pieces(tmp_path / "p.obj", 1.0, "s", "pieces")


def test_cached_pieces_equal_fresh_ones_and_survive_damage(tmp_path, monkeypatch):
    monkeypatch.setenv("DMOC_CACHE", str(tmp_path))
    mesh = SOLIDS["bracket"]()
    fresh = cached_pieces(mesh)
    (file,) = (tmp_path / "pieces").iterdir()
    again = cached_pieces(mesh)
    file.write_bytes(file.read_bytes()[:100])
    damaged = cached_pieces(mesh)
    for other in (again, damaged):
        assert all(
            np.array_equal(a.vertices_m, b.vertices_m) for a, b in zip(fresh, other, strict=True)
        )


def test_distance_to_bodies_against_sampling():
    rng = np.random.default_rng(8)
    tri = rng.normal(size=(5, 3, 3))
    weights = rng.dirichlet(np.ones(3), size=40_000)
    for point in rng.normal(size=(5, 3)):
        sampled = [np.linalg.norm(weights @ t - point, axis=1).min() for t in tri]
        exact = triangle_distance_m(tri, point)
        assert np.all(exact <= np.array(sampled) + 1e-12)
        assert exact == pytest.approx(sampled, abs=0.03)
    for kind, size, point, expected in (
        ("box", (2.0, 2.0, 2.0), [2, 0, 0], 1.0),
        ("sphere", (1.0,), [0, 3, 0], 2.0),
        ("cylinder", (1.0, 2.0), [0, 0, 3], 2.0),
        ("cylinder", (1.0, 2.0), [0.5, 0, 0], 0.0),
    ):
        body = Body("b", (Shape(kind, size),))
        assert body_distance_m(body, np.array(point, dtype=float)) == pytest.approx(expected)
