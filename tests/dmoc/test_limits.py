"""Costs and limits beyond the default: each binds, each is checked outside the solver."""

import casadi as ca
import numpy as np
import pytest
from random_arms import random_problems, random_robot

from dmoc.errors import ProblemError
from dmoc.motion.constraints import EndCondition, EndCost, MotionLimits, PathConstraint, TorqueSpeed
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.status import Status
from dmoc.physics.resimulation import replay_motion
from dmoc.programme.guess import guess_from_trajectory, straight_guess
from dmoc.programme.types import Box, PathRows
from dmoc.robot.drive import drive_from_mapping, electrical_power_w
from dmoc.robot.robot import load_robot
from dmoc.solving.nlp import solve_nlp
from dmoc.solving.solver import solve
from dmoc.solving.solvers import SolveParams


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return random_robot(5, tmp_path_factory.mktemp("arms"), 3)


@pytest.fixture(scope="module")
def problem(arm):
    return random_problems(arm, 1, seed=2)[0]


@pytest.fixture(scope="module")
def plain(problem):
    return solve(problem).require(problem)


def step_of(motion) -> float:
    return motion.duration_s / motion.trajectory.num_intervals


def symbols(n: int):
    return [ca.SX.sym(name, n) for name in ("q", "v", "u")]


def test_jerk(problem, plain) -> None:
    """Of the executed curve: from interval to interval, from and to standstill."""

    def jerk(motion):
        h, still = step_of(motion), np.zeros((1, 3))
        a = np.diff(motion.trajectory.velocity_rad_s, axis=0) / h
        return np.abs(np.diff(np.vstack([still, a, still]), axis=0)) / h

    limit = 0.3 * jerk(plain).max()
    motion = solve(problem.replace(limits=MotionLimits(jerk_limit_rad_s3=limit)))
    assert motion.status is Status.CONVERGED
    assert limit * 0.97 <= jerk(motion).max() <= limit * 1.0051
    assert motion.cost > plain.cost
    robot = problem.robot.with_limits(jerk_limit_rad_s3=limit)
    assert robot.fingerprint != problem.robot.fingerprint
    assert solve(problem.replace(robot=robot)).cost == motion.cost


def test_rms_torque(problem, plain) -> None:
    def rms(motion):
        return np.sqrt(np.mean(motion.trajectory.torque_nm**2, axis=0))

    limit = rms(plain) * np.array([1.0, 0.97, 1.0])
    motion = solve(problem.replace(limits=MotionLimits(rms_torque_nm=limit)))
    assert motion.status is Status.CONVERGED
    assert np.all(rms(motion) <= limit * (1 + 1e-5))
    assert motion.cost > plain.cost


def test_torque_over_speed(problem, plain) -> None:
    def load(motion, curve):
        v = np.diff(motion.trajectory.q_rad, axis=0) / step_of(motion)
        return np.abs(
            motion.trajectory.torque_nm / curve.stall_torque_nm + v / curve.no_load_speed_rad_s
        ).max()

    robot = problem.robot
    curve = TorqueSpeed(robot.torque_limit_nm, 1.5 * robot.velocity_limit_rad_s)
    share = load(plain, curve)
    tight = TorqueSpeed(
        0.9 * share * robot.torque_limit_nm, 1.35 * share * robot.velocity_limit_rad_s
    )
    motion = solve(problem.replace(limits=MotionLimits(torque_speed=tight)))
    assert motion.status is Status.CONVERGED
    assert load(motion, tight) == pytest.approx(1.0, abs=1e-4)
    assert motion.cost > plain.cost


def test_a_user_path_constraint(problem, plain) -> None:
    """The sum of all joint speeds squared."""
    q, v, u = symbols(3)
    function = ca.Function("speed", [q, v, u], [ca.sumsqr(v)])

    def speed(motion):
        return np.sum((np.diff(motion.trajectory.q_rad, axis=0) / step_of(motion)) ** 2, axis=1)

    limit = 0.6 * speed(plain).max()
    constraint = PathConstraint(function, -np.inf, limit)
    motion = solve(problem.replace(limits=MotionLimits(path=(constraint,))))
    assert motion.status is Status.CONVERGED
    assert speed(motion).max() == pytest.approx(limit, rel=1e-4)


