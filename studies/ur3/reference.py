"""Free-form optimal control with the electrical cost: the reference that Bézier curves approach."""

from __future__ import annotations

import time
from typing import Any

from dmoc.motion.cost import ElectricalCost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory
from dmoc.programme.guess import guess_from_trajectory
from dmoc.solving.solver import solve
from dmoc.solving.solvers import SolveParams
from studies.ur3.bezier_problem import BezierResult
from studies.ur3.case import Setting
from studies.ur3.knot_descent import polish_trajectory
from studies.ur3.moves import Move
from studies.ur3.world import touches

INTERVALS = 40


def free_form(
    move: Move, best: BezierResult, setting: Setting
) -> tuple[dict[str, Any], JointTrajectory | None, float]:
    """Optimal control from the best Bézier motion, same end velocities; report, curve, CPU [s].

    The solver's friction is rounded near standstill, so its curve is polished on the exact model
    (`optimal_control_j`), and so is the Bézier curve itself, freed of its control points
    (`freed_bezier_j`); the cheaper one that touches nothing is the reference, `free_form_j`. All
    values are those of one fine replay.
    """
    robot = setting.robot
    begin = time.process_time()
    first, last = best.motion.end_velocity_rad_s
    problem = MotionProblem(
        robot,
        move.start_rad,
        move.goal_rad,
        ElectricalCost(time=0.0, torque_smoothing=1e-3),
        INTERVALS,
        first,
        last,
        setting.duration_s,
    )
    knots = best.motion.trajectory(robot, INTERVALS)
    params = SolveParams(max_iterations=500, solver=setting.solver)
    motion = solve(problem, params, guess_from_trajectory(problem, knots))
    report: dict[str, Any] = {
        "status": motion.status.value,
        "iterations": motion.iterations,
        "num_intervals": INTERVALS,
        "programme_j": motion.cost,
        "max_defect": motion.max_defect,
        "bezier_j": best.value,
    }
    candidates = []
    for name, curve in (
        ("optimal_control", motion.trajectory),
        ("freed_bezier", best.motion.trajectory(robot, 60)),
    ):
        if curve is None:
            continue
        polished, value = polish_trajectory(curve, robot, "energy")
        hit = touches(setting.world, polished)
        report[f"{name}_j"] = value
        report[f"{name}_touches"] = None if hit is None else list(hit)
        candidates.append((hit is not None, value, name, polished))
    blocked, value, source, polished = min(candidates, key=lambda item: item[:2])
    report |= {
        "free_form_j": value,
        "free_form_from": source,
        "free_form_touches": blocked,
        "bezier_above_percent": 100.0 * (best.value - value) / abs(value),
        "bezier_below": bool(best.value < value),
    }
    return report, polished, time.process_time() - begin
