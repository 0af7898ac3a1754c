"""Particle swarm: walls, seeds, ask/tell, forbidden regions."""

import numpy as np
import pytest

from dmoc.errors import ProblemError
from dmoc.swarm import Swarm, SwarmParams, minimise

LOWER, UPPER = np.zeros(4), np.ones(4)
WALLS = ["invisible", "absorbing", "reflecting"]


def sphere(x: np.ndarray) -> np.ndarray:
    return ((x - 0.3) ** 2).sum(axis=1)


@pytest.mark.parametrize("wall", WALLS)
def test_finds_an_interior_minimum(wall: str) -> None:
    result = minimise(sphere, LOWER, UPPER, 1, SwarmParams(iterations=150, wall=wall))
    np.testing.assert_allclose(result.x, 0.3, atol=1e-3)


@pytest.mark.parametrize("wall", WALLS)
def test_finds_a_minimum_on_the_wall(wall: str) -> None:
    result = minimise(
        lambda x: x.sum(axis=1), LOWER, UPPER, 2, SwarmParams(iterations=200, wall=wall)
    )
    assert result.value < 0.05


@pytest.mark.parametrize("wall", WALLS)
def test_never_evaluates_outside_the_box(wall: str) -> None:
    seen: list[np.ndarray] = []

    def record(x: np.ndarray) -> np.ndarray:
        seen.append(x)
        return -x.sum(axis=1)

    minimise(record, LOWER, UPPER, 3, SwarmParams(wall=wall))
    points = np.concatenate(seen)
    assert (points >= 0).all()
    assert (points <= 1).all()


def test_same_seed_same_result_and_history_never_rises() -> None:
    first, second = (minimise(sphere, LOWER, UPPER, 7) for _ in range(2))
    np.testing.assert_array_equal(first.x, second.x)
    assert (np.diff(first.history) <= 0).all()
    assert not np.array_equal(first.x, minimise(sphere, LOWER, UPPER, 8).x)


def test_leaves_numpys_global_generator_alone() -> None:
    np.random.seed(0)  # noqa: NPY002
    expected = np.random.random()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    minimise(sphere, LOWER, UPPER, 7)
    assert np.random.random() == expected  # noqa: NPY002


def barrier(x: np.ndarray) -> np.ndarray:
    """Minimum at 0.9 behind a forbidden band; the start lies on the wrong side of it."""
    value = (x[:, 0] - 0.9) ** 2
    return np.where((x[:, 0] > 0.35) & (x[:, 0] < 0.45), np.inf, value)


def test_invisible_walls_cross_a_forbidden_band_that_absorbing_ones_do_not() -> None:
    start = 0.3 * np.random.default_rng(0).random((12, 1))
    reached = {}
    for wall in ("invisible", "absorbing"):
        params = SwarmParams(particles=12, iterations=60, wall=wall, max_step=0.15)
        runs = [
            minimise(barrier, np.zeros(1), np.ones(1), seed, params, start).value < 0.01
            for seed in range(20)
        ]
        reached[wall] = sum(runs)
    assert reached["invisible"] > reached["absorbing"]
    assert reached["invisible"] >= 15


def test_everything_forbidden_is_inf_not_an_error() -> None:
    result = minimise(lambda x: np.full(len(x), np.inf), LOWER, UPPER, 0)
    assert result.value == np.inf


def test_ask_tell_equals_minimise() -> None:
    params = SwarmParams(iterations=30)
    swarm = Swarm(LOWER, UPPER, 11, params)
    for _ in range(30):
        swarm.tell(sphere(swarm.ask()))
    whole = minimise(sphere, LOWER, UPPER, 11, params)
    np.testing.assert_array_equal(swarm.best_x, whole.x)
    assert swarm.evaluations == whole.evaluations


def test_misuse_is_refused() -> None:
    with pytest.raises(ProblemError, match="tell"):
        Swarm(LOWER, UPPER, 0).tell(np.zeros(3))
    with pytest.raises(ProblemError, match="lower"):
        Swarm(UPPER, LOWER, 0)
    with pytest.raises(ProblemError, match="wall"):
        SwarmParams(wall="brick")  # type: ignore[arg-type]
    swarm = Swarm(LOWER, UPPER, 0)
    swarm.ask()
    with pytest.raises(ProblemError, match="values"):
        swarm.tell(np.full(24, np.nan))


def test_each_coordinate_has_its_own_longest_step() -> None:
    seen: list[np.ndarray] = []
    swarm = Swarm(LOWER, UPPER, 0, SwarmParams(max_step=(0.01, 0.5, 0.01, 0.5), wall="absorbing"))
    for _ in range(30):
        seen.append(swarm.ask())
        swarm.tell(-seen[-1].sum(axis=1))
    steps = np.abs(np.diff(seen, axis=0)).max(axis=(0, 1))
    assert (steps[[0, 2]] <= 0.01 + 1e-12).all()
    assert (steps[[1, 3]] > 0.1).all()


def test_the_longest_step_may_be_given_in_the_units_of_the_box() -> None:
    box = np.array([10.0, 20.0])
    one = Swarm(-box, box, 3, SwarmParams(max_step=(0.1, 0.05)))
    two = Swarm(-box, box, 3, max_velocity=np.array([2.0, 2.0]))
    for swarm in (one, two):
        for _ in range(10):
            swarm.tell((swarm.ask() ** 2).sum(axis=1))
    np.testing.assert_allclose(one.best_x, two.best_x)


def test_particles_begin_with_the_velocities_given() -> None:
    start = np.full((24, 4), 0.5)
    velocity = np.zeros((24, 4))
    velocity[:, 1] = 0.1
    swarm = Swarm(LOWER, UPPER, 0, SwarmParams(inertia=1.0), start, velocity)
    np.testing.assert_array_equal(swarm.ask(), start)
    swarm.tell(np.zeros(24))  # all equal: nobody is drawn anywhere
    np.testing.assert_allclose(swarm.ask(), start + velocity)


def test_promising_points_are_those_better_than_the_particles_own() -> None:
    swarm = Swarm(LOWER, UPPER, 0)
    swarm.ask()
    swarm.tell(np.full(24, 2.0))
    points = swarm.ask()
    values = np.linspace(1.0, 3.0, len(points))
    np.testing.assert_array_equal(swarm.promising(values), values < 2.0)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"params": SwarmParams(max_step=(0.1, 0.2))}, "max_step"),
        ({"max_velocity": np.ones(3)}, "max_velocity"),
        ({"start": np.full((2, 4), np.nan)}, "start"),
        ({"start": np.zeros((2, 3))}, "start"),
        ({"start_velocity": np.zeros((2, 4))}, "start_velocity"),
    ],
)
def test_wrong_steps_and_starts_are_refused(changes, word) -> None:
    with pytest.raises(ProblemError, match=word):
        Swarm(LOWER, UPPER, 0, **changes)
    with pytest.raises(ProblemError, match="promising"):
        Swarm(LOWER, UPPER, 0).promising(np.zeros(24))
