"""Beyond the paper: payload, duration and obstacles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dmoc.motion.trajectory import JointTrajectory
from studies.ur3.bezier_descent import descend_bezier
from studies.ur3.bezier_problem import BezierProblem, metric_values
from studies.ur3.bezier_swarm import swarm_bezier
from studies.ur3.case import Setting, base_energy_j, saving
from studies.ur3.moves import Move, movej
from studies.ur3.world import avoid_in, box, forbidden_in, tabletop_world, touches

PAYLOADS_KG = (0.0, 1.0, 2.0, 3.0)
DURATIONS_S = (1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)


def payload_sweep(
    moves: tuple[Move, ...], setting: Setting, payloads_kg: tuple[float, ...] = PAYLOADS_KG
) -> list[dict[str, Any]]:
    """Baseline and gradient optimum of every movement with a point mass at the flange."""
    rows = []
    for move in moves:
        for payload in payloads_kg:
            loaded = replace(setting, robot=setting.robot.with_payload(payload))
            for metric in ("iv_absolute", "energy"):
                rows.append({"payload_kg": payload, **_row(move, metric, loaded)})
    return rows


def duration_sweep(
    moves: tuple[Move, ...], setting: Setting, durations_s: tuple[float, ...] = DURATIONS_S
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Physical energy over the duration, and the best duration of each movement with base load.

    Durations in which the limits of the robot do not allow the motion are marked infeasible and
    cannot be the best.
    """
    rows, best = [], []
    for move in moves:
        own = [_row(move, "energy", replace(setting, duration_s=t)) for t in durations_s]
        rows += own
        for kind in ("baseline", "gradient"):
            legal = [row for row in own if row[f"{kind}_feasible"]]
            if legal:
                first = min(legal, key=lambda row: row[f"{kind}_with_base_j"])
                alone = min(legal, key=lambda row: row[f"{kind}_j"])
                best.append(
                    {
                        "move": move.name,
                        "motion": kind,
                        "duration_s": first["duration_s"],
                        "with_base_j": first[f"{kind}_with_base_j"],
                        "duration_without_base_s": alone["duration_s"],
                        "without_base_j": alone[f"{kind}_j"],
                    }
                )
    return rows, best


def obstacle_sweep(moves: tuple[Move, ...], setting: Setting, seed: int) -> list[dict[str, Any]]:
    """A post where movej passes: what the swarm and the gradient after it make of it.

    The post stands under the middle of the flange's way and ends 20 mm above the flange's height
    there; where it would touch start or goal it is left out.
    """
    rows = []
    for move in moves:
        robot = setting.robot
        middle = robot.flange_pose(0.5 * (move.start_rad + move.goal_rad)).translation
        height = float(middle[2]) + 0.02
        post = box("post", (0.05, 0.05, height), (*middle[:2], 0.5 * height))
        world = tabletop_world(robot, (post,))
        if world.collide_batch(np.stack([move.start_rad, move.goal_rad]), 0.01).any():
            continue
        hit = touches(world, movej(move, robot, setting.duration_s))
        forbidden, avoid = forbidden_in(world), avoid_in(world)
        for metric in ("iv_absolute", "energy"):
            problem = BezierProblem(
                robot, move.start_rad, move.goal_rad, setting.duration_s, metric
            )
            swarm = swarm_bezier(problem, seed, setting.swarm, forbidden)
            begin = swarm.motion.control_rad[1:-1].ravel()
            single = replace(setting.descent, starts=1)
            gradient = descend_bezier(problem, seed, single, forbidden, avoid, begin)
            free = descend_bezier(
                problem,
                seed,
                setting.descent,
                forbidden_in(setting.world),
                avoid_in(setting.world),
            )
            found = min((swarm, gradient), key=lambda r: (not r.feasible, r.value))
            clear = touches(world, found.motion)
            rows.append(
                {
                    "move": move.name,
                    "metric": metric,
                    "post_height_m": height,
                    "movej_touches": None if hit is None else list(hit),
                    "without_post_touches": touches(world, free.motion) is not None,
                    "swarm_feasible": swarm.feasible,
                    "swarm_j": swarm.value,
                    "gradient_feasible": gradient.feasible,
                    "gradient_j": gradient.value,
                    "best_touches": None if clear is None else list(clear),
                    "without_post_j": free.value,
                }
            )
    return rows


def _row(move: Move, metric: str, setting: Setting) -> dict[str, Any]:
    robot, duration = setting.robot, setting.duration_s
    reference = movej(move, robot, duration)
    problem = BezierProblem(robot, move.start_rad, move.goal_rad, duration, metric)
    found = descend_bezier(
        problem, 0, setting.descent, forbidden_in(setting.world), avoid_in(setting.world)
    )
    baseline = metric_values(reference, robot, (metric,))[metric]
    base = base_energy_j(setting)
    return {
        "move": move.name,
        "metric": metric,
        "duration_s": duration,
        "baseline_j": baseline,
        "baseline_feasible": _within(reference, setting),
        "gradient_j": found.value,
        "gradient_feasible": found.feasible,
        "saving_percent": saving(baseline, found.value),
        "baseline_with_base_j": baseline + base,
        "gradient_with_base_j": found.value + base,
    }


def _within(trajectory: JointTrajectory, setting: Setting) -> bool:
    """Whether a trajectory keeps velocity, acceleration and torque limits at 400 times."""
    robot = setting.robot
    sample = trajectory.sample(np.linspace(0.0, trajectory.duration_s, 400))
    assert sample.torque_nm is not None
    return bool(
        np.all(np.abs(sample.velocity_rad_s) <= robot.velocity_limit_rad_s)
        and np.all(np.abs(sample.acceleration_rad_s2) <= robot.acceleration_limit_rad_s2)
        and np.all(np.abs(sample.torque_nm) <= robot.torque_limit_nm)
    )
