"""The order level against enumeration, on invented costs and on small cells."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest
from timing_cells import round_trips, stops, two_arms

from dmoc.errors import ProblemError
from sequencing.timing.clearance.verify import check_schedule
from sequencing.timing.scheduling import schedule, schedule_to_dict
from sequencing.timing.search.jobs import in_given_numbers, in_order, jobs_of, rearranged
from sequencing.timing.search.levels import _QUICK, first_level
from sequencing.timing.search.order import align, order_exact, order_search
from sequencing.timing.search.prepared import prepare_cell
from sequencing.timing.search.windows import Timing, make_windows, window_result


def random_cost(seed):
    rng = np.random.default_rng(seed)
    known = {}
    return lambda state, move: known.setdefault((state, move), float(rng.uniform(1, 2)))


def every_alignment(counts):
    """All sequences of windows, naively."""
    if not any(counts):
        return [()]
    out = []
    for move in product((0, 1), repeat=len(counts)):
        if any(move) and all(c >= m for c, m in zip(counts, move)):
            for rest in every_alignment(tuple(c - m for c, m in zip(counts, move))):
                out.append((move, *rest))
    return out


def enumerated(durations, cost, handovers, total_s):
    """Cheapest allowed alignment by trying all."""
    best = np.inf
    for moves in every_alignment(tuple(map(len, durations))):
        at, joules, seconds, done = [0] * len(durations), 0.0, 0.0, {}
        for w, move in enumerate(moves):
            joules += cost(tuple(at), move)
            seconds += max(durations[r][at[r]] for r, m in enumerate(move) if m)
            for r, m in enumerate(move):
                if m:
                    done[r, at[r]] = w
                    at[r] += 1
        if seconds <= total_s + 1e-9 and all(done[a] < done[b] for a, b in handovers):
            best = min(best, joules)
    return best


@pytest.mark.parametrize("seed", range(8))
def test_alignment_equals_enumeration_with_and_without_a_time_limit(seed) -> None:
    rng = np.random.default_rng(seed)
    durations = [rng.integers(1, 4, n).astype(float) for n in ((2, 3), (3, 3), (2, 2, 2))[seed % 3]]
    cost = random_cost(seed)
    handovers = [((0, 0), (1, 1))]
    least = enumerated(durations, lambda *_: 0.0, handovers, np.inf)
    assert least == 0.0
    for total in (np.inf, sum(map(sum, durations)), max(map(sum, durations)) + 2.0):
        expected = enumerated(durations, cost, handovers, total)
        if not np.isfinite(expected):
            with pytest.raises(ProblemError, match="alignment-time"):
                align(durations, cost, handovers, total)
            continue
        found = align(durations, cost, handovers, None if np.isinf(total) else total)
        assert found.proven
        assert found.cost_j == pytest.approx(expected)
        assert found.duration_s <= total + 1e-9
        for r, row in enumerate(durations):
            ran = [w[r] for w in found.windows if w[r] is not None]
            assert ran == list(range(len(row)))


def test_a_band_is_no_proof_and_never_better_than_all() -> None:
    rng = np.random.default_rng(0)
    durations = [rng.uniform(1, 2, 6) for _ in range(2)]
    cost = random_cost(1)
    whole = align(durations, cost)
    part = align(durations, cost, most_windows=40)
    assert not part.proven
    assert part.cost_j >= whole.cost_j - 1e-12


def test_a_large_lattice_is_searched_next_to_its_quickest_way() -> None:
    rng = np.random.default_rng(2)
    durations = [rng.uniform(1, 2, n) for n in (40, 38, 25)]
    found = align(durations, random_cost(3), [((0, 5), (1, 6))], 80.0)
    assert not found.proven
    assert found.duration_s <= 80.0
    assert found.valued <= 1500
    for r, row in enumerate(durations):
        assert [w[r] for w in found.windows if w[r] is not None] == list(range(len(row)))


def pair_cost(seed, n):
    table = np.random.default_rng(seed).uniform(0, 1, (n, n))
    return lambda orders: float(sum(table[a, b] for a, b in zip(*orders)))


@pytest.mark.parametrize("seed", range(3))
def test_search_finds_the_enumerated_order(seed) -> None:
    cost = pair_cost(seed, 5)
    _, exact = order_exact((5, 5), cost)
    orders, value = order_search((5, 5), cost, seed)
    assert value == pytest.approx(exact)
    assert cost(orders) == pytest.approx(value)


def test_too_large_cells_are_refused_by_the_exact_methods() -> None:
    with pytest.raises(ProblemError, match="lattice"):
        align([np.ones(150)] * 3, lambda *_: 1.0)
    with pytest.raises(ProblemError, match="orders"):
        order_exact((13, 13, 13), lambda o: 1.0)


def test_jobs_run_from_the_most_visited_place_back_to_it() -> None:
    trips = round_trips(0, 3)
    cell = two_arms(np.vstack([stops(5, 1), trips]), trips, free_order=(True, False))
    jobs = jobs_of(cell.robots[0])
    assert (jobs.lead, jobs.jobs, jobs.trail) == ((0,), ((1, 2), (3, 4), (5, 6)), ())
    assert jobs.arranged((2, 0, 1)) == (0, 5, 6, 1, 2, 3, 4)
    assert len(jobs_of(cell.robots[1]).jobs) == 1


def test_a_rearranged_cell_is_the_same_physics() -> None:
    cell = two_arms(round_trips(1, 3), round_trips(2, 3), free_order=(True, True))
    prepared = prepare_cell(cell)
    order = ((2, 3, 0, 1, 4, 5), (0, 1, 4, 5, 2, 3))
    other = rearranged(prepared, order)
    numbers = in_order(cell, order)
    windows = make_windows(other)
    start = np.empty(12)
    for w, group in enumerate(windows.numbers):
        start[list(group)] = windows.edges_s[w]
    timing = Timing(start, np.full(12, 1.0), float(windows.edges_s[-1]))
    back = in_given_numbers(timing, numbers)
    one = other.evaluate(timing.start_s, timing.override, timing.total_s).link_j
    two = prepared.evaluate(back.start_s, back.override, back.total_s).link_j
    assert one == pytest.approx(two, rel=1e-12)
    assert check_schedule(cell, back.start_s, back.override) == []


def test_first_level_equals_enumeration_of_windows() -> None:
    cell = two_arms(stops(3, 3), stops(4, 5), handovers=((0, 3),))
    prepared = prepare_cell(cell)
    flat = [np.array(row) for row in cell.durations_s]
    total = float(make_windows(prepared).edges_s[-1])
    found = first_level(prepared, total, 0)
    assert (found.method, found.proven) == ("exact", True)
    assert found.alignments > 4

    def cost(state, move):
        moving = [cell.first[r] + state[r] for r in (0, 1) if move[r]]
        waits = [
            (cell.first[r] + max(state[r] - 1, 0), state[r] > 0) for r in (0, 1) if not move[r]
        ]
        length = max(np.concatenate(flat)[moving])
        return window_result(prepared, moving, length, 0, None, _QUICK, waits).value_j

    handover = [((0, 0), (1, 1))]
    assert found.estimate_j == pytest.approx(enumerated(flat, cost, handover, total))
    assert found.estimate_j <= found.given_j


def orders_in_schedule(seed: int):
    """A cell whose jobs may be exchanged on one arm, and its schedule."""
    cell = two_arms(
        round_trips(seed, 3),
        round_trips(seed + 1, 3),
        handovers=((1, 10),),
        free_order=(True, False),
    )
    return cell, schedule(cell, seed=0)


def test_schedule_uses_the_first_level_and_keeps_what_it_must() -> None:
    cell, found = orders_in_schedule(28)
    level = found.order
    assert level.orders == 6
    assert level.proven
    assert level.estimate_j <= level.given_j
    cases = {case.name: case for case in found.cases}
    assert level.changed
    assert cases["order"].energy_j < cases["windows"].energy_j
    assert cases["order-general"].energy_j <= cases["order"].energy_j
    flat = np.concatenate(cell.durations_s)
    for name in ("order", "order-general"):
        timing = cases[name].timing
        end = timing.start_s + flat / timing.override
        assert timing.total_s == pytest.approx(cases["as-fast-as-possible"].timing.total_s)
        assert end.max() <= timing.total_s + 1e-9
        assert timing.start_s[10] >= end[1] - 1e-9
        for r, own in enumerate(level.order):
            ran = [cell.first[r] + k for k in own]
            assert all(timing.start_s[b] >= end[a] - 1e-9 for a, b in pairwise(ran))
        assert check_schedule(cell, timing.start_s, timing.override) == []
    data = schedule_to_dict(found)["order"]
    assert data["method"] == "exact"
    assert len(data["windows"]) == len(level.windows.numbers)
    assert sorted(data["sequence"]["left"]) == list(range(6))


def test_the_exact_order_is_the_best_of_all_orders_aligned() -> None:
    cell = two_arms(round_trips(7, 3), round_trips(8, 2), free_order=(True, False))
    prepared = prepare_cell(cell)
    total = float(make_windows(prepared).edges_s[-1])
    found = first_level(prepared, total, 0)
    jobs = jobs_of(cell.robots[0])
    values = []
    for order in permutations(range(3)):
        own = (jobs.arranged(order), tuple(range(4)))
        fixed = rearranged(prepared, own)
        level = first_level(type(fixed)(_given(fixed.cell), fixed.paths, fixed.tables), total, 0)
        values.append(np.inf if level is None else level.estimate_j)
    assert found.estimate_j == pytest.approx(min(values), rel=1e-6)


def _given(cell):
    from dataclasses import replace

    return replace(cell, robots=tuple(replace(r, free_order=False) for r in cell.robots))
