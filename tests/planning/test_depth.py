"""The compiled penetration depth against exact facets of the difference, coal, and search."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from dmoc.jit import njit
from planning.collision.coal_engine import CoalEngine
from planning.collision.kernels import depth as inner
from planning.geometry.shapes import Shape
from tests.planning.test_engines import Pair, random_pose, random_shape


@njit
def overlap_depth(solids, pose, a, b, grown, out, normal):
    """The inner kernel, called from Python."""
    inner.overlap_depth(solids, pose, a, b, grown, out, normal)


@njit
def signed_distance(solids, pose, a, b, axis, above, s, grown, out, normal):
    """The inner kernel, called from Python."""
    return inner.signed_distance(solids, pose, a, b, axis, above, s, grown, out, normal)


def depth(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    out, normal = np.full(8, np.nan), np.full(3, np.nan)
    overlap_depth(pair.solids, pair.pose, 0, 1, inner.grown_workspace(), out, normal)
    return out, normal


def signed(pair: Pair) -> tuple[float, np.ndarray]:
    out, normal = np.empty(8), np.empty(3)
    assert signed_distance(
        pair.solids,
        pair.pose,
        0,
        1,
        np.zeros(3),
        1e9,
        np.empty((4, 15)),
        inner.grown_workspace(),
        out,
        normal,
    )
    return float(out[0]), normal


@pytest.mark.parametrize("kinds", [("box", "box"), ("box", "convex"), ("convex", "convex")])
def test_polytopes_against_the_facets_of_their_difference(kinds: tuple[str, str]) -> None:
    rng = np.random.default_rng(11)
    deep = 0
    for _ in range(60):
        pair = Pair(
            tuple(random_shape(rng, kind) for kind in kinds),
            (random_pose(rng, 0.2), random_pose(rng, 0.2)),
        )
        difference = pair.points(0)[:, None] - pair.points(1)[None]
        planes = ConvexHull(difference.reshape(-1, 3)).equations
        exact = float(-planes[:, 3].max())  # least offset of a facet; negative: apart
        if exact <= 1e-6:
            continue
        deep += 1
        out, normal = depth(pair)
        assert out[0] == pytest.approx(-exact, abs=1e-9)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
        assert normal @ (out[4:7] - out[1:4]) == pytest.approx(out[0], abs=1e-12)
        assert signed(pair)[0] == pytest.approx(-exact, abs=1e-9)
    assert deep > 15


def support(pair: Pair, n: np.ndarray) -> float:
    """h(n) of A − B straight from the shapes' sizes."""
    total = 0.0
    for i, sign in ((0, 1.0), (1, -1.0)):
        piece = pair.pieces[i]
        d = sign * piece.pose[:3, :3].T @ n
        if piece.kind == "box":
            reach = np.abs(d) @ np.array(piece.size_m) / 2
        elif piece.kind == "sphere":
            reach = piece.size_m[0]
        elif piece.kind == "cylinder":
            reach = piece.size_m[0] * np.hypot(d[0], d[1]) + abs(d[2]) * piece.size_m[1] / 2
        else:
            reach = np.max(piece.vertices_m @ d)
        total += reach + sign * n @ piece.pose[:3, 3]
    return float(total)


def test_all_kinds_against_a_search_of_directions() -> None:
    """No direction separates with less, and coal's own direction does not either.

    (coal itself is off by up to 0.5 m for a sphere whose centre lies in a cylinder.)
    """
    rng = np.random.default_rng(3)
    kinds = ("box", "sphere", "cylinder", "convex")
    deep = 0
    for k in range(400):
        pair = Pair(
            (random_shape(rng, kinds[k % 4]), random_shape(rng, kinds[(k // 4) % 4])),
            (random_pose(rng, 0.25), random_pose(rng, 0.25)),
        )
        distance, normal = signed(pair)
        if distance > -1e-6:
            continue
        deep += 1
        assert support(pair, normal) == pytest.approx(-distance, abs=2e-9)
        reference = CoalEngine(pair.pieces).distance(0, 1, pair.pose[0], pair.pose[1])
        best, at = support(pair, reference.normal), normal
        for step in (1e-1, 1e-2, 1e-3):
            for turn in rng.normal(size=(100, 3)):
                tried = (at + step * turn) / np.linalg.norm(at + step * turn)
                if support(pair, tried) < best:
                    best, at = support(pair, tried), tried
        assert -distance < best + 2e-6
    assert deep > 150


def test_moving_out_along_the_normal_separates() -> None:
    rng = np.random.default_rng(9)
    kinds = ("box", "sphere", "cylinder", "convex")
    for k in range(200):
        pair = Pair(
            (random_shape(rng, kinds[k % 4]), random_shape(rng, kinds[(k // 4) % 4])),
            (random_pose(rng, 0.1), random_pose(rng, 0.1)),
        )
        distance, normal = signed(pair)
        if distance >= 0:
            continue
        for start in (9, 12):  # position and centre of piece b
            pair.pose[1, start : start + 3] += (1e-6 - distance) * normal
        assert signed(pair)[0] > 0.0


@pytest.mark.parametrize(
    ("shapes", "exact"),
    [
        ((Shape("sphere", (0.3,)), Shape("sphere", (0.2,))), 0.5),
        ((Shape("sphere", (0.3,)), Shape("box", (0.2, 0.4, 0.6))), 0.4),
        ((Shape("box", (1.0, 1.0, 1.0)), Shape("box", (0.2, 0.2, 0.2))), 0.6),
        ((Shape("cylinder", (0.1, 2.0)), Shape("sphere", (0.05,))), 0.15),
    ],
)
def test_concentric_pieces(shapes: tuple[Shape, Shape], exact: float) -> None:
    """Where everything is symmetric and every direction but a few is a tie."""
    distance, normal = signed(Pair(shapes, (np.eye(4), np.eye(4))))
    assert distance == pytest.approx(-exact, rel=2e-4)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
