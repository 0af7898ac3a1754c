"""Polish: slopes against differences of solved motions; the cycle never gets dearer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dmoc.motion.motion import MotionProblem
from dmoc.programme.types import Guess
from dmoc.solving.nlp import solve_nlp
from dmoc.solving.solver import motion_from_solution, solve
from planning.arm.screws import chain_of
from planning.collision.world import CollisionWorld
from planning.path.departure import MOST_OF_TWENTY, with_departure
from planning.station.build import demo_station
from planning.welds.alternatives_search import alternatives, weld_cost
from planning.welds.poses import departure_knots
from sequencing.cycle.plan import PlanStop, plan_station
from sequencing.cycle.polish import _batches
from sequencing.cycle.spin import admissible, end_gradient, line_problem, spin_slope, spun

STOP = PlanStop(training_edges=6, coverage_edges=2, baseline_draws=1)


@pytest.fixture(scope="module")
def station():
    whole = demo_station("stud_welding_a_8")
    return replace(whole, studs=whole.studs[:2], spin_steps=2, precedence=())


@pytest.fixture(scope="module")
def pose(station):
    return alternatives(station)[0].alternatives[0].q_rad


def test_spinning_keeps_the_tip_and_its_axis(station, pose) -> None:
    chain = chain_of(station.robot)
    turned = spun(station, pose, 0.3)
    before, after = chain.forward(np.stack([pose, turned]))
    np.testing.assert_allclose(after[:3, 3], before[:3, 3], atol=1e-9)
    np.testing.assert_allclose(after[:3, 2], before[:3, 2], atol=1e-9)
    assert np.arccos(before[:3, 0] @ after[:3, 0]) == pytest.approx(0.3, abs=1e-7)
    np.testing.assert_allclose(spun(station, turned, -0.3), pose, atol=1e-8)


def _motion(station, stud, start, goal, guess=None, knots=None):
    """A free motion that leaves `start` on the stud's line and ends at `goal`."""
    line = lambda f: departure_knots(station, stud, start, [f])[0]  # noqa: E731
    problem = with_departure(
        MotionProblem(station.robot, start, goal, station.cost), line, None, 40, knots
    )
    if guess is None:
        return solve(problem).require()
    step = guess.duration_s / guess.num_intervals
    solution = solve_nlp(problem, Guess(guess.q_rad, guess.torque_nm, step))
    return motion_from_solution(problem, solution).require()


def test_slope_is_the_difference_quotient(station, pose) -> None:
    """Holding cost and one free motion, both directions of it, against solves at φ ± 1e-3."""
    stud = station.studs[0]
    motion = _motion(station, stud, pose, station.home_rad)
    problem = line_problem(station, stud, None, motion.trajectory)
    assert len(problem.depart_rad) == 2
    gradient = end_gradient(problem, motion.trajectory)
    slope = spin_slope(station, stud, pose, gradient, None)
    step, ends = 1e-3, []
    for sign in (1, -1):
        q = spun(station, pose, sign * step)
        found = _motion(station, stud, q, station.home_rad, motion.trajectory)
        ends.append(found.cost + found.smoothing_cost + weld_cost(station, stud, q))
    # Limits between the knots are corrected after each solve, outside of the multipliers.
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-2)
    back = motion.trajectory.reversed()
    arriving = end_gradient(line_problem(station, None, stud, back), back)
    again = spin_slope(station, stud, pose, None, arriving)
    assert again == pytest.approx(slope, rel=1e-2)


@pytest.mark.parametrize("twentieths", range(1, MOST_OF_TWENTY + 1))
def test_line_knots_are_read_off_the_motion(station, pose, twentieths) -> None:
    """Every number of them that a motion may have been solved with."""
    stud, knots = station.studs[0], 2 * twentieths
    motion = _motion(station, stud, pose, station.home_rad, knots=knots)
    problem = line_problem(station, stud, None, motion.trajectory)
    assert len(problem.depart_rad) == knots
    assert problem.arrive_rad is None
    back = line_problem(station, None, stud, motion.trajectory.reversed())
    assert len(back.arrive_rad) == knots
    assert back.depart_rad is None


def test_inadmissible_poses_are_refused(station, pose) -> None:
    world, stud = CollisionWorld(station), station.studs[0]
    assert admissible(station, world, stud, pose)
    assert not admissible(station, world, stud, pose + np.array([0, 0.4, 0, 0, 0, 0]))


def test_batches_share_no_motion() -> None:
    for count in range(1, 8):
        for closed in (False, True):
            batches = _batches(count, closed)
            assert sorted(k for batch in batches for k in batch) == list(range(count))
            for batch in batches:
                for a in batch:
                    near = {(a + 1) % count} if closed else {a + 1}
                    assert not (near & set(batch)) or count == 1


def test_polish_never_costs_more_and_every_motion_stays_certified(station, tmp_path) -> None:
    store = tmp_path / "edges.sqlite"
    plain = plan_station(station, stop=STOP, store=store)
    polished = plan_station(station, stop=STOP, store=store, polish=True)
    record = polished.polish
    assert plain.polish is None
    assert record.cost_before == pytest.approx(plain.tables.energy_based.total)
    assert record.cost_after <= record.cost_before
    total = sum(m.motion.cost for m in polished.motions) + sum(w.cost for w in polished.welds)
    assert polished.tables.energy_based.total == pytest.approx(total)
    assert record.cost_after == pytest.approx(total)
    assert polished.certified == len(polished.motions)
    poses = {weld.stud: weld.q_rad for weld in polished.welds} | {"home": station.home_rad}
    for item in polished.motions:
        ends = item.motion.trajectory.q_rad[[0, -1]]
        np.testing.assert_allclose(ends, [poses[item.origin], poses[item.target]], atol=1e-9)
    world = CollisionWorld(station)
    studs = {stud.id: stud for stud in station.studs}
    assert record.moved
    for weld in polished.welds:
        assert admissible(station, world, studs[weld.stud], weld.q_rad)
    again = plan_station(station, stop=STOP, store=store, polish=True)
    assert again.polish == record


def test_a_pose_that_the_drives_cannot_hold_is_not_admissible(station, pose) -> None:
    """The rule of `alternatives`, which polish once copied in part."""
    stud = station.studs[0]
    world = CollisionWorld(station)
    assert admissible(station, world, stud, pose)
    load = np.abs(station.robot.gravity_torque_nm(pose))
    weak = station.robot.with_limits(torque_limit_nm=np.maximum(0.9 * load, 1.0))
    assert not admissible(station.replace(robot=weak), world, stud, pose)