def test_a_free_goal_joint_and_end_cost(problem, plain) -> None:
    """With a quadratic price on the last joint's distance to its goal the end drifts from it."""
    q, v = ca.SX.sym("q", 3), ca.SX.sym("v", 3)
    time = ca.SX.sym("T")
    pull = ca.Function("pull", [q, v, time], [5.0 * (q[2] - problem.goal_rad[2]) ** 2])
    limits = MotionLimits(free_goal_joints=(2,), end_cost=EndCost(pull))
    motion = solve(problem.replace(limits=limits))
    assert motion.status is Status.CONVERGED
    assert motion.cost < plain.cost
    end = motion.trajectory.q_rad[-1]
    np.testing.assert_allclose(end[:2], problem.goal_rad[:2])
    assert abs(end[2] - problem.goal_rad[2]) > 1e-3
    held = EndCondition(ca.Function("held", [q, v, time], [q[2] - problem.goal_rad[2] - 0.1]))
    motion = solve(problem.replace(limits=MotionLimits(free_goal_joints=(2,), end=(held,))))
    assert motion.status is Status.CONVERGED
    assert motion.trajectory.q_rad[-1, 2] == pytest.approx(problem.goal_rad[2] + 0.1, abs=1e-6)


def test_a_free_last_velocity_is_cheaper(problem, plain) -> None:
    motion = solve(problem.replace(limits=MotionLimits(free_goal_velocity=True)))
    assert motion.status is Status.CONVERGED
    assert motion.cost < plain.cost
    last = motion.trajectory.velocity_rad_s[-1]
    assert np.all(np.abs(last) <= problem.robot.velocity_limit_rad_s * (1 + 1e-6))
    assert np.abs(last).max() > 0.01


def test_matrices_equal_scalars_where_they_should(problem, plain) -> None:
    n = 3
    state = np.zeros((2 * n, 2 * n))
    state[n:, n:] = np.eye(n)
    cost = Cost(effort=0.0, velocity=0.0, state_matrix=state, torque_matrix=1e-6 * np.eye(n))
    motion = solve(problem.replace(cost=cost))
    assert motion.cost == pytest.approx(plain.cost, rel=1e-6)
    np.testing.assert_allclose(motion.trajectory.q_rad, plain.trajectory.q_rad, atol=1e-4)
    heavy = Cost(torque_matrix=np.diag([1.0, 0.0, 0.0]) * 1e-4)
    biased = solve(problem.replace(cost=heavy))
    first = [float(np.sum(m.trajectory.torque_nm[:, 0] ** 2)) * step_of(m) for m in (biased, plain)]
    assert first[0] < first[1]
    with pytest.raises(ProblemError, match="semidefinite"):
        Cost(torque_matrix=-np.eye(n))


def test_electrical_cost_saves_joules() -> None:
    """Cheaper in joules than the motion of the quadratic cost, at the same duration."""
    robot = load_robot("ur10e_class")
    problem = random_problems(robot, 1, seed=5)[0]
    plain = solve(problem).require()
    midpoints = ElectricalCost(transcription="paper")
    electrical = problem.replace(cost=midpoints, duration_s=plain.duration_s)
    motion = solve(electrical)
    assert motion.status.ok
    drive = drive_from_mapping(robot.drive, 6)

    def energy(m) -> float:
        v = np.diff(m.trajectory.q_rad, axis=0) / step_of(m)
        power = electrical_power_w(v, 0 * v, m.trajectory.torque_nm, drive, 0.05)
        return float(np.sum(power) * step_of(m))

    assert motion.cost == pytest.approx(energy(motion) + motion.duration_s, rel=1e-6)
    assert energy(motion) < energy(plain)


