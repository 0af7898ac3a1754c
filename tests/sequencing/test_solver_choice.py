"""Solver and method by name: one registry, named in the result; either solver, the same cycle."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmoc.errors import InputError, ProblemError
from dmoc.motion.motion import MotionProblem
from dmoc.programme.guess import straight_guess
from dmoc.robot.robot import load_robot
from dmoc.solving.nlp import solve_nlp
from dmoc.solving.solvers import DEFAULT_SOLVER, SOLVERS, SolveParams
from planning.path import rrt_connect
from planning.station.build import demo_station
from sequencing.commands.study import StudyOptions
from sequencing.cycle.plan import PlanStop, plan_station
from sequencing.cycle_types import Cycle
from sequencing.edges.worker import context_fingerprint
from sequencing.runs.folder import write_run
from studies import command


@pytest.mark.parametrize("wrong", [{"solver": "magic"}, {"method": "spheres"}])
def test_what_there_is_none_of_is_said_before_anything_is_planned(wrong) -> None:
    (name,) = wrong
    legal = "ipopt, structured" if name == "solver" else "half-spaces, boxes"
    with pytest.raises(ProblemError) as caught:
        plan_station(demo_station("stud_welding_a_8"), **wrong)
    fault = caught.value.faults[0]
    assert (fault.field, fault.legal) == (name, legal)


def test_every_solver_of_the_registry_is_asked_by_its_name(monkeypatch) -> None:
    robot = load_robot("planar2")
    problem = MotionProblem(robot, np.array([0.1, 0.2]), np.array([0.6, -0.3]), num_intervals=12)
    asked = []
    for name, real in list(SOLVERS.items()):
        counted = lambda *given, name=name, real=real: asked.append(name) or real(*given)  # noqa: E731
        monkeypatch.setitem(SOLVERS, name, counted)
    found = {
        name: solve_nlp(problem, straight_guess(problem), params=SolveParams(solver=name))
        for name in SOLVERS
    }
    assert asked == list(SOLVERS)
    assert {name: item.solver for name, item in found.items()} == {name: name for name in SOLVERS}
    costs = [item.cost for item in found.values()]
    assert np.ptp(costs) < 1e-5 * max(costs)


def test_edges_of_another_solver_or_method_are_other_edges() -> None:
    station = demo_station("stud_welding_a_8")
    keys = {
        context_fingerprint(station, method, solver)
        for method in ("halfspaces", "boxes")
        for solver in SOLVERS
    }
    assert len(keys) == 4
    assert context_fingerprint(station, "boxes") == context_fingerprint(
        station, "boxes", DEFAULT_SOLVER
    )


def test_the_result_says_who_plans_where_ompl_is_not_installed(monkeypatch) -> None:
    assert rrt_connect.available_planner() == "ompl"
    monkeypatch.setattr(rrt_connect, "ob", None)
    assert rrt_connect.available_planner() == "compiled"


def test_a_study_refuses_what_it_has_no_use_for() -> None:
    with pytest.raises(InputError, match="--solver"):
        command.pallet_cell(None, StudyOptions(solver="ipopt"))
    with pytest.raises(InputError, match="--method"):
        command.ur3(None, StudyOptions(method="boxes"))


def few_studs() -> Cycle:
    """Two studs of the demo by Ipopt, with the boxes of the paper."""
    station = demo_station("stud_welding_a_8")
    station = replace(station, studs=station.studs[:2], spin_steps=1, precedence=())
    stop = PlanStop(training_edges=2, coverage_edges=1, baseline_draws=1)
    return plan_station(station, stop=stop, solver="ipopt", method="boxes")


@pytest.mark.slow
def test_result_json_names_solver_planner_and_method(tmp_path: Path) -> None:
    cycle = few_studs()
    write_run(cycle, tmp_path, {})
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert [result[name] for name in ("solver", "planner", "method")] == ["ipopt", "ompl", "boxes"]
    for motion in result["motions"]:
        assert motion["solver"] in ("ipopt", "none")
        assert motion["planner"] in ("ompl", "none")
        assert motion["method"] in ("free", "boxes", "time-scaled")


@pytest.mark.slow
def test_the_demo_planned_by_either_solver_is_the_same_cycle() -> None:
    station = demo_station("stud_welding_a_8")
    one, two = (plan_station(station, seed=0, solver=name) for name in ("structured", "ipopt"))
    assert {m.motion.solver for m in two.motions} == {"ipopt"}
    orders = [[(w.stud, w.alternative) for w in cycle.welds] for cycle in (one, two)]
    assert orders[0] in (orders[1], orders[1][::-1])
    costs = [cycle.tables.energy_based.total for cycle in (one, two)]
    assert abs(costs[0] - costs[1]) <= 1e-3 * costs[0]
