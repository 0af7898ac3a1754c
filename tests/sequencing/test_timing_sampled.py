"""The sampled routines agree with each other, and the study's reduced form is complete."""

import json
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label

from studies.pallet_cell.sampled_check import BROAD, NARROW, SampledCheck, boxes_overlap
from studies.pallet_cell.study import (
    crossing_cell,
    first_trajectories,
    pallet_cell,
    run_pallet_cell_study,
    solution_space,
)

CELL = pallet_cell()


def joints(window: int, lag: float) -> list[np.ndarray]:
    out = []
    for r, item in enumerate(CELL.robots):
        t = item.trajectories[window]
        s = np.clip(np.linspace(0, 1.4, 15) - lag * r, 0, t.duration_s)
        bare = type(t)(t.t_s, t.q_rad, t.velocity_rad_s, t.torque_nm)
        out.append(bare.sample(s).q_rad)
    return out


@pytest.mark.parametrize(("broad", "narrow"), list(product(BROAD, NARROW)))
def test_all_routines_give_the_same_answer(broad, narrow) -> None:
    plain = SampledCheck(CELL.robots, (), "none", "gjk")
    check = SampledCheck(CELL.robots, (), broad, narrow)
    free = joints(2, 0.0)
    # Everybody at the pallet at once: a collision that nobody can miss.
    crowd = [np.repeat(r.trajectories[k].q_rad[-1:], 2, 0) for r, k in zip(CELL.robots, (0, 1, 2))]
    assert check.first_collision(free) == plain.first_collision(free)
    assert check.first_collision(crowd) == plain.first_collision(crowd) == 0


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 10**6))
def test_box_overlap_is_never_missed(seed) -> None:
    rng = np.random.default_rng(seed)
    turns = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2)]
    half = rng.uniform(0.1, 1.0, (2, 3))
    offset = rng.uniform(-2, 2, 3)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)
    points = offset + (grid * half[1]) @ turns[1].T
    inside = (np.abs(points @ turns[0]) <= half[0]).all(axis=1).any()
    found = boxes_overlap(turns[0], half[0], turns[1], half[1], offset)
    assert found or not inside
    if found:
        assert np.linalg.norm(offset) <= np.linalg.norm(half[0]) + np.linalg.norm(half[1]) + 1e-9


def test_a_collision_splits_the_solution_space() -> None:
    """The picture of the paper's Fig. 4: allowed before the barrier and beyond it."""
    space = solution_space(crossing_cell(), 0, 0, 41)
    islands, count = label(~np.isnan(space["energy_j"]))
    sizes = np.bincount(islands.ravel())[1:]
    assert count >= 2
    assert np.sort(sizes)[-2] >= 20
    early, late = (space["delay_s"][islands == k + 1].mean() for k in np.argsort(-sizes)[:2])
    assert early != late


def test_a_collision_takes_part_of_a_windows_solution_space() -> None:
    space = solution_space(CELL, 34, 0, 31)
    blocked = np.isnan(space["energy_j"])
    assert 0.1 < space["blocked_share"] < 0.9
    assert not blocked[0].all()
    assert blocked.any(axis=0).any()


def test_the_study_is_plain_data_with_the_papers_numbers_beside() -> None:
    data = run_pallet_cell_study(0, trajectories=2, capacities_f=(3e-3, 30e-3))
    assert json.loads(json.dumps(data))["paper"]["cases"][1]["saving_percent"] == 9.26
    assert [row["capacitance_f"] for row in data["capacity"]] == [3e-3, 30e-3]
    assert data["capacity"][1]["fast_j"] <= data["capacity"][0]["fast_j"]
    for row in data["capacity"]:  # savings count from free-running full speed, not from lock step
        best = row.get("optimised_j", row["stretched_j"])
        assert row["saving_percent"] == pytest.approx(100 * (1 - best / row["free_running_j"]))
    assert data["provenance"]["drive"]["north"]["copper_ohm"] == "assumed"


def test_reduced_cells_keep_the_handovers_among_what_is_left() -> None:
    small = first_trajectories(CELL, 4)
    assert small.first == (0, 4, 8, 12)
    assert (0, 5) in small.handovers
    assert all(max(pair) < 12 for pair in small.handovers)
