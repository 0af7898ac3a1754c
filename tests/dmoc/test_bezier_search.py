"""Swarm, gradient and free-form polish over Bézier motions."""

from dataclasses import replace

import numpy as np
import pytest

from dmoc.robot.robot import load_robot
from studies.ur3.bezier_descent import DescentParams, descend_bezier
from studies.ur3.bezier_problem import BezierProblem, metric_values
from studies.ur3.bezier_swarm import PAPER_SWARM, swarm_bezier
from studies.ur3.knot_descent import hermite, polish_trajectory, still_joints

ROBOT = load_robot("ur3e_class")
START = np.deg2rad([-45.0, -75, 95, -110, -90, 0])
GOAL = np.deg2rad([45.0, -65, 80, -105, -90, 0])
SHORT = replace(PAPER_SWARM, iterations=40)


def problem(metric: str = "iv_absolute", **changes) -> BezierProblem:
    return BezierProblem(ROBOT, START, GOAL, **{"metric": metric, **changes})


def test_paper_parameters() -> None:
    p = PAPER_SWARM
    assert (p.particles, p.iterations) == (30, 250)
    assert (p.inertia, p.cognitive, p.social) == (0.810, 0.495, 0.724)
    lower, upper = problem().bounds
    assert lower.size == 30
    np.testing.assert_allclose((upper - lower)[:6], 0.2)
    np.testing.assert_allclose((upper - lower)[6:9], [12.56, 12.56, 2 * np.pi])


def test_swarm_improves_repeats_and_keeps_limits() -> None:
    straight = metric_values(problem().motion(problem().straight), ROBOT, ("iv_absolute",))
    first, second = (swarm_bezier(problem(), 3, SHORT) for _ in range(2))
    np.testing.assert_array_equal(first.motion.control_rad, second.motion.control_rad)
    assert first.value < straight["iv_absolute"]
    assert first.feasible
    assert (np.diff(first.history) <= 0).all()
    lower, upper = problem().bounds
    inner = first.motion.control_rad[1:-1].ravel()
    assert (inner >= lower).all()
    assert (inner <= upper).all()


def test_gradient_is_better_than_a_short_swarm() -> None:
    swarm = swarm_bezier(problem("energy"), 0, SHORT)
    gradient = descend_bezier(problem("energy"), 0)
    assert gradient.feasible
    assert gradient.value < swarm.value


def test_gradient_leaves_idle_joints_alone() -> None:
    found = descend_bezier(problem("energy"), 0)
    assert np.ptp(found.motion.control_rad[:, 4:], axis=0).max() == 0.0


@pytest.mark.parametrize("search", ["swarm", "gradient"])
def test_tight_limits_are_enforced(search: str) -> None:
    slow = ROBOT.with_limits(
        velocity_limit_rad_s=np.array([1.0, 0.3, 0.3, 0.3, 0.3, 0.3]),
        acceleration_limit_rad_s2=2.5,
    )
    p = BezierProblem(slow, START, GOAL, 3.0, "iv_absolute")
    free = descend_bezier(problem(), 0)
    assert max(free.motion.limit_use(slow).values()) > 1.2
    found = swarm_bezier(p, 0, SHORT) if search == "swarm" else descend_bezier(p, 0)
    assert found.feasible
    assert max(found.limits.values()) <= 1.0


def test_forbidden_region_is_left() -> None:
    """The elbow may not fold beyond 2 rad: the optimum without that rule does."""

    def forbidden(curves: np.ndarray) -> np.ndarray:
        return (curves[..., 2] > 2.0).any(axis=-1)

    def avoid(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        over = np.maximum(q[:, 2] - 1.9, 0.0)
        slope = np.zeros_like(q)
        slope[:, 2] = 2e4 * over
        return 1e4 * over**2, slope

    free = descend_bezier(problem(), 0)
    assert free.motion.derivative(np.linspace(0, 3, 99), 0)[:, 2].max() > 2.0
    for found in (
        swarm_bezier(problem(), 0, SHORT, forbidden),
        descend_bezier(problem(), 0, DescentParams(), forbidden, avoid),
        descend_bezier(problem(), 0, DescentParams(), forbidden),
    ):
        assert found.feasible
        assert found.motion.derivative(np.linspace(0, 3, 99), 0)[:, 2].max() <= 2.01
        assert found.value > free.value


def test_a_search_that_finds_nothing_legal_says_so() -> None:
    nothing = swarm_bezier(
        problem(), 0, replace(SHORT, iterations=3), lambda curves: np.ones(len(curves), dtype=bool)
    )
    assert not nothing.feasible
    assert nothing.note
    assert np.isinf(nothing.history).all()


def test_rest_to_rest_costs_more_than_moving_ends() -> None:
    rest = descend_bezier(problem("energy", end_range_rad=0.0), 0)
    assert np.abs(rest.motion.end_velocity_rad_s).max() == 0.0
    assert rest.value > descend_bezier(problem("energy"), 0).value


def test_hermite_basis_is_the_interpolant() -> None:
    curve = descend_bezier(problem("energy"), 0, DescentParams(starts=1)).motion.trajectory(ROBOT)
    t = np.linspace(0, 3, 333)
    knots = np.vstack([curve.q_rad, curve.velocity_rad_s])
    sample = curve.sample(t)
    for order, expected in enumerate(sample[:3]):
        found = hermite(t, curve.t_s, order) @ knots
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_polish_never_costs_more_and_keeps_the_ends() -> None:
    motion = descend_bezier(problem("energy"), 0, DescentParams(starts=1)).motion
    curve = motion.trajectory(ROBOT, 30)
    before = metric_values(curve, ROBOT, ("energy",))["energy"]
    polished, value = polish_trajectory(curve, ROBOT, "energy")
    assert value < before
    for k in (0, -1):
        np.testing.assert_array_equal(polished.q_rad[k], curve.q_rad[k])
        np.testing.assert_array_equal(polished.velocity_rad_s[k], curve.velocity_rad_s[k])


def test_creeping_joints_are_held_still() -> None:
    motion = problem("energy").motion(problem("energy").straight)
    curve = motion.trajectory(ROBOT, 30)
    q = np.array(curve.q_rad)
    q[1:-1, 5] += 1e-4 * np.sin(np.linspace(0, np.pi, 29))
    crept = replace(curve, q_rad=q)
    held, value = still_joints(crept, ROBOT, "energy")
    assert np.ptp(held.q_rad[:, 5]) == 0.0
    assert value < metric_values(crept, ROBOT, ("energy",))["energy"]
