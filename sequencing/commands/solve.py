"""`dmoc solve`: one optimal motion between two joint vectors."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from dmoc.errors import InputError
from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve
from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.cycle_types import CycleMotion
from sequencing.runs.folder import write_motions


def parse_vector(text: str, name: str, num_joints: int) -> np.ndarray:
    """Numbers separated by commas or blanks; `InputError` names the option."""
    parts = text.replace(",", " ").split()
    try:
        values = np.array([float(part) for part in parts])
    except ValueError:
        values = np.array([np.nan])
    if values.shape != (num_joints,) or not np.all(np.isfinite(values)):
        raise InputError.of(
            "joint-vector",
            field=f"--{name}",
            value=text,
            legal=f"{num_joints} finite numbers in rad, separated by commas",
            fix=f"--{name}={','.join(['0'] * num_joints)}",
        )
    return values


def run_solve(
    console: Console,
    robot_name: str,
    start: str,
    goal: str,
    intervals: int,
    duration: float | None,
    weights: tuple[float, float, float, float],
    payload: float,
    seed: int,
    out: Path | None,
) -> CommandResult:
    """Solve, print a line or the JSON object; `out` gets motion.json and the motion as a run."""
    robot = load_robot(robot_name)
    if payload > 0:
        robot = robot.with_payload(payload)
    for doubt in robot.description.warnings:
        console.say(f"warning: {doubt}")
    problem = MotionProblem(
        robot,
        parse_vector(start, "start", robot.num_joints),
        parse_vector(goal, "goal", robot.num_joints),
        Cost(*weights),
        num_intervals=intervals,
        duration_s=duration,
    )
    began = time.process_time()
    motion = solve(problem, seed=seed)
    warnings = [doubt.to_dict() for doubt in robot.description.warnings]
    data = _as_object(motion) | {"warnings": warnings, "cpu_s": time.process_time() - began}
    console.show(
        f"{motion.status.value}: cost {motion.cost:.6g}{_executed(motion)}, "
        f"duration {motion.duration_s:.4g} s, {motion.iterations} iterations"
    )
    if not motion.status.ok:
        console.say(f"{motion.status.value}: {motion.status.advice} {motion.note}".rstrip())
    save_json(out, "motion.json", data)
    if out is not None and motion.trajectory is not None:
        item = CycleMotion("m000", "start", "goal", "travel", motion)
        write_motions(f"{robot.name} motion", robot, [item], problem.cost, out, seed)
    return CommandResult(data, 0 if motion.status.ok else 3)


def _executed(motion: Motion) -> str:
    gap = motion.cost_gap
    return "" if gap is None else f" (executed {motion.executed_cost:.6g}, {100 * gap:+.2f} %)"


def _as_object(motion: Motion) -> dict[str, object]:
    trajectory = motion.trajectory
    names = ("t_s", "q_rad", "velocity_rad_s", "torque_nm")
    arrays = {name: None if trajectory is None else getattr(trajectory, name) for name in names}
    return {
        "status": motion.status.value,
        "advice": motion.status.advice,
        "cost": motion.cost,
        "executed_cost": motion.executed_cost,
        "cost_gap": motion.cost_gap,
        "duration_s": motion.duration_s,
        **arrays,
        "iterations": motion.iterations,
        "max_defect": motion.max_defect,
        "smoothing_cost": motion.smoothing_cost,
        "replay_error_rad": motion.replay_error_rad,
        "note": motion.note,
    }
