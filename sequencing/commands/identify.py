"""`dmoc identify`: a robot's dynamics from its logs."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.errors import InputError
from dmoc.identification.identifying import IdentificationProblem, identify
from dmoc.identification.samples import MotionLog
from dmoc.identification.terms import springs_of
from dmoc.identification.written import summary, write_identification
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import Robot, load_robot
from dmoc.robot.settings import read_settings
from sequencing.commands.console import CommandResult, Console
from sequencing.report.identification_report import identification_markdown, write_page
from sequencing.runs.measured_log import read_controller_log

SOURCES = ("motor_torque", "actual_torque", "actual_current")


def run_identify(
    console: Console,
    logs: Sequence[Path],
    robot: Path,
    hold: Sequence[Path],
    payload: str | None,
    torque_source: str | None,
    cutoff_hz: float,
    out: Path | None,
) -> CommandResult:
    """Fit the logs, judge the held ones, write the pair and its page; exit 3 for a faulty log."""
    urdf = robot
    if robot.suffix in (".yaml", ".yml"):
        found = sorted(robot.parent.glob("*.urdf"))
        urdf = found[0] if len(found) == 1 else robot.with_name("robot.urdf")
    model = load_robot(urdf)
    settings = read_settings(model.urdf).data
    names = list(model.model.names)[1:]
    weight, place = _payload(payload)
    read = [[motion_log(p, model, settings, torque_source) for p in part] for part in (logs, hold)]
    ratio = settings.get("motor_from_joint")
    problem = IdentificationProblem(
        model,
        tuple(read[0]),
        tuple(read[1]),
        springs_of(settings.get("springs", []), names),
        None if ratio is None else np.array(ratio, dtype=float),
        weight,
        place,
        cutoff_hz=cutoff_hz,
    )
    result = identify(problem)
    console.show(identification_markdown(result))
    data = summary(result)
    if result.status == "faulty":
        for fault in result.faults:
            console.say(f"fault {fault}")
        return CommandResult(data, 3)
    if out is not None:
        for path in (*write_identification(result, out), write_page(result, out / "report.html")):
            console.show(f"wrote {path}")
    return CommandResult(data)


def _payload(text: str | None) -> tuple[float, tuple[float, float, float]]:
    try:
        numbers = [float(word) for word in (text or "0").split(",")]
        if len(numbers) not in (1, 4) or numbers[0] < 0 or not np.all(np.isfinite(numbers)):
            raise ValueError(text)
    except ValueError as error:
        legal, fix = "KG or KG,x,y,z in the flange frame [m]", "for example --payload 12.5,0,0,0.1"
        raise InputError.of("payload", "", "--payload", str(text), legal, fix) from error
    x, y, z = numbers[1:] if len(numbers) == 4 else (0.0, 0.0, 0.0)
    return numbers[0], (x, y, z)


def motion_log(
    path: Path, robot: Robot, settings: Mapping[str, Any], source: str | None
) -> MotionLog:
    """Joint positions and joint torques of a controller's log.

    Motor values pass `motor_from_joint` (or the gear ratios of the drive); currents pass the
    drive's torque constants. Errors: `InputError` (torque-source, log-torque, gear-ratio).
    """
    log = read_controller_log(path, motor=True)
    n = robot.num_joints
    columns = dict(zip(SOURCES, (log.motor_torque_nm, log.joint_torque_nm, log.current_a)))
    if source is not None and source not in SOURCES:
        fix = "choose one of them"
        raise InputError.of(
            "torque-source", str(path), "--torque-source", source, ", ".join(SOURCES), fix
        )
    kind = source or next((key for key in SOURCES if columns[key] is not None), "")
    values = columns.get(kind)
    if values is None or log.q_rad.shape[1] != n:
        value = f"{log.q_rad.shape[1]} joints, torque: {kind or 'none'}"
        legal = f"{n} joints, and one of {', '.join(f'{s}_0 …' for s in SOURCES)}"
        fix = "log torques with the positions; a controller's target torque is no measurement"
        raise InputError.of("log-torque", str(path), "columns", value, legal, fix)
    drive = drive_from_mapping(robot.drive, n) if robot.drive else None
    given = settings.get("motor_from_joint")
    ratio = None if given is None else np.array(given, dtype=float)
    if ratio is None and drive is not None:
        ratio = np.diag(drive.gear_ratio)
    if ratio is None and (kind != "actual_torque" or log.source == "motor"):
        legal = "motor_from_joint (n x n), or drive.gear_ratio"
        fix = "give the gear ratios"
        raise InputError.of("gear-ratio", str(robot.urdf), "robot.yaml", "missing", legal, fix)
    turns = np.eye(n) if ratio is None else ratio
    q = np.asarray(log.q_rad)
    if log.source == "motor":
        q = np.linalg.solve(turns, q.T).T + np.array(settings.get("motor_zero_rad", [0.0] * n))
    if kind == "actual_current":
        constants = drive.torque_constant_nm_a if drive is not None else np.ones(n)
        values = values * constants
    torque = values if kind == "actual_torque" else values @ turns
    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    return MotionLog(Path(path).name, log.t_s, q, torque, digest)