def test_a_wrench_is_felt_and_simulated(problem, plain) -> None:
    pushed = problem.replace(wrench=[0.0, 0.0, -100.0, 0.0, 20.0, 0.0])
    motion = solve(pushed)
    assert motion.status is Status.CONVERGED
    assert motion.cost != pytest.approx(plain.cost, rel=1e-4)
    right = replay_motion(motion, wrench=pushed.wrench).replay_error_rad
    wrong = replay_motion(motion).replay_error_rad
    assert right < 0.02
    assert wrong > 2 * right


def test_boxes_and_half_spaces(problem, plain) -> None:
    """A half-space that the free optimum violates is touched; a box around the optimum is kept."""
    count, n = 40, 3
    middle = plain.trajectory.q_rad[20]
    gradient = np.array([[0.0, 1.0, 0.0]])
    bound = np.array([middle[1] + 0.1])
    rows = PathRows(np.array([20]), np.array([0.0]), gradient, bound)
    guess = straight_guess(problem)
    solution = solve_nlp(problem, guess, rows=rows)
    assert solution.status is Status.CONVERGED
    assert solution.q_rad[20, 1] == pytest.approx(bound[0], abs=1e-6)
    assert solution.cost > plain.cost
    # The same rows cut by a box that makes them idle change nothing.
    half = 0.05
    box = Box(plain.trajectory.q_rad - half, plain.trajectory.q_rad + half)
    idle = PathRows(np.array([3]), np.array([0.5]), gradient, np.array([-100.0]))
    start = guess_from_trajectory(problem, plain.trajectory)
    inside = solve_nlp(problem, start, box=box, rows=idle)
    assert inside.cost == pytest.approx(plain.cost, rel=1e-6)
    many = PathRows(
        np.repeat(np.arange(count), 12),
        np.tile(np.linspace(0, 0.9, 12), count),
        np.tile(np.eye(n)[1], (12 * count, 1)),
        np.full(12 * count, -2.0),
    )
    crowded = solve_nlp(problem, guess, rows=many)
    assert crowded.status is Status.CONVERGED
    assert crowded.q_rad[:, 1].min() >= -2.0 - 1e-6


def test_warm_start_takes_fewer_iterations(problem, plain) -> None:
    cold = solve_nlp(problem, straight_guess(problem))
    from dmoc.programme.types import Guess

    moved = problem.replace(goal_rad=problem.goal_rad + 0.02)
    again = solve_nlp(moved, Guess(cold.q_rad, cold.torque_nm, cold.step_s, cold.multipliers))
    fresh = solve_nlp(moved, straight_guess(moved))
    assert again.status is Status.CONVERGED
    assert again.cost == pytest.approx(fresh.cost, rel=1e-6)
    assert again.iterations < fresh.iterations


@pytest.mark.parametrize("field", ["jerk_limit_rad_s3", "rms_torque_nm"])
def test_bad_limits_are_named(field: str) -> None:
    with pytest.raises(ProblemError, match=field):
        MotionLimits(**{field: 0.0})


def test_bad_functions_are_named() -> None:
    q = ca.SX.sym("q", 3)
    with pytest.raises(ProblemError, match="constraint-function"):
        PathConstraint(ca.Function("f", [q], [q]), 0.0, 1.0)
    a, b, c = symbols(3)
    three = ca.Function("f", [a, b, c], [a])
    with pytest.raises(ProblemError, match="constraint-range"):
        PathConstraint(three, 1.0, 0.0)


def test_a_box_without_a_point_is_infeasible(problem) -> None:
    upside_down = Box(np.full((41, 3), 0.5), np.full((41, 3), -0.5))
    assert solve_nlp(problem, straight_guess(problem), box=upside_down).status is Status.INFEASIBLE


def test_an_unknown_solver_is_refused() -> None:
    with pytest.raises(ProblemError, match=r"params\.solver"):
        SolveParams(solver="magic")
