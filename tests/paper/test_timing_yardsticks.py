"""Outside yardsticks of the timing part: CTU's Skoda cell and measured UR3e energies."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("DMOC_DATA", ROOT.parent / "shared" / "data"))
sys.path.insert(0, str(ROOT))

pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not (DATA / "skoda").is_dir(), reason=f"no benchmark data at {DATA}"),
]


@pytest.fixture(scope="module")
def skoda():
    from benchmarks.skoda import read_skoda

    return read_skoda(DATA / "skoda" / "SkodaRoboticCell-PowerSavingModes.xml")


def test_skoda_full_speed_reproduces_489_kj(skoda) -> None:
    from benchmarks.skoda import full_speed_j

    assert full_speed_j(skoda) == pytest.approx(489.4e3, rel=2e-4)


def test_skoda_timing_with_motors_on_reproduces_400_kj(skoda) -> None:
    from benchmarks.skoda import solve_modes

    lower, upper, _ = solve_modes(skoda.robots, skoda.lags, skoda.cycle_s, (0,) * 6)
    assert upper == pytest.approx(400.3e3, rel=2e-4)
    assert lower <= upper <= lower * (1 + 1e-6)


def test_skoda_power_modes_are_proven_optimal_at_390_7_kj(skoda) -> None:
    from benchmarks.skoda import solve

    found = solve(skoda)
    assert found["best_j"] <= 390.7e3
    assert found["lower_j"] >= found["best_j"] * (1 - 1e-6)


def test_ur3e_energy_of_unseen_moves_within_the_goals() -> None:
    from benchmarks.ur3e_energy import current_features, leave_one_out, motion_features, read_moves

    moves = read_moves(DATA / "ur3e_power")
    assert sum(len(m.t_s) for m in moves) == 225
    for row in leave_one_out(moves, current_features, 36.2):
        assert abs(row["error_total_percent"]) <= 2.0
    for row in leave_one_out(moves, motion_features, 36.2):
        assert abs(row["error_total_percent"]) <= 5.0
        assert abs(row["error_above_base_percent"]) <= 25.0
