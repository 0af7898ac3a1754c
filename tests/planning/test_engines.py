"""The compiled distance against exhaustive search, coal and fcl."""

import numpy as np
import pytest

from planning.collision.coal_engine import CoalEngine
from planning.collision.fcl_engine import FclEngine
from planning.collision.kernels.distance import FAR, HIT, SOLVED, clearly_farther, gjk, outer_bound
from planning.collision.packed import pack_solids
from planning.collision.pieces import piece_of
from planning.geometry.shapes import Shape, pose_matrix
from tests.naive.convex_distance import polytope_distance

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def random_pose(rng: np.random.Generator, spread: float) -> np.ndarray:
    turn = rng.normal(size=4)
    return pose_matrix(rng.uniform(-spread, spread, 3), turn / np.linalg.norm(turn))


def random_shape(rng: np.random.Generator, kind: str) -> Shape:
    if kind == "convex":
        points = rng.normal(size=(rng.integers(5, 60), 3)) * rng.uniform(0.02, 0.5, 3)
        return Shape("convex", vertices_m=points)
    size = {"box": 3, "cylinder": 2, "sphere": 1}[kind]
    return Shape(kind, tuple(10 ** rng.uniform(-2, 0, size)))


class Pair:
    """Two pieces at random poses, measured by the kernel and by the engines."""

    def __init__(self, shapes: tuple[Shape, Shape], poses: tuple[np.ndarray, np.ndarray]) -> None:
        self.pieces = [piece_of(s, n, 1, p) for s, n, p in zip(shapes, "ab", poses)]
        self.solids = pack_solids(self.pieces)
        self.pose = np.zeros((2, 15))
        self.pose[:, :12] = self.solids.frame
        turn = self.solids.frame[:, :9].reshape(2, 3, 3)
        centre = np.einsum("pij,pj->pi", turn, self.solids.size[:, 6:9])
        self.pose[:, 12:] = self.solids.frame[:, 9:] + centre

    def kernel(self, above: float = 1e9, below: float = -1e9) -> tuple[int, np.ndarray, np.ndarray]:
        out, axis = np.zeros(8), np.zeros(3)
        status = gjk(self.solids, self.pose, 0, 1, axis, above, below, np.zeros((4, 15)), out)
        return status, out, axis

    def points(self, i: int) -> np.ndarray:
        piece = self.pieces[i]
        local = piece.vertices_m if piece.kind == "convex" else CORNERS * np.array(piece.size_m) / 2
        return local @ piece.pose[:3, :3].T + piece.pose[:3, 3]


@pytest.mark.parametrize("kinds", [("box", "box"), ("box", "convex"), ("convex", "convex")])
def test_polytopes_against_exhaustive_search(kinds: tuple[str, str]) -> None:
    rng = np.random.default_rng(5)
    apart = 0
    for _ in range(25):
        shapes = tuple(
            Shape("convex", vertices_m=rng.normal(size=(7, 3)) * 0.2)
            if kind == "convex"
            else random_shape(rng, kind)
            for kind in kinds
        )
        pair = Pair(shapes, (random_pose(rng, 0.5), random_pose(rng, 0.5)))
        truth = polytope_distance(pair.points(0), pair.points(1))
        status, out, axis = pair.kernel()
        if truth > 1e-9:
            apart += 1
            assert status == SOLVED
            assert out[0] == pytest.approx(truth, abs=1e-9)
            assert out[7] == pytest.approx(truth, abs=1e-9)
            # Distance, points and normal tell the same story.
            assert np.allclose(out[4:7] - out[1:4], -axis * truth, atol=1e-8)
        else:
            assert status == HIT
    assert apart > 5


def test_all_kinds_against_coal_and_fcl() -> None:
    """1,500 random pairs: coal agrees to its own tolerance, fcl to half a millimetre."""
    rng = np.random.default_rng(7)
    kinds = ("box", "sphere", "cylinder", "convex")
    worst = {"coal": 0.0, "fcl": 0.0}
    for k in range(1500):
        pair_kinds = (kinds[k % 4], kinds[(k // 4) % 4])
        pair = Pair(
            tuple(random_shape(rng, kind) for kind in pair_kinds),
            (random_pose(rng, 0.6), random_pose(rng, 0.6)),
        )
        status, out, _ = pair.kernel()
        coal = CoalEngine(pair.pieces).distance(0, 1, pair.pose[0], pair.pose[1])
        fcl = FclEngine(pair.pieces)
        if abs(coal.distance_m) < 1e-5:
            continue
        assert (out[0] > 0 and status == SOLVED) == (coal.distance_m > 0) or out[0] < 0
        assert fcl.touches(0, 1, pair.pose[0], pair.pose[1]) == (coal.distance_m < 0)
        assert out[7] <= out[0] + 1e-12
        if coal.distance_m > 0:
            assert status == SOLVED
            assert outer_bound(pair.pose, pair.solids.size, 0, 1) <= out[0] + 1e-9
            worst["coal"] = max(worst["coal"], abs(out[0] - coal.distance_m))
            other = fcl.distance(0, 1, pair.pose[0], pair.pose[1]).distance_m
            worst["fcl"] = max(worst["fcl"], abs(out[0] - other))
    assert worst["coal"] < 3e-6
    assert worst["fcl"] < 1e-3


def test_thresholds_are_proven() -> None:
    """FAR only where the distance really exceeds `above`, HIT only where it is below `below`."""
    rng = np.random.default_rng(11)
    for k in range(400):
        kinds = ("box", "sphere", "cylinder", "convex")
        pair = Pair(
            (random_shape(rng, kinds[k % 4]), random_shape(rng, kinds[(k // 4) % 4])),
            (random_pose(rng, 0.6), random_pose(rng, 0.6)),
        )
        status, out, _ = pair.kernel()
        if status != SOLVED:
            continue
        truth = out[0]
        for limit in (truth - 1e-3, truth + 1e-3):
            decided, bounds, _ = pair.kernel(limit, limit)
            assert decided == (FAR if limit < truth else HIT)
            assert bounds[7] <= truth + 1e-9
            farther = clearly_farther(pair.pose, pair.solids.size, 0, 1, limit)
            assert not (farther and truth <= limit)


def test_sphere_inside_box_has_negative_distance() -> None:
    shapes = (Shape("box", (1.0, 1.0, 1.0)), Shape("sphere", (0.1,)))
    pair = Pair(shapes, (np.eye(4), pose_matrix((0.2, 0.0, 0.0))))
    assert pair.kernel()[0] == HIT
    for engine in (CoalEngine(pair.pieces), FclEngine(pair.pieces)):
        found = engine.distance(0, 1, pair.pose[0], pair.pose[1])
        assert found.distance_m == pytest.approx(-0.4, abs=1e-6)
        assert found.distance_m == pytest.approx(
            found.normal @ (found.point_b - found.point_a), abs=1e-6
        )


def test_touching_faces_and_equal_centres_do_not_break_the_iteration() -> None:
    unit = Shape("box", (1.0, 1.0, 1.0))
    for at, truth in (((1.0, 0, 0), 0.0), ((1.0 + 1e-7, 0, 0), 1e-7), ((2.0, 1.0, 1.0), 1.0)):
        status, out, _ = Pair((unit, unit), (np.eye(4), pose_matrix(at))).kernel()
        assert status in (SOLVED, HIT)
        assert out[0] == pytest.approx(truth, abs=1e-9)
    assert Pair((unit, unit), (np.eye(4), np.eye(4))).kernel()[0] == HIT
