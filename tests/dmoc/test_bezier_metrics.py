"""Metrics by name, their gradients, and batched evaluation of Bézier problems."""

import numpy as np
import pytest

from dmoc.errors import ProblemError
from dmoc.physics.metrics import METRICS
from dmoc.robot.robot import load_robot
from studies.ur3.bezier_problem import BezierProblem, Evaluator, metric_values
from tests.naive.naive_bezier import energies

START = np.deg2rad([-45.0, -75, 95, -110, -90, 0])
GOAL = np.deg2rad([45.0, -65, 80, -105, -80, 20])


def problem(metric: str, **changes) -> BezierProblem:
    return BezierProblem(load_robot("ur3e_class"), START, GOAL, 3.0, metric, **changes)


def point(seed: int) -> np.ndarray:
    p = problem("energy")
    offset = np.random.default_rng(seed).uniform(-0.3, 0.3, 30)
    return np.clip(p.straight + offset, *p.bounds)


def test_energies_agree_with_plain_loops() -> None:
    p, x = problem("energy"), point(1)
    expected = energies(p.robot, p.controls(x), 3.0, 40)
    found = metric_values(p.motion(x), p.robot, tuple(expected), num_samples=40)
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("metric", METRICS)
def test_batch_is_the_sum_of_single_curves(metric: str) -> None:
    p = problem(metric)
    points = np.stack([point(k) for k in range(5)])
    found = Evaluator(p).evaluate(points).cost
    single = [metric_values(p.motion(x), p.robot, (metric,), p.num_samples)[metric] for x in points]
    np.testing.assert_allclose(found, single, rtol=1e-9)


@pytest.mark.parametrize("metric", METRICS)
def test_gradient_agrees_with_finite_differences(metric: str) -> None:
    # At one second velocity and acceleration limits are exceeded, so their penalty counts, too.
    evaluator, x, step = Evaluator(problem(metric, num_samples=16)), point(2), 1e-6
    for smoothing, price in ((0.05, 0.0), (0.02, 100.0)):
        tight = Evaluator(
            BezierProblem(
                load_robot("ur3e_class").with_limits(velocity_limit_rad_s=0.3),
                START,
                GOAL,
                3.0,
                metric,
                num_samples=16,
            )
        )
        used = evaluator if price == 0 else tight
        _, gradient = used.descend(x, smoothing, price)
        numeric = [
            (used.descend(x + d, smoothing, price)[0] - used.descend(x - d, smoothing, price)[0])
            / (2 * step)
            for d in step * np.eye(30)
        ]
        np.testing.assert_allclose(gradient, numeric, atol=2e-6 * np.abs(gradient).max())


def test_hysteresis_root_friction_and_inverter_losses_are_in_the_gradient() -> None:
    from dataclasses import replace
    from types import MappingProxyType

    robot = load_robot("ur3e_class")
    lossy = MappingProxyType(
        dict(robot.drive)
        | {
            "root_friction_nm_s": 0.7,
            "hysteresis_w_s": 0.003,
            "eddy_w_s2": 2e-5,
            "inverter_v": 0.5,
            "inverter_ohm": 0.02,
            "extra_inertia_kg_m2": 0.1,
        }
    )
    robot = replace(robot, drive=lossy)
    evaluator = Evaluator(BezierProblem(robot, START, GOAL, 3.0, "energy", num_samples=16))
    x, step = point(3), 1e-6
    _, gradient = evaluator.descend(x, 0.05, 0.0)
    numeric = [
        (evaluator.descend(x + d, 0.05, 0.0)[0] - evaluator.descend(x - d, 0.05, 0.0)[0])
        / (2 * step)
        for d in step * np.eye(30)
    ]
    np.testing.assert_allclose(gradient, numeric, atol=2e-6 * np.abs(gradient).max())


def test_excess_tells_legal_from_illegal() -> None:
    robot = load_robot("ur3e_class")
    p = BezierProblem(robot, START, GOAL, 3.0)
    slow = BezierProblem(robot.with_limits(velocity_limit_rad_s=0.2), START, GOAL, 3.0)
    x = p.straight[None]
    assert Evaluator(p).evaluate(x).excess[0] == 0.0
    assert Evaluator(slow).evaluate(x).excess[0] > 1.0


def test_signed_reading_rewards_torque_of_the_right_sign() -> None:
    """ΣI·V as printed is negative for an arm that merely holds its own weight."""
    values = metric_values(
        problem("energy").motion(problem("energy").straight),
        load_robot("ur3e_class"),
        ("iv_signed", "energy"),
    )
    assert values["iv_signed"] < 0 < values["energy"]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"metric": "energie"}, "metric"),
        ({"duration_s": -1.0}, "duration_s"),
        ({"box_rad": 1.0}, "start_rad"),
        ({"num_samples": 2}, "num_samples"),
    ],
)
def test_bad_problems_are_named(changes: dict, named: str) -> None:
    with pytest.raises(ProblemError) as caught:
        BezierProblem(
            **{"robot": load_robot("ur3e_class"), "start_rad": START, "goal_rad": GOAL, **changes}
        )
    assert named in str(caught.value)
