"""The lazy loop on oracles whose full matrix is known."""

import math

import numpy as np
import pytest

from dmoc.errors import ProblemError
from sequencing.cycle.lazy import LazyStop, solve_lazily
from sequencing.cycle.lazy_costs import usable_travels
from sequencing.gtsp import GtspProblem, Stop, solve
from tests.naive.gtsp import all_tours, random_problem


class KnownMatrix:
    """True cost = bound × U[1, spread]; refuses to be asked twice."""

    def __init__(self, clusters, size, spread, seed, impossible=0.05, symmetric=False, lie=1.0):
        rng = np.random.default_rng(seed)
        n = clusters * size
        self.labels = np.repeat(np.arange(clusters), size)
        joints = 0.5 * rng.random((n, 6)) + rng.random((clusters, 6))[self.labels]
        least = np.abs(joints[:, None] - joints[None]).max(axis=2) + 0.05
        more = rng.random((n, n))
        none = rng.random((n, n)) < impossible
        if symmetric:
            more, none = np.triu(more), np.triu(none)
            more, none = more + more.T, none | none.T
        self.true = np.where(none, np.inf, least * (1 + (spread - 1) * more))
        self.least = least * lie
        self.guess = least * (1 + (spread - 1) / 2) * 0.8  # badly scaled: calibration must help
        self.asked = set()
        self.symmetric = symmetric

    @property
    def problem(self):
        return GtspProblem(np.zeros(self.true.shape), self.labels)

    def bound(self, pairs):
        return self.least[pairs[:, 0], pairs[:, 1]]

    def estimate(self, pairs):
        return self.guess[pairs[:, 0], pairs[:, 1]]

    def evaluate(self, pairs):
        for u, v in pairs:
            assert (u, v) not in self.asked, "evaluated twice"
            assert not self.symmetric or u < v
            self.asked.add((u, v))
        return self.true[pairs[:, 0], pairs[:, 1]]


def optimum(oracle, problem):
    return solve(problem.replace(cost=oracle.true), method="exact").cost


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "options", [{}, {"home": 0}, {"path": True}, {"precedence": [(1, 2), (3, 0)]}]
)
def test_proves_the_optimum_with_few_evaluations(seed, options):
    oracle = KnownMatrix(6, 4, 1.5, seed)
    problem = oracle.problem.replace(**options)
    best = optimum(oracle, problem)
    seen = []
    result = solve_lazily(problem, oracle, seed=seed, callback=seen.append)
    assert result.status == "proven"
    assert result.tour.proven
    assert result.tour.cost == pytest.approx(best)
    assert problem.replace(cost=oracle.true).faults(result.tour.nodes) == ()
    assert result.evaluations == len(oracle.asked) == len(result.known)
    assert result.evaluations < 0.4 * usable_travels(problem).sum()
    assert tuple(seen) == result.rounds
    assert result.violations == 0


@pytest.mark.parametrize("seed", range(4))
def test_every_round_is_honest(seed):
    oracle = KnownMatrix(7, 3, 1.6, seed)
    problem = oracle.problem
    best = optimum(oracle, problem)
    result = solve_lazily(problem, oracle, seed=seed)
    for before, after in zip(result.rounds, result.rounds[1:]):
        assert after.upper_bound <= before.upper_bound
        assert after.lower_bound >= before.lower_bound
    for row in result.rounds:
        assert row.upper_bound >= best - 1e-9
        assert row.lower_bound <= best + 1e-9
        assert row.gap >= 0
    assert result.rounds[0].phase == "estimate"
    assert result.rounds[0].lower_bound == -math.inf


def test_symmetric_oracle_asks_one_direction():
    oracle = KnownMatrix(6, 4, 1.5, 3, symmetric=True)
    best = optimum(oracle, oracle.problem)
    result = solve_lazily(oracle.problem, oracle, symmetric=True)
    assert result.tour.cost == pytest.approx(best)
    assert result.tour.proven


def test_seam_asks_for_exit_to_entry():
    oracle = KnownMatrix(5, 2, 1.4, 2, impossible=0.0)
    other_end = np.arange(10) ^ 1
    problem = oracle.problem.replace(exit_of=other_end)
    best = optimum(oracle, problem)
    result = solve_lazily(problem, oracle)
    assert result.tour.cost == pytest.approx(best)
    assert problem.replace(cost=oracle.true).tour_cost(result.tour.nodes) == pytest.approx(best)


def test_evaluation_limit_and_resume_give_the_same_optimum():
    first = KnownMatrix(6, 4, 1.5, 11)
    problem = first.problem
    best = optimum(first, problem)
    part = solve_lazily(problem, first, LazyStop(evaluations=30))
    assert part.status == "evaluation_limit"
    assert part.evaluations == 30
    assert part.tour.lower_bound <= best + 1e-9
    second = KnownMatrix(6, 4, 1.5, 11)
    rest = solve_lazily(problem, second, known=part.known)
    assert rest.tour.cost == pytest.approx(best)
    assert rest.tour.proven
    assert not second.asked & set(part.known)
    again = solve_lazily(problem, KnownMatrix(6, 4, 1.5, 11), known=rest.known)
    assert again.evaluations == 0
    assert again.tour.cost == rest.tour.cost


