"""Numbers printed in Vysocký et al. (2020), Reduction in Robotic Arm Energy Consumption by PSO."""

import numpy as np
import pytest

from dmoc.robot.robot import load_robot
from studies.ur3.bezier_motion import bernstein
from studies.ur3.bezier_problem import BezierProblem
from studies.ur3.bezier_swarm import END_STEP_RAD, FREE_STEP_RAD, PAPER_SWARM
from studies.ur3.study import PAPER_SAVING_PERCENT


def test_table_1() -> None:
    assert PAPER_SWARM.iterations == 250
    assert PAPER_SWARM.particles == 30
    assert (PAPER_SWARM.inertia, PAPER_SWARM.cognitive, PAPER_SWARM.social) == (0.81, 0.495, 0.724)
    assert (END_STEP_RAD, FREE_STEP_RAD) == (0.1, 0.2)
    problem = BezierProblem(load_robot("ur3e_class"), np.zeros(6), np.full(6, 0.5))
    assert problem.bounds[0].size == 30
    assert problem.box_rad == 6.28
    assert problem.end_range_rad == 0.1


def test_equation_3_holds_for_table_1() -> None:
    assert PAPER_SWARM.inertia > 0.5 * (PAPER_SWARM.cognitive + PAPER_SWARM.social) - 1


def test_equations_4_and_5() -> None:
    """B_{6,2}(1/4) = 15 · (1/4)² · (3/4)⁴; the basis sums to one."""
    basis = bernstein(np.array([0.25]), 6)
    assert basis[0, 2] == pytest.approx(15 * 0.25**2 * 0.75**4)
    assert basis.sum() == pytest.approx(1.0)


def test_table_2_percentages_follow_from_its_joules() -> None:
    joules = {"A": (495, 377), "B": (634, 400), "C": (340, 305), "D": (400, 335)}
    for kind, (before, after) in joules.items():
        # A is 23.8 % and printed as 23, B is 36.9 % and printed as 37.
        assert abs(100 * (1 - after / before) - PAPER_SAVING_PERCENT[kind]) < 1.0
