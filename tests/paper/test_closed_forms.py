"""Optima that are known otherwise: closed form, and a fine collocation."""

import casadi as ca
import numpy as np
import pytest

from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.status import Status
from dmoc.programme.types import Guess
from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve
from dmoc.solving.solvers import SolveParams

EFFORT_ONLY = Cost(time=0.0, effort=1.0, velocity=0.0, torque_smoothing=0.0)


def write_robot(folder, axis: str, mass: float, lever: str, effort: float):
    folder.mkdir(exist_ok=True)
    (folder / "one.urdf").write_text(
        "<robot name='one'><link name='base'/><link name='body'><inertial>"
        f"<origin xyz='{lever}'/><mass value='{mass}'/>"
        "<inertia ixx='1e-6' iyy='1e-6' izz='1e-6' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        f"<joint name='j' type='revolute'><parent link='base'/><child link='body'/>"
        f"<axis xyz='{axis}'/><limit lower='-6' upper='6' velocity='50' effort='{effort}'/>"
        "</joint></robot>"
    )
    (folder / "robot.yaml").write_text("acceleration_limit_rad_s2: [1000.0]\n")
    return load_robot(folder / "one.urdf")


@pytest.mark.parametrize("count", [20, 40, 80])
def test_minimum_effort_double_integrator(tmp_path, count: int) -> None:
    """∫u² over a rest-to-rest turn of an inertia by d in T: 12 I² d²/T³, torque linear in time.

    A vertical axis, so gravity has no part in it.
    """
    inertia, distance, duration = 3.0, 1.5, 2.0
    robot = write_robot(tmp_path / "disc", "0 0 1", inertia, "1 0 0", 1000.0)
    problem = MotionProblem(
        robot, [0.0], [distance], EFFORT_ONLY, num_intervals=count, duration_s=duration
    )
    motion = solve(problem)
    assert motion.status is Status.CONVERGED
    exact = 12 * inertia**2 * distance**2 / duration**3
    # The rule is second order; its own optimum over N intervals exceeds this by less than 4/N².
    assert motion.cost == pytest.approx(exact, rel=4 / count**2)
    t = (np.arange(count) + 0.5) / count
    expected = 6 * inertia * distance / duration**2 * (1 - 2 * t)
    np.testing.assert_allclose(
        motion.trajectory.torque_nm[:, 0], expected, atol=8 / count**2 * np.abs(expected).max()
    )


def collocation_swing_up(mass, length, duration, limit, count, guess) -> float:
    """Hermite–Simpson on (angle, speed), its own dynamics m l² q̈ = u − m g l sin q."""
    h = duration / count
    inertia = mass * length**2 + 1e-6

    def f(x, u):
        return ca.vertcat(x[1], (u - mass * 9.81 * length * ca.sin(x[0])) / inertia)

    opti = ca.Opti()
    x, u, um = opti.variable(2, count + 1), opti.variable(1, count + 1), opti.variable(1, count)
    cost = 0
    for k in range(count):
        a, b = f(x[:, k], u[k]), f(x[:, k + 1], u[k + 1])
        middle = (x[:, k] + x[:, k + 1]) / 2 + h / 8 * (a - b)
        m = f(middle, um[k])
        opti.subject_to(x[:, k + 1] - x[:, k] == h / 6 * (a + 4 * m + b))
        cost += h / 6 * (u[k] ** 2 + 4 * um[k] ** 2 + u[k + 1] ** 2)
    opti.subject_to(opti.bounded(-limit, u, limit))
    opti.subject_to(opti.bounded(-limit, um, limit))
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[:, count] == ca.DM([np.pi, 0]))
    opti.minimize(cost)
    opti.set_initial(x[0, :], np.interp(np.linspace(0, 1, count + 1), *guess))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    return float(opti.solve().value(cost))


def test_pendulum_swing_up_equals_a_fine_collocation(tmp_path) -> None:
    """The motor holds a third of the weight, so the pendulum must swing back first."""
    mass, length, duration = 1.0, 0.8, 3.0
    limit = 0.45 * mass * 9.81 * length
    robot = write_robot(tmp_path / "pendulum", "0 1 0", mass, f"0 0 {-length}", limit)
    problem = MotionProblem(
        robot, [0.0], [np.pi], EFFORT_ONLY, num_intervals=80, duration_s=duration
    )
    shape = (np.array([0.0, 0.2, 0.45, 0.7, 1.0]), np.array([0.0, 0.5, -1.0, 1.2, np.pi]))
    q = np.interp(np.linspace(0, 1, 81), *shape)[:, None]
    q[-1] = np.pi
    motion = solve(problem, SolveParams(), Guess(q, np.zeros((80, 1)), duration / 80))
    assert motion.status is Status.CONVERGED
    fine = collocation_swing_up(mass, length, duration, limit, 200, shape)
    assert motion.cost == pytest.approx(fine, rel=0.01)
