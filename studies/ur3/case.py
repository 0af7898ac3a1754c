"""One movement of the UR3 study in one metric: swarm, gradient, and what they leave of limits."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.metrics import BUS_VOLTAGE_V
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import Robot
from dmoc.swarm import SwarmParams
from planning.collision.world import CollisionWorld
from studies.ur3.bezier_descent import DescentParams, descend_bezier
from studies.ur3.bezier_motion import BezierMotion
from studies.ur3.bezier_problem import BezierProblem, BezierResult, metric_values
from studies.ur3.bezier_swarm import PAPER_SWARM, swarm_bezier
from studies.ur3.moves import Move, movej
from studies.ur3.world import avoid_in, forbidden_in, touches

#: Metrics that every motion is judged in [J].
ENERGIES = ("energy", "iv_signed", "iv_absolute")


@dataclass(frozen=True, eq=False)
class Setting:
    """What all movements of a study share."""

    robot: Robot
    world: CollisionWorld
    duration_s: float = 3.0
    swarm: SwarmParams = PAPER_SWARM
    descent: DescentParams = DescentParams()
    solver: str = "ipopt"


@dataclass(frozen=True, eq=False)
class SolvedCase:
    """Results of a movement in one metric, and CPU seconds of each kind."""

    move: Move
    metric: str
    swarm: tuple[BezierResult, ...]
    gradient: BezierResult
    swarm_cpu_s: float
    gradient_cpu_s: float

    @property
    def best(self) -> BezierResult:
        """The cheapest feasible result of all (of the infeasible ones, if there is no other)."""
        return min((*self.swarm, self.gradient), key=lambda r: (not r.feasible, r.value))


def solve_case(
    move: Move, metric: str, setting: Setting, seeds: tuple[int, ...], gradient_seed: int = 0
) -> SolvedCase:
    """Swarm (once per seed) and gradient descent of one movement in one metric."""
    problem = BezierProblem(
        setting.robot, move.start_rad, move.goal_rad, setting.duration_s, metric
    )
    forbidden, avoid = forbidden_in(setting.world), avoid_in(setting.world)
    begin = time.process_time()
    swarm = tuple(swarm_bezier(problem, seed, setting.swarm, forbidden) for seed in seeds)
    middle = time.process_time()
    gradient = descend_bezier(problem, gradient_seed, setting.descent, forbidden, avoid)
    return SolvedCase(move, metric, swarm, gradient, middle - begin, time.process_time() - middle)


def base_energy_j(setting: Setting) -> float:
    """What controller and fans take during the movement [J]."""
    robot = setting.robot
    drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
    return drive.base_power_w * setting.duration_s


def saving(baseline: float, value: float) -> float | None:
    """Saving in percent of a baseline; None where the baseline is no positive number of joules."""
    return 100.0 * (1.0 - value / baseline) if baseline > 1e-9 else None


def viscous_floor_j(move: Move, setting: Setting) -> float:
    """What viscous friction alone takes in the |I|·V metric, along any path: V Σ f_v |Δq|/(n k_t).

    A lower bound of the friction part, not of the metric: a joint whose gravity torque helps its
    motion can take less current than its friction would.
    """
    robot = setting.robot
    drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
    travel = np.abs(move.goal_rad - move.start_rad)
    factor = BUS_VOLTAGE_V / (drive.gear_ratio * drive.torque_constant_nm_a)
    return float(np.sum(factor * drive.viscous_nm_s * travel))


def judge(motion: BezierMotion | JointTrajectory, setting: Setting) -> dict[str, Any]:
    """A motion in all energies, with base load, with what it touches and how it starts and ends.

    `kinetic_start_j` is what a motion that starts moving is given for free.
    """
    values = metric_values(motion, setting.robot, ENERGIES)
    report: dict[str, Any] = {f"{name}_j": value for name, value in values.items()}
    report["energy_with_base_j"] = values["energy"] + base_energy_j(setting)
    hit = touches(setting.world, motion)
    report["touches"] = None if hit is None else list(hit)
    if isinstance(motion, BezierMotion):
        model, data = setting.robot.model, setting.robot.model.createData()
        ends = zip(motion.control_rad[[0, -1]], motion.end_velocity_rad_s)
        kinetic = [pin.computeKineticEnergy(model, data, np.array(q), np.array(v)) for q, v in ends]
        report["kinetic_start_j"], report["kinetic_end_j"] = kinetic
        report["limit_use"] = motion.limit_use(setting.robot)
    return report


def case_report(found: SolvedCase, setting: Setting) -> dict[str, Any]:
    """What the study prints of one movement in one metric."""
    baseline = judge(movej(found.move, setting.robot, setting.duration_s), setting)
    start = baseline[f"{found.metric}_j"]
    values = np.array([result.value for result in found.swarm])
    percent = [saving(start, float(value)) for value in values]
    known = [p for p in percent if p is not None]
    return {
        "metric": found.metric,
        "baseline_j": start,
        "swarm": {
            "values_j": values.tolist(),
            "median_j": float(np.median(values)),
            "saving_percent": percent,
            "median_saving_percent": float(np.median(known)) if known else None,
            "feasible": [result.feasible for result in found.swarm],
            "evaluations": [result.evaluations for result in found.swarm],
            "best": judge(min(found.swarm, key=lambda r: r.value).motion, setting),
        },
        "gradient": {
            "value_j": found.gradient.value,
            "saving_percent": saving(start, found.gradient.value),
            "feasible": found.gradient.feasible,
            "evaluations": found.gradient.evaluations,
            "best": judge(found.gradient.motion, setting),
        },
        "gradient_below_swarm_median": bool(found.gradient.value < np.median(values)),
        "gradient_below_swarm_best": bool(found.gradient.value < values.min()),
    }
