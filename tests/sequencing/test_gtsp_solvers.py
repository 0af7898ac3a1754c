"""Solvers against every tour, against each other and against proven optima."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import station_like
from dmoc.errors import ProblemError
from sequencing.gtsp import GtspProblem, Stop, held_karp_memory_bytes, run_gtsp_file, solve
from sequencing.gtsp import evolution as memetic
from sequencing.gtsp.bounded import bounded_dp
from sequencing.gtsp.held_karp_table import held_karp
from sequencing.gtsp.normalise import normal_form
from tests.naive.gtsp import brute_force, cost_of, random_problem

DATA = Path(os.environ.get("DMOC_DATA", Path(__file__).parents[3] / "shared" / "data")) / "gtsplib"


def assert_honest(problem, tour, optimum):
    """No tour better than the optimum, no bound above it, no false proof."""
    if tour.found:
        assert problem.faults(tour.nodes) == ()
        assert cost_of(problem, tour.nodes) == pytest.approx(tour.cost, abs=1e-9)
        assert tour.cost >= optimum - 1e-9
    else:
        assert tour.cost == math.inf
    assert tour.lower_bound <= optimum + 1e-9
    if tour.proven:
        assert tour.cost == pytest.approx(optimum, abs=1e-5)


@pytest.mark.parametrize("block", range(8))
def test_exact_methods_on_every_kind_of_problem(block):
    for seed in range(1000 + 40 * block, 1040 + 40 * block):
        problem = random_problem(seed)
        optimum = brute_force(problem)
        for method in ("held-karp", "auto"):
            tour = solve(problem, stop=200, seed=seed, method=method)
            assert tour.proven, seed
            assert_honest(problem, tour, optimum)


@pytest.mark.parametrize("block", range(8))
def test_bounded_dp_on_every_kind_of_problem(block):
    for seed in range(5000 + 25 * block, 5025 + 25 * block):
        problem = random_problem(seed)
        if problem.num_clusters == 1:
            continue
        form = normal_form(problem)
        if form.empty:
            continue
        optimum = brute_force(problem)
        nodes, bound = bounded_dp(form, math.inf, 1e-7, None, 1 << 28)
        assert bound <= optimum + 1e-6, seed
        if math.isinf(optimum):
            assert nodes is None
            assert bound == math.inf
        else:
            assert nodes is not None
            assert problem.tour_cost(form.lift(nodes)) == pytest.approx(optimum, abs=1e-6)
            assert bound == pytest.approx(optimum, abs=1e-5)


@pytest.mark.parametrize("block", range(4))
def test_bounded_dp_is_honest_below_any_cut_and_limit(block):
    """Every feature mixed, negative costs among them: a part of 2,000 cases run once."""
    for seed in range(20000 + 15 * block, 20015 + 15 * block):
        problem = random_problem(seed, clusters=4)
        form = normal_form(problem)
        if problem.num_clusters == 1 or form.empty:
            continue
        optimum = brute_force(problem)
        for upper in (math.inf, optimum, optimum + 7.0):
            for states in (None, 0, 1, 5):
                nodes, bound = bounded_dp(form, upper, 1e-7, states, 1 << 28)
                assert bound <= optimum + 1e-5, (seed, upper, states)
                if nodes is not None:
                    assert problem.tour_cost(form.lift(nodes)) >= optimum - 1e-6
                if states is None:
                    assert bound >= optimum - 1e-5, (seed, upper)
                    found = nodes is not None
                    assert found == (math.isfinite(optimum) and upper > optimum), (seed, upper)


@pytest.mark.parametrize("method", ["heuristic", "ruin-recreate"])
def test_heuristics_are_honest_and_mostly_optimal(method):
    hits = 0
    for seed in range(60):
        problem = random_problem(seed)
        optimum = brute_force(problem)
        tour = solve(problem, stop=400, seed=seed, method=method)
        assert_honest(problem, tour, optimum)
        hits += tour.cost == pytest.approx(optimum, abs=1e-9)
    assert hits >= 54


@pytest.mark.parametrize("seed", range(6))
def test_bounded_dp_equals_held_karp_on_larger_problems(seed):
    problem = random_problem(seed + 300, clusters=5)
    rng = np.random.default_rng(seed)
    m, sizes = 9, rng.integers(1, 5, size=9)
    labels = np.repeat(np.arange(m), sizes)
    points = rng.random((len(labels), 2)) * 100
    cost = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    cost += rng.random(cost.shape) * 20
    pairs = [(1, 2), (3, 4)] if seed % 2 else []
    problem = GtspProblem(cost, labels, precedence=pairs, path=seed % 3 == 0)
    form = normal_form(problem)
    reference, low = held_karp(form)
    nodes, bound = bounded_dp(form, math.inf, 1e-7, None, 1 << 28)
    assert reference is not None
    assert nodes is not None
    best = problem.tour_cost(form.lift(reference))
    assert problem.tour_cost(form.lift(nodes)) == pytest.approx(best)
    assert low == pytest.approx(best, rel=1e-6)
    assert bound == pytest.approx(best, rel=1e-6)


def test_unfinished_search_says_so_and_keeps_a_valid_bound():
    name, best = "station20-scattered-1", station_like.proven_optima()["station20-scattered-1"]
    problem = station_like.load(station_like.FOLDER / f"{name}.csv")
    tour = solve(problem, Stop(iterations=20_000, states=0), method="exact")
    assert not tour.proven
    assert 0.85 * best < tour.lower_bound <= best <= tour.cost
    assert 0 < tour.gap < 0.15


@pytest.mark.parametrize("name", sorted(station_like.proven_optima()))
def test_station_like_optima_are_found(name):
    best = station_like.proven_optima()[name]
    problem = station_like.load(station_like.FOLDER / f"{name}.csv")
    tour = solve(problem, seed=1)
    assert best <= tour.cost <= 1.002 * best


@pytest.mark.parametrize("name", ["station20-branches-1", "station24-branches-2"])
def test_station_like_optima_are_proven(name):
    problem = station_like.load(station_like.FOLDER / f"{name}.csv")
    tour = solve(problem, method="exact")
    assert tour.proven
    assert tour.cost == tour.lower_bound == station_like.proven_optima()[name]


def test_saved_instances_are_those_of_the_generator():
    for path in sorted(station_like.FOLDER.glob("*.csv"))[:3]:
        name, kind, seed = path.stem.split("-")
        generated = station_like.station_like(int(name.removeprefix("station")), int(seed), kind)
        assert np.array_equal(generated.cost, station_like.load(path).cost)


def test_held_karp_says_its_memory_and_refuses_more():
    problem = station_like.station_like(20, 1)
    assert held_karp_memory_bytes(problem) == 4 * 307 * 2**19
    with pytest.raises(ProblemError) as caught:
        solve(problem, Stop(iterations=10, memory_bytes=1 << 20), method="held-karp")
    assert caught.value.faults[0].code == "gtsp-memory"


def test_same_seed_same_tour_and_callback_reports_improvement():
    problem = station_like.station_like(14, 4)
    seen = []
    one = solve(problem, 9000, seed=5, method="heuristic", callback=seen.append)
    two = solve(problem, 9000, seed=5, method="heuristic")
    assert one == two
    costs = [incumbent.cost for incumbent in seen]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == one.cost


def test_warm_start_is_never_lost():
    problem = station_like.station_like(16, 2, "scattered")
    good = solve(problem, seed=0)
    again = solve(problem, stop=1, seed=9, method="heuristic", initial=[good, (1, 2, 3)])
    assert again.cost <= good.cost


def test_target_cost_stops_early():
    problem = station_like.station_like(16, 2)
    counts = []
    stop = Stop(iterations=400_000, target_cost=1e9)
    solve(problem, stop, method="heuristic", callback=lambda i: counts.append(i.iterations))
    assert counts[-1] < 400_000


def test_the_whole_budget_is_spent_when_there_is_no_target(monkeypatch):
    spent = []
    improve = memetic.ruin_recreate

    def count(arrays, iterations, *rest, **named):
        spent.append(iterations)
        return improve(arrays, iterations, *rest, **named)

    monkeypatch.setattr(memetic, "ruin_recreate", count)
    solve(station_like.station_like(20, 3), 60_000, method="heuristic")
    assert 57_000 <= sum(spent) <= 60_000


def test_pool_holds_different_admissible_tours():
    problem = station_like.station_like(12, 3)
    tour = solve(problem, method="heuristic", pool=4)
    assert 2 <= len(tour.pool) <= 4
    assert tour.pool[0] == tour.nodes
    assert len(set(tour.pool)) == len(tour.pool)
    assert all(problem.faults(nodes) == () for nodes in tour.pool)


def test_kernels_run_without_any_writable_cache():
    """A wheel in a read-only place, for a user without a cache folder."""
    code = (
        "import numba.core.caching as c\n"
        "for kind in vars(c).values():\n"
        "    if getattr(kind, '_locator_classes', None):\n"
        "        kind._locator_classes = []\n"
        "from sequencing.gtsp.arrays import uniform\n"
        "import numpy as np\n"
        "assert 0 <= uniform(np.array([3], dtype=np.uint64)) < 1\n"
        "assert isinstance(uniform._cache, c.NullCache)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_import_does_not_load_numba():
    code = "import sys, sequencing.gtsp; assert 'numba' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "best"), [("11eil51", 174), ("10ftv47", 569), ("21eil101", 249), ("24gr120", 2769)]
)
def test_gtsplib_file_is_proven(name, best):
    path = DATA / f"{name}.gtsp"
    if not path.exists():
        pytest.skip(f"no data at {path}")
    answer = run_gtsp_file(path, seed=0, exact=True)
    assert answer["cost"] == answer["lower_bound"] == best
    assert answer["proven"]
    assert min(answer["tour"]) >= 1


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "best"), [("35ftv170", 1205), ("36brg180", 4420), ("40kroa200", 13406)]
)
def test_gtsplib_best_known_is_reached(name, best):
    path = DATA / f"{name}.gtsp"
    if not path.exists():
        pytest.skip(f"no data at {path}")
    assert run_gtsp_file(path, seed=2)["cost"] == best
