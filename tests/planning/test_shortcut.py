"""Shortcuts: shorter, free, repeatable."""

from itertools import pairwise

import numpy as np

from planning.path.rrt_connect import shortcut


def outside_disc(p: np.ndarray, q: np.ndarray) -> bool:
    points = p + np.linspace(0, 1, 200)[:, None] * (q - p)
    return bool(np.all(np.linalg.norm(points, axis=1) > 1.0))


def length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def wiggle(seed: int) -> np.ndarray:
    """A wild path around the unit disc, from (−2, 0) to (2, 0)."""
    angle = np.linspace(np.pi, 0, 30)
    rng = np.random.default_rng(seed)
    radius = np.concatenate([[2.0], rng.uniform(1.3, 3.0, 28), [2.0]])
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def test_paths_get_shorter_and_stay_free() -> None:
    # Around a disc of radius 1 from (−2, 0) to (2, 0): two tangents and an arc.
    shortest = 2 * np.sqrt(3) + np.pi - 2 * np.arccos(0.5)
    for seed in range(10):
        path = wiggle(seed)
        short = shortcut(path, outside_disc, scale=np.ones(2), tries=300, seed=seed)
        assert np.array_equal(short[0], path[0])
        assert np.array_equal(short[-1], path[-1])
        assert all(outside_disc(p, q) for p, q in pairwise(short))
        assert length(short) <= length(path) + 1e-12
        assert shortest <= length(short) < 1.25 * shortest


def test_same_seed_same_path() -> None:
    runs = [
        shortcut(wiggle(1), outside_disc, scale=np.ones(2), tries=50, seed=s) for s in (4, 4, 5)
    ]
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_a_free_line_is_taken_at_once() -> None:
    calls = []

    def free(p: np.ndarray, q: np.ndarray) -> bool:
        calls.append(1)
        return True

    short = shortcut(wiggle(0), free, scale=np.ones(2), tries=100, seed=0)
    assert len(short) == 2
    assert len(calls) == 1


def test_no_tries_only_drops_knots() -> None:
    path = np.array([[0.0, 0], [1, 0], [2, 0], [3, 5]])
    blocked = shortcut(path, lambda p, q: False, scale=np.ones(2), tries=0, seed=0)
    assert np.array_equal(blocked, path)
