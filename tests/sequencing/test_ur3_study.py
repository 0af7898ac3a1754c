"""The UR3 study: its movements, its world, its sweeps and its object."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmoc.errors import ProblemError
from dmoc.robot.robot import load_robot
from sequencing.runs.folder import read_run
from studies.ur3.bezier_descent import DescentParams
from studies.ur3.case import Setting, judge, saving, solve_case, viscous_floor_j
from studies.ur3.moves import CLASSES, Move, movej, paper_moves, random_moves
from studies.ur3.reference import free_form
from studies.ur3.study import run_ur3_study
from studies.ur3.sweeps import duration_sweep, obstacle_sweep, payload_sweep
from studies.ur3.tables import ur3_markdown
from studies.ur3.world import avoid_in, tabletop_world, touches

ROBOT = load_robot("ur3e_class")
WORLD = tabletop_world(ROBOT)
QUICK = Setting(ROBOT, WORLD, descent=DescentParams(starts=1, iterations=25))


@pytest.mark.parametrize("kind", CLASSES)
def test_movements_fit_the_papers_description(kind: str) -> None:
    moves = [m for m in paper_moves() if m.kind == kind]
    moves += random_moves(ROBOT, WORLD, kind, 6, seed=4)
    for move in moves:
        start, goal = (ROBOT.tip_pose(q).translation for q in (move.start_rad, move.goal_rad))
        turn = abs(np.degrees(move.goal_rad[0] - move.start_rad[0]))
        if kind in "AB":
            assert turn == pytest.approx({"A": 90, "B": 180}[kind], abs=5.1)
            assert abs(start[2] - goal[2]) < 0.03
        else:
            low, high = (start, goal) if kind == "C" else (goal, start)
            assert np.hypot(*low[:2]) > 0.35
            assert high[2] > 0.45
            assert high[2] - low[2] > 0.3
        if kind == "B":
            assert max(np.hypot(*start[:2]), np.hypot(*goal[:2])) < 0.3
        assert touches(WORLD, movej(move, ROBOT, 3.0)) is None


def test_random_moves_repeat_and_differ() -> None:
    first, second, other = (random_moves(ROBOT, WORLD, "A", 2, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first[1].start_rad, second[1].start_rad)
    assert not np.array_equal(first[0].start_rad, other[0].start_rad)
    with pytest.raises(ProblemError, match="move-class"):
        random_moves(ROBOT, WORLD, "E", 1, 0)


@pytest.mark.parametrize("duration_s", [1.0, 3.0, 6.0])
def test_movej_takes_its_time_at_rest_and_in_line(duration_s: float) -> None:
    move = paper_moves()[1]
    curve = movej(move, ROBOT, duration_s)
    assert curve.duration_s == pytest.approx(duration_s)
    assert np.abs(curve.velocity_rad_s[[0, -1]]).max() < 1e-9
    sample = curve.sample(np.linspace(0, duration_s, 200))
    a = np.abs(sample.acceleration_rad_s2).max()
    assert a == pytest.approx(max(1.4, 4.5 * np.pi / duration_s**2), rel=1e-6)


def test_world_knows_table_and_arm() -> None:
    into_table = np.deg2rad([0.0, 30, 40, 0, 0, 0])
    folded = np.deg2rad([0.0, -90, 175, 0, 0, 0])
    assert WORLD.collide(into_table) is not None
    assert WORLD.collide(folded) is not None
    assert WORLD.collide(paper_moves()[0].start_rad) is None


def test_avoidance_gradient_agrees_with_finite_differences() -> None:
    avoid = avoid_in(WORLD, margin_m=0.08)
    q = np.deg2rad([[10.0, -20, 70, -40, -60, 0]])
    value, slope = avoid(q)
    assert value[0] > 0
    for j in range(6):
        step = np.zeros_like(q)
        step[0, j] = 1e-5
        numeric = (avoid(q + step)[0] - avoid(q - step)[0])[0] / 2e-5
        assert slope[0, j] == pytest.approx(numeric, rel=2e-2, abs=0.02 * np.abs(slope).max())


def test_judgement_counts_base_load_and_the_free_kick() -> None:
    case = solve_case(paper_moves()[2], "energy", QUICK, ())
    report = judge(case.gradient.motion, QUICK)
    assert report["energy_with_base_j"] == pytest.approx(report["energy_j"] + 108.0)
    assert 0 < report["kinetic_start_j"] < 1.0
    assert report["touches"] is None
    assert saving(10.0, 8.0) == pytest.approx(20.0)
    assert saving(-3.0, -5.0) is None


def test_viscous_floor_of_one_joint_by_hand() -> None:
    move = Move("one", "A", np.zeros(6), np.array([2.0, 0, 0, 0, 0, 0]))
    assert viscous_floor_j(move, QUICK) == pytest.approx(48 / 10.5 * 5.1 * 2.0, rel=1e-4)


@pytest.mark.parametrize("index", [0, 2])
def test_no_bezier_motion_is_below_the_free_form(index: int) -> None:
    move = paper_moves()[index]
    case = solve_case(move, "energy", replace(QUICK, descent=DescentParams(starts=2)), ())
    report, curve, _ = free_form(move, case.best, QUICK)
    assert report["status"] == "converged"
    assert not report["bezier_below"]
    assert curve is not None
    first, last = case.best.motion.end_velocity_rad_s
    # Joints that creep are held still, so only those that move keep their end velocity.
    moving = np.ptp(curve.q_rad, axis=0) > 0
    np.testing.assert_allclose(curve.velocity_rad_s[0][moving], first[moving], atol=1e-6)
    np.testing.assert_allclose(curve.velocity_rad_s[-1][moving], last[moving], atol=1e-6)


def test_payload_costs_and_long_moves_pay_base_load() -> None:
    move = paper_moves()[2:3]
    rows = [r for r in payload_sweep(move, QUICK, (0.0, 3.0)) if r["metric"] == "iv_absolute"]
    assert rows[1]["baseline_j"] > rows[0]["baseline_j"] + 50
    durations, best = duration_sweep(move, QUICK, (1.5, 6.0))
    assert durations[1]["baseline_with_base_j"] > durations[0]["baseline_with_base_j"]
    assert {row["duration_s"] for row in best} == {1.5}


def test_a_post_in_the_way_is_avoided() -> None:
    setting = replace(QUICK, swarm=replace(QUICK.swarm, iterations=40))
    rows = obstacle_sweep(paper_moves()[:1], setting, seed=0)
    assert rows
    assert all(row["movej_touches"] and "post" in row["movej_touches"] for row in rows)
    assert all(row["best_touches"] is None for row in rows)
    assert all(row["swarm_feasible"] for row in rows)


@pytest.mark.slow
def test_reduced_study_writes_runs_and_repeats(tmp_path: Path) -> None:
    result = run_ur3_study(0, tmp_path / "a", reduced=True)
    run_ur3_study(0, tmp_path / "b", reduced=True)
    first, second = ((tmp_path / x / "study.json").read_bytes() for x in "ab")
    assert first == second
    assert json.loads(first)["goals"]["limits_and_collisions_respected"]
    assert "cpu_s" not in json.loads(first)
    assert "gradient_to_swarm_ratio" in result["cpu_s"]
    for kind in CLASSES:
        assert read_run(tmp_path / "a" / kind, ROBOT).motions[0].motion.certified
    text = ur3_markdown(result)
    assert all(f"| {kind} |" in text for kind in CLASSES)
    for row in result["exports"]:
        fast, slow = row["servoj"]
        assert fast["deviation_rad"] < 2e-4 < slow["deviation_rad"] < 0.03
        assert max(fast["read_back_rad"], slow["read_back_rad"]) < 1e-6
        assert row["rtde"]["read_back_rad"] < 1e-6
