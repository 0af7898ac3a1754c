"""Properties of tours and solvers, whatever the problem."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sequencing.gtsp import GtspProblem, solve
from sequencing.gtsp.normalise import normal_form
from tests.naive.gtsp import all_tours, brute_force, cost_of, random_problem

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_normal_form_keeps_every_tour_and_its_cost(seed):
    problem = random_problem(seed, clusters=4)
    form = normal_form(problem)
    for nodes in all_tours(problem):
        cost = cost_of(problem, nodes)
        inside = form.lower(nodes)
        if inside is None:
            assert math.isinf(cost) or (problem.path is False and problem.home is None)
            continue
        if len(nodes) > 1 or problem.path:
            total = form.cost[inside, np.roll(inside, -1)].sum()
            if math.isinf(cost):
                assert total >= form.penalty / 2
            else:
                assert total == pytest.approx(cost, abs=1e-9)
        assert sorted(form.lift(inside)) == sorted(nodes)


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_default_solve_is_proven_optimal_on_small_problems(seed):
    problem = random_problem(seed, clusters=4)
    tour = solve(problem, stop=100, seed=seed % 7)
    best = brute_force(problem)
    assert tour.proven
    assert tour.cost == pytest.approx(best, abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.floats(0.1, 50.0))
def test_scaling_and_shifting_costs_moves_the_optimum_with_them(seed, factor):
    problem = random_problem(seed, clusters=4)
    if problem.num_clusters < 2:
        return
    travels = problem.num_clusters - (1 if problem.path else 0)
    changed = problem.replace(
        cost=factor * problem.cost + 3.0, node_cost=factor * problem.node_cost
    )
    first, second = solve(problem, stop=100), solve(changed, stop=100)
    if first.found:
        assert second.cost == pytest.approx(factor * first.cost + 3.0 * travels, abs=1e-4)
    else:
        assert not second.found


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_forbidding_an_edge_never_makes_the_tour_cheaper(seed):
    problem = random_problem(seed, clusters=4)
    tour = solve(problem, stop=100)
    if not tour.found:
        return
    for u, v in problem.edges(tour.nodes):
        cost = problem.cost.copy()
        cost[u, v] = np.inf
        assert solve(problem.replace(cost=cost), stop=100).cost >= tour.cost - 1e-6


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_renumbering_nodes_does_not_change_the_optimum(seed):
    problem = random_problem(seed, clusters=4)
    size = problem.num_nodes
    move = np.random.default_rng(seed).permutation(size)
    back = np.argsort(move)
    moved = GtspProblem(
        problem.cost[np.ix_(move, move)],
        problem.cluster_of[move],
        node_cost=problem.node_cost[move],
        exit_of=back[problem.exit_of[move]],
        home=None if problem.home is None else int(back[problem.home]),
        start=None if problem.start is None else int(back[problem.start]),
        end=None if problem.end is None else int(back[problem.end]),
        path=problem.path,
        precedence=problem.precedence,
    )
    assert solve(moved, stop=100).cost == pytest.approx(solve(problem, stop=100).cost, abs=1e-6)