def test_gap_stops_before_the_proof():
    full = KnownMatrix(7, 4, 1.6, 5)
    whole = solve_lazily(full.problem, full)
    oracle = KnownMatrix(7, 4, 1.6, 5)
    result = solve_lazily(oracle.problem, oracle, LazyStop(gap=0.05))
    assert result.status in ("gap", "proven")
    assert result.tour.gap <= 0.05
    assert result.evaluations < whole.evaluations


def test_round_limit():
    oracle = KnownMatrix(6, 4, 1.6, 5)
    result = solve_lazily(oracle.problem, oracle, LazyStop(rounds=1))
    assert result.status == "round_limit"
    assert len(result.rounds) == 1


def test_bounds_that_are_not_strict_prove_nothing():
    oracle = KnownMatrix(6, 4, 1.5, 7)
    result = solve_lazily(oracle.problem, oracle, LazyStop(kind="conditional"), strict=False)
    assert result.tour.lower_bound == -math.inf
    assert not result.tour.proven
    assert result.conditional_bound > 0
    assert result.status == "gap"
    assert all(row.lower_bound == -math.inf for row in result.rounds)
    # factor × estimate is below every true cost here, so what was found is the optimum
    low = solve_lazily(
        oracle.problem,
        KnownMatrix(6, 4, 1.5, 7),
        LazyStop(kind="conditional"),
        strict=False,
        factor=0.9,
    )
    assert low.tour.cost == pytest.approx(optimum(oracle, oracle.problem))
    assert low.conditional_gap <= 1e-6


def test_condition_refuted_by_an_evaluation_is_not_kept():
    oracle = KnownMatrix(6, 4, 1.5, 8)
    problem = oracle.problem
    best = optimum(oracle, problem)
    result = solve_lazily(problem, oracle, LazyStop(kind="conditional"), strict=False, factor=1.4)
    # the bound holds for the costs as they stand: evaluated ones true, others factor × estimate
    mixed = np.where(
        np.isin(
            np.arange(oracle.true.size).reshape(oracle.true.shape),
            [u * len(oracle.true) + v for u, v in result.known],
        ),
        oracle.true,
        1.4 * oracle.guess,
    )
    assert (
        result.conditional_bound <= solve(problem.replace(cost=mixed), method="exact").cost + 1e-6
    )
    assert result.tour.cost >= best - 1e-9


def test_violated_bounds_are_reported_and_cancel_the_proof():
    oracle = KnownMatrix(6, 3, 1.3, 4, lie=1.25)
    result = solve_lazily(oracle.problem, oracle)
    assert result.violations > 0
    assert not result.tour.proven
    assert result.tour.lower_bound == -math.inf


def test_impossible_station_has_no_tour():
    oracle = KnownMatrix(4, 2, 1.3, 4)
    oracle.true[:] = np.inf
    result = solve_lazily(oracle.problem, oracle)
    assert result.status == "no_tour"
    assert not result.tour.found
    assert result.tour.proven


def test_bad_answers_of_an_oracle_name_the_pair():
    oracle = KnownMatrix(4, 2, 1.3, 4)
    oracle.true[:] = np.nan
    with pytest.raises(ProblemError) as caught:
        solve_lazily(oracle.problem, oracle)
    assert caught.value.faults[0].code == "oracle-value"
    assert "evaluate(" in caught.value.faults[0].field
    oracle.bound = lambda pairs: np.zeros(3)
    with pytest.raises(ProblemError) as caught:
        solve_lazily(oracle.problem, oracle)
    assert caught.value.faults[0].code == "oracle-shape"
    with pytest.raises(ProblemError):
        LazyStop(gap=-1.0)


def test_same_seed_same_result():
    one = solve_lazily(KnownMatrix(6, 4, 1.5, 1).problem, KnownMatrix(6, 4, 1.5, 1), seed=3)
    two = solve_lazily(KnownMatrix(6, 4, 1.5, 1).problem, KnownMatrix(6, 4, 1.5, 1), seed=3)
    assert one == two


@pytest.mark.parametrize("seed", range(60))
def test_usable_travels_leave_no_tour_out(seed):
    problem = random_problem(seed, clusters=4)
    usable = usable_travels(problem)
    for nodes in all_tours(problem):
        if math.isfinite(problem.tour_cost(nodes)):
            assert all(usable[u, v] for u, v in problem.edges(nodes))


def test_relaxation_limit_ends_open_and_says_so():
    oracle = KnownMatrix(13, 5, 1.6, 2)
    result = solve_lazily(oracle.problem, oracle, exact=Stop(states=0), iterations=3000)
    assert result.status in ("open", "proven")
    assert result.tour.lower_bound <= result.tour.cost
