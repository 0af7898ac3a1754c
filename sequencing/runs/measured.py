"""A controller's log against the plan: time, path, current and energy."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import correlate

from dmoc.arrays import Array
from dmoc.errors import InputError
from dmoc.physics.metrics import BUS_VOLTAGE_V, MotionState, motor_current_a, settled
from dmoc.robot.drive import drive_from_mapping, electrical_power_w
from dmoc.robot.robot import Robot
from sequencing.runs.clock import CycleTimeline
from sequencing.runs.folder import Run, read_run
from sequencing.runs.measured_log import ControllerLog, read_controller_log

# A joint that is faster than this moves [rad/s].
MOVING_RAD_S = 0.01
_FINE_S, _COARSE_S = 0.002, 0.02
_MOST_SAMPLES = 20_000
# A log that is nearer to the plan than this is the plan's, in radians [rad].
_NEAR_RAD = 0.1


def measured_against_plan(
    log: Path | str, run_dir: Path | str, robot: Robot | None = None
) -> dict[str, Any]:
    """What the controller did, beside what was planned; plain numbers, lists and None.

    The log is shifted in time to where its positions fit the plan best (a recording starts before
    the motion). `time` compares how long the joints moved; `position` gives the largest and the
    rms error of every joint [rad]; `current` the measured and the planned motor currents [A];
    `energy` [J] over the log: the plan's electrical energy without and with base load, the log's
    DC-side energy, and both readings of ΣI·V from measured currents. What the log does not hold,
    or the robot has no drive for, is None.

    Errors: `InputError` for a log or run that cannot be read, of another robot (log-joints), or in
    degrees (log-unit).
    """
    record = read_controller_log(log)
    run = read_run(run_dir, robot)
    joints = len(run.joint_names)
    if record.q_rad.shape[1] != joints:
        raise InputError.of(
            "log-joints",
            file=str(log),
            field=f"{record.source}_q",
            value=f"{record.q_rad.shape[1]} joints",
            legal=f"{joints} joints of the run",
            fix="compare a log with a run of the same robot",
        )
    line = run.timeline
    shift, misfit = _shift(record, line)
    if misfit > _NEAR_RAD and _shift(record, line, math.pi / 180.0)[1] < 0.1 * misfit:
        raise InputError.of(
            "log-unit",
            file=str(log),
            field=f"{record.source}_q",
            value="as degrees it fits the plan",
            legal="radians",
            fix="convert positions and velocities to radians",
        )
    times = record.t_s - shift
    planned, state = _state(line, run, times)
    error = record.q_rad - planned
    planned_s, logged_s = _moving_s(*_fine(line)), _moving_s(record.t_s, record.velocity_rad_s)
    return {
        "log": str(log),
        "run": run.name,
        "joints": joints,
        "samples": len(record.t_s),
        "source": record.source,
        "shift_s": shift,
        "time": {
            "planned_s": planned_s,
            "logged_s": logged_s,
            "difference_s": logged_s - planned_s,
        },
        "position": {
            "largest_rad": np.abs(error).max(axis=0).tolist(),
            "rms_rad": np.sqrt(np.mean(error**2, axis=0)).tolist(),
        },
        "current": _currents(record, run, state),
        "energy": _energies(record, run, state),
    }


def _planned(line: CycleTimeline, times: Array) -> Array:
    """Planned positions (K, n), at rest before the start and after the end."""
    return np.asarray(line.at(np.clip(times, 0.0, line.duration_s)).q_rad)


def _shift(record: ControllerLog, line: CycleTimeline, scale: float = 1.0) -> tuple[float, float]:
    """The time in the log at which the plan begins, by least squares of all joints, and the rms.

    Coarsely over all shifts at once, as a correlation; then finely at up to `_MOST_SAMPLES` samples
    of the log. `scale` multiplies the log's positions.
    """
    grid = np.arange(0.0, line.duration_s + _COARSE_S, _COARSE_S)
    plan = _planned(line, grid)
    times = np.arange(0.0, record.duration_s + _COARSE_S, _COARSE_S)
    seen = scale * np.column_stack([np.interp(times, record.t_s, q) for q in record.q_rad.T])
    # Before the plan begins it stands at its first pose, after its end at the last one: three sums
    # over the log, of which the middle one is a correlation with the plan.
    before = np.append(0.0, np.cumsum(np.sum((seen - plan[0]) ** 2, axis=1)))
    after = np.append(0.0, np.cumsum(np.sum((seen - plan[-1]) ** 2, axis=1)))
    square = np.append(0.0, np.cumsum(np.sum(seen**2, axis=1)))
    own = np.append(0.0, np.cumsum(np.sum(plan**2, axis=1)))
    cross = sum(correlate(seen[:, j], plan[:, j], method="fft") for j in range(plan.shape[1]))
    begin = np.arange(-(len(plan) - 1), len(seen))
    low, high = np.clip(begin, 0, len(seen)), np.clip(begin + len(plan), 0, len(seen))
    inside = square[high] - square[low] - 2.0 * cross + own[high - begin] - own[low - begin]
    misfit = before[low] + inside + after[-1] - after[high]
    best = float(begin[int(np.argmin(misfit))]) * _COARSE_S

    stride = max(1, len(record.t_s) // _MOST_SAMPLES)
    t, q = record.t_s[::stride], scale * record.q_rad[::stride]
    fine = np.arange(0.0, line.duration_s + _FINE_S, _FINE_S)
    curve = _planned(line, fine)

    def error(shift: float) -> float:
        at = np.clip((t - shift) / _FINE_S, 0.0, len(fine) - 1.0)
        first = np.minimum(at.astype(int), len(fine) - 2)
        share = (at - first)[:, None]
        return float(np.mean((q - (1.0 - share) * curve[first] - share * curve[first + 1]) ** 2))

    width = _COARSE_S
    for _ in range(8):
        near = best + width * np.linspace(-1.0, 1.0, 9)
        best = float(near[int(np.argmin([error(x) for x in near]))])
        width *= 0.3
    return best, math.sqrt(error(best))


def _fine(line: CycleTimeline) -> tuple[Array, Array]:
    times = np.arange(0.0, line.duration_s + 0.5 * _FINE_S, _FINE_S)
    times = np.minimum(times, line.duration_s)
    return times, np.asarray(line.at(times).velocity_rad_s)


def _moving_s(t: Array, velocity: Array) -> float:
    """Time from the first to the last sample at which a joint moves."""
    moving = np.flatnonzero(np.abs(velocity).max(axis=1) > MOVING_RAD_S)
    return float(t[moving[-1]] - t[moving[0]]) if moving.size else 0.0


def _state(line: CycleTimeline, run: Run, times: Array) -> tuple[Array, MotionState | None]:
    """Planned positions (K, n) and, with a robot, state at log times; outside the plan it stands.

    Torques are computed at the samples inside the plan, and once at either end.
    """
    inside = (times >= 0.0) & (times <= line.duration_s)
    part = line.at(times[inside], run.robot)
    ends = line.at(np.array([0.0, line.duration_s])).q_rad
    late = (times > line.duration_s).astype(int)

    def whole(values: Array, outside: Array) -> Array:
        full = outside[late]
        full[inside] = values
        return full

    planned, still = whole(part.q_rad, ends), np.zeros_like(ends)
    if run.robot is None or part.torque_nm is None:
        return planned, None
    acceleration = whole(part.acceleration_rad_s2, still)
    torque = whole(part.torque_nm, run.robot.gravity_torque_nm(ends))
    velocity = settled(whole(part.velocity_rad_s, still))
    return planned, MotionState(velocity, acceleration, acceleration, torque)


def _currents(record: ControllerLog, run: Run, state: MotionState | None) -> dict[str, Any] | None:
    if record.current_a is None or state is None or run.robot is None or not run.robot.drive:
        return None
    drive = drive_from_mapping(run.robot.drive, run.robot.num_joints, run.robot.provenance)
    planned = motor_current_a(drive, state)
    error = record.current_a - planned
    return {
        "logged_rms_a": np.sqrt(np.mean(record.current_a**2, axis=0)).tolist(),
        "planned_rms_a": np.sqrt(np.mean(planned**2, axis=0)).tolist(),
        "difference_rms_a": np.sqrt(np.mean(error**2, axis=0)).tolist(),
        "difference_largest_a": np.abs(error).max(axis=0).tolist(),
    }


def _energies(
    record: ControllerLog, run: Run, state: MotionState | None
) -> dict[str, float | None]:
    report: dict[str, float | None] = dict.fromkeys(
        (
            "planned_j",
            "planned_with_base_j",
            "planned_iv_signed_j",
            "planned_iv_absolute_j",
            "logged_dc_j",
            "logged_iv_signed_j",
            "logged_iv_absolute_j",
        )
    )
    t = record.t_s
    if state is not None and run.robot is not None and run.robot.drive:
        drive = drive_from_mapping(run.robot.drive, run.robot.num_joints, run.robot.provenance)
        power = electrical_power_w(state.velocity, state.acceleration, state.torque, drive)
        planned = float(np.trapezoid(power.sum(axis=1), t))
        volts = BUS_VOLTAGE_V * motor_current_a(drive, state)
        report |= {
            "planned_j": planned,
            "planned_with_base_j": planned + drive.base_power_w * record.duration_s,
            "planned_iv_signed_j": float(np.trapezoid(volts.sum(axis=1), t)),
            "planned_iv_absolute_j": float(np.trapezoid(np.abs(volts).sum(axis=1), t)),
        }
    if record.power_w is not None:
        report["logged_dc_j"] = float(np.trapezoid(record.power_w, t))
    if record.current_a is not None:
        voltage = BUS_VOLTAGE_V if record.joint_voltage_v is None else record.joint_voltage_v
        volts = voltage * record.current_a
        report["logged_iv_signed_j"] = float(np.trapezoid(volts.sum(axis=1), t))
        report["logged_iv_absolute_j"] = float(np.trapezoid(np.abs(volts).sum(axis=1), t))
    return report
