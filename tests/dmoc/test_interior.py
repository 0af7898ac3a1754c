"""Our own solver finds Ipopt's optima, hands on what it cannot carry, and repeats itself."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.errors import ProblemError
from dmoc.motion.constraints import EndCost, MotionLimits, PathConstraint, TorqueSpeed
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.status import Status
from dmoc.programme.builder import Families
from dmoc.programme.guess import straight_guess
from dmoc.programme.types import Box, Guess, PathRows
from dmoc.robot.robot import load_robot
from dmoc.solving.nlp import solve_nlp
from dmoc.solving.solver import solve
from dmoc.solving.solvers import SolveParams

OWN = SolveParams(solver="structured")
OWN_KNOTS = SolveParams(solver="structured", limit_curve=False)
KNOTS = SolveParams(limit_curve=False)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return random_robot(5, tmp_path_factory.mktemp("arms"), 3)


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    return random_robot(6, tmp_path_factory.mktemp("arms"), 2)


def assert_same(ipopt, own, by: str = "structured") -> None:
    assert ipopt.status is own.status is Status.CONVERGED
    assert (ipopt.solver, own.solver) == ("ipopt", by)
    assert own.max_defect <= 1e-6
    assert own.cost + own.smoothing_cost == pytest.approx(
        ipopt.cost + ipopt.smoothing_cost, rel=1e-6
    )
    np.testing.assert_allclose(own.q_rad, ipopt.q_rad, atol=1e-4)
    assert own.step_s == pytest.approx(ipopt.step_s, rel=1e-4)


@pytest.mark.parametrize("name", ["ur10e_class", "irb6640_class", "planar2"])
def test_same_optimum_for_the_packaged_robots(name: str) -> None:
    free = load_robot(name).with_limits(acceleration_limit_rad_s2=1e3)
    for problem in random_problems(free, 4, seed=11, num_intervals=24):
        guess = straight_guess(problem)
        assert_same(solve_nlp(problem, guess), solve_nlp(problem, guess, params=OWN))


def test_same_optimum_for_every_kind_of_problem(arm) -> None:
    problem = random_problems(arm, 1, seed=2, num_intervals=16)[0]
    near = 0.01 * np.arange(1, 3)[:, None]
    curve = TorqueSpeed(0.7 * arm.torque_limit_nm, 2.0 * arm.velocity_limit_rad_s)
    q, v, u = (ca.SX.sym(name, 3) for name in "qvu")
    path = PathConstraint(ca.Function("c", [q, v, u], [ca.sumsqr(v)]), -np.inf, 2.0)
    variants = [
        {"duration_s": 2.5},
        {"start_velocity_rad_s": 0.2, "goal_velocity_rad_s": -0.3},
        {"depart_rad": problem.start_rad + near},
        {"arrive_rad": problem.goal_rad - near[::-1]},
        {"depart_rad": problem.start_rad + near, "arrive_rad": problem.goal_rad - near[:1]},
        {"wrench": [0.0, 10.0, -50.0, 0.0, 5.0, 0.0]},
        {"limits": MotionLimits(torque_speed=curve)},
        {"limits": MotionLimits(path=(path,))},
        {"cost": Cost(state_matrix=np.diag([0.1] * 3 + [1.0] * 3), torque_matrix=1e-5 * np.eye(3))},
        {"cost": Cost(torque_smoothing=0.0, effort=1e-4)},
        {"num_intervals": 3},
        {"num_intervals": 2},
    ]
    for fields in variants:
        one = problem.replace(**fields)
        guess = straight_guess(one)
        ipopt = solve_nlp(one, guess, params=KNOTS)
        assert_same(ipopt, solve_nlp(one, guess, params=OWN_KNOTS))


def test_same_optimum_of_electrical_energy() -> None:
    robot = load_robot("ur10e_class")
    problem = random_problems(robot, 1, seed=3, cost=ElectricalCost(friction_smoothing_rad_s=0.3))
    one = problem[0].replace(num_intervals=12)
    both = Families(velocity=True, acceleration=True)
    guess = straight_guess(one)
    ipopt, own = (
        solve_nlp(one, guess, params=params, families=both) for params in (KNOTS, OWN_KNOTS)
    )
    assert_same(ipopt, own)


def test_same_optimum_where_speed_and_acceleration_bind(arm) -> None:
    tight = arm.with_limits(velocity_limit_rad_s=1.0, acceleration_limit_rad_s2=4.0)
    both = Families(velocity=True, acceleration=True)
    for problem in random_problems(tight, 3, seed=3, num_intervals=20):
        guess = straight_guess(problem)
        for cost in (Cost(), Cost(effort=0.0, velocity=0.0)):
            one = problem.replace(cost=cost)
            # Time alone is flat in q: only sharp optima agree there.
            ipopt, own = (
                solve_nlp(one, guess, params=replace(params, tolerance=1e-8), families=both)
                for params in (KNOTS, OWN_KNOTS)
            )
            assert_same(ipopt, own)
            assert np.abs(own.multipliers.rows[21 * 3 :]).max() > 1e-3  # they bind
        limited = solve(problem, OWN)
        assert limited.status is Status.CONVERGED
        assert limited.cost == pytest.approx(solve(problem).cost, rel=2e-3)


def test_same_optimum_with_boxes_and_half_spaces(arm) -> None:
    problem = random_problems(arm, 1, seed=2, num_intervals=20)[0]
    problem = problem.replace(depart_rad=problem.start_rad[None] + 0.01)
    guess = straight_guess(problem)
    middle = solve_nlp(problem, guess).q_rad
    rows = PathRows(
        np.array([9, 10]),
        np.array([0.5, 0.0]),
        np.tile([0.0, 1.0, 0.0], (2, 1)),
        np.array([middle[10, 1] + 0.05, middle[10, 1] + 0.1]),
    )
    half = np.linspace(0.0, 1.0, 21)[:, None] * np.array([0.0, 1.0, 0.3]) + 0.2
    box = Box(middle - half, middle + half)
    ipopt = solve_nlp(problem, guess, box=box, rows=rows)
    own = solve_nlp(problem, guess, box=box, rows=rows, params=OWN)
    assert_same(ipopt, own)
    assert own.q_rad[10, 1] >= middle[10, 1] + 0.1 - 1e-6


def test_each_warm_starts_the_other(arm) -> None:
    problem = random_problems(arm, 1, seed=2, num_intervals=20)[0]
    guess = straight_guess(problem)
    moved = problem.replace(goal_rad=problem.goal_rad + 0.02)
    for first in (SolveParams(), OWN):
        found = solve_nlp(problem, guess, params=first)
        start = Guess(found.q_rad, found.torque_nm, found.step_s, found.multipliers)
        cold = Guess(found.q_rad, found.torque_nm, found.step_s)
        for then in (SolveParams(), OWN):
            warm = solve_nlp(moved, start, params=then)
            assert warm.status is Status.CONVERGED
            assert warm.iterations <= solve_nlp(moved, cold, params=then).iterations
            again = solve_nlp(problem, start, params=then)
            assert again.iterations <= 3
            np.testing.assert_allclose(
                again.multipliers.rows, found.multipliers.rows, atol=1e-4, rtol=1e-3
            )


def test_what_does_not_fit_goes_to_ipopt(arm) -> None:
    problem = random_problems(arm, 1, seed=2, num_intervals=8)[0]
    q, v, u, time = *(ca.SX.sym(name, 3) for name in "qvu"), ca.SX.sym("T")
    idle = PathConstraint(ca.Function("c", [q, v, u], [v[0] - v[1]]), -np.inf, np.inf)
    for limits, by in (
        (MotionLimits(jerk_limit_rad_s3=80.0), "structured"),
        (MotionLimits(rms_torque_nm=0.9 * arm.torque_limit_nm), "ipopt"),
        (MotionLimits(end_cost=EndCost(ca.Function("e", [q, v, time], [time]))), "ipopt"),
        (MotionLimits(free_goal_joints=(2,)), "ipopt"),
        (MotionLimits(path=(idle,)), "structured"),
    ):
        one = problem.replace(limits=limits)
        guess = straight_guess(one)
        assert_same(solve_nlp(one, guess), solve_nlp(one, guess, params=OWN), by)


def test_infeasible_problems_are_called_so(arm) -> None:
    problem = random_problems(arm, 1, seed=2)[0].replace(duration_s=0.05)
    own = SolveParams(solver="structured", max_iterations=150)
    assert solve(problem, own).status is Status.INFEASIBLE
    weak = arm.with_limits(torque_limit_nm=0.02 * arm.torque_limit_nm)
    held = random_problems(arm, 1, seed=4)[0]
    assert not solve(MotionProblem(weak, held.start_rad, held.goal_rad), own).status.ok


def test_iteration_limit_is_a_status(arm) -> None:
    own = SolveParams(solver="structured", max_iterations=2)
    problem = random_problems(arm, 1, num_intervals=16)[0]
    found = solve_nlp(problem, straight_guess(problem), params=own)
    assert found.status is Status.ITERATION_LIMIT
    assert (found.iterations, found.solver) == (2, "structured")


def test_start_equal_to_goal(arm) -> None:
    q = random_problems(arm, 1)[0].start_rad
    motion = solve(MotionProblem(arm, q, q), OWN)
    assert motion.status.ok
    assert motion.duration_s == pytest.approx(40 * 1e-4, rel=1e-3)


def test_same_bytes_whatever_was_solved_before(arm, planar) -> None:
    problems = [*random_problems(arm, 2, seed=8), *random_problems(planar, 1, seed=8)]
    first = [solve(problem, OWN) for problem in problems]
    second = [solve(problem, OWN) for problem in reversed(problems)][::-1]
    for a, b in zip(first, second):
        assert a.cost == b.cost
        assert a.trajectory.q_rad.tobytes() == b.trajectory.q_rad.tobytes()


def test_an_unknown_solver_is_named(arm) -> None:
    with pytest.raises(ProblemError, match=r"params\.solver"):
        SolveParams(solver="structures")
