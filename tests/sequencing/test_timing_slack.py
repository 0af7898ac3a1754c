"""The box formulation: every point is a legal schedule, and it misses none; its chain rule."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.errors import ProblemError
from sequencing.timing.power.along_path import MIN_OVERRIDE
from sequencing.timing.search.slack import decode, encode, pull_back, slack_graph

CELL = [[1.0, 2.0, 0.5], [0.7, 1.5], [2.0, 0.3, 0.4]]
HANDOVERS = [(0, 4), (3, 7)]
PAUSE = [[0.1, 0.0, 0.2], [0.0, 0.3], [0.0, 0.0, 0.0]]
TOTAL = 6.0


def graph(**kwargs):
    return slack_graph(CELL, HANDOVERS, TOTAL, pause_s=PAUSE, **kwargs)


def require_legal(start, override) -> None:
    flat = np.concatenate(CELL)
    pause = np.concatenate(PAUSE)
    end = start + flat / override
    eps = 1e-9
    assert (start >= -eps).all()
    assert (override <= 1 + eps).all()
    assert (override >= MIN_OVERRIDE - eps).all()
    assert (end + pause <= TOTAL + eps).all()
    for a, b in [(0, 1), (1, 2), (3, 4), (5, 6), (6, 7), *HANDOVERS]:
        assert start[b] >= end[a] + pause[a] - eps


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6))
def test_every_point_of_the_box_keeps_order_handovers_pauses_and_total_time(seed) -> None:
    z = np.random.default_rng(seed).beta(0.5, 0.5, (2, 8))
    require_legal(*decode(graph(), z))


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6))
def test_encode_finds_the_point_of_a_legal_schedule(seed) -> None:
    z = np.random.default_rng(seed).uniform(0, 1, (2, 8))
    start, override = decode(graph(), z)
    again = decode(graph(), encode(graph(), start, override))
    np.testing.assert_allclose(again[0], start, atol=1e-9)
    np.testing.assert_allclose(again[1], override, atol=1e-9)


def test_zero_is_as_fast_as_possible_and_one_uses_all_the_time() -> None:
    start, override = decode(graph(), np.zeros((2, 8)))
    assert (override == 1).all()
    assert start[4] == pytest.approx(1.1)  # waits for the hand-over and its pause
    ones = np.zeros((2, 8))
    ones[0] = 1.0
    start, override = decode(graph(), ones)
    end = start + np.concatenate(CELL) / override
    assert end[7] == pytest.approx(TOTAL)


def test_a_window_is_the_papers_box_with_the_critical_robot_fixed() -> None:
    window = slack_graph([[1.0], [2.0], [1.5]])
    start, override = decode(window, np.full((2, 3), 0.5))
    assert override[1] == 1.0
    assert start[1] == 0.0
    assert 1.0 / override[0] == pytest.approx(1.0 + 0.5 * (2.0 - 1.0))
    assert start[0] == pytest.approx(0.5 * (2.0 - 1.5))


def test_frozen_trajectories_stay_and_the_others_make_room() -> None:
    held = graph(fixed={1: (2.5, 2.2)})
    for seed in range(20):
        z = np.random.default_rng(seed).uniform(0, 1, (2, 8))
        start, override = decode(held, z)
        require_legal(start, override)
        assert start[1] == 2.5
        assert override[1] == pytest.approx(2.0 / 2.2)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_chain_rule_is_the_finite_difference(seed) -> None:
    rng = np.random.default_rng(seed)
    g = graph()
    z = rng.uniform(0.05, 0.95, (2, 8))
    weight = rng.normal(size=(2, 8))
    timing = np.array(decode(g, z))
    grad = pull_back(g, z, timing, weight)
    h = 1e-7
    wrong = 0
    for m in range(2):
        for k in range(8):
            step = np.zeros((2, 8))
            step[m, k] = h
            up, down = np.array(decode(g, z + step)), np.array(decode(g, z - step))
            numeric = ((up - down) * weight).sum() / (2 * h)
            wrong += abs(numeric - grad[m, k]) > 1e-5 * (1 + abs(numeric))
    assert wrong <= 1  # a switch of the latest predecessor may lie within h


def test_circles_and_short_times_are_refused() -> None:
    with pytest.raises(ProblemError, match=r"1 -> 0 -> 1|0 -> 1 -> 0"):
        slack_graph([[1.0], [1.0]], [(0, 1), (1, 0)])
    with pytest.raises(ProblemError, match="total"):
        slack_graph([[1.0, 1.0]], total_s=1.5)
