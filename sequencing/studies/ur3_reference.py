"""Free-form optimal control with the electrical cost: the reference that Bézier curves approach."""

from __future__ import annotations

import time
from typing import Any

from dmoc.bezier_problem import BezierResult
from dmoc.cost import ElectricalCost
from dmoc.guess import guess_from_trajectory
from dmoc.knot_descent import polish_trajectory
from dmoc.motion import MotionProblem
from dmoc.nlp_types import IpoptParams
from dmoc.solver import solve
from dmoc.trajectory import JointTrajectory
from sequencing.studies.ur3_case import Setting
from sequencing.studies.ur3_moves import Move
from sequencing.studies.ur3_world import touches

__all__ = ["free_form"]


def free_form(
    move: Move, best: BezierResult, setting: Setting, num_intervals: int = 40
) -> tuple[dict[str, Any], JointTrajectory | None, float]:
    """Optimal control from the best Bézier motion, same end velocities; report, curve, CPU [s].

    The solver's friction is rounded near standstill, so its curve is polished on the exact model
    before both are judged on the same fine replay. `bezier_j` and `free_form_j` are those values.
    """
    robot = setting.robot
    begin = time.process_time()
    first, last = best.motion.end_velocity_rad_s
    problem = MotionProblem(
        robot, move.start_rad, move.goal_rad, ElectricalCost(time=0.0, torque_smoothing=1e-3),
        num_intervals, first, last, setting.duration_s,
    )  # fmt: skip
    guess = guess_from_trajectory(problem, best.motion.trajectory(robot, num_intervals))
    motion = solve(problem, IpoptParams(max_iterations=500), guess)
    report: dict[str, Any] = {
        "status": motion.status.value,
        "iterations": motion.iterations,
        "num_intervals": num_intervals,
        "programme_j": motion.cost,
        "max_defect": motion.max_defect,
        "bezier_j": best.value,
    }
    if motion.trajectory is None:
        return report, None, time.process_time() - begin
    curve, value = polish_trajectory(motion.trajectory, robot, "energy")
    hit = touches(setting.world, curve)
    report |= {
        "free_form_j": value,
        "bezier_above_percent": 100.0 * (best.value - value) / abs(value),
        "bezier_below": bool(best.value < value),
        "touches": None if hit is None else list(hit),
    }
    return report, curve, time.process_time() - begin
