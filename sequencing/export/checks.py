"""What must hold before a program is written for a real controller."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError
from dmoc.motion.trajectory import JointTrajectory
from sequencing.cycle.second_look import MotionLooks
from sequencing.runs.folder import Run, station_of

# The optimiser keeps its limits at the knots and on average between them; the smooth curve through
# the knots may bulge a little beyond, less than a controller's own supervision lets through.
POSITION_SLACK_RAD = 1e-3
SPEED_SLACK = 0.01
TORQUE_SLACK = 1e-3

_PER_INTERVAL = 8


def check_exportable(run: Run) -> None:
    """Refuse a run whose curve leaves the robot's limits, or that is not free of collision.

    Positions and speeds are checked eight times an interval along the curve that is exported,
    torques on every interval. A second engine must have looked at every motion; where the run does
    not say so (it was planned before), that happens now, in the run's station. Errors: `InputError`
    with one fault per motion, joint and limit, or run-station where that station is gone.
    """
    faults: list[Fault] = []
    file = str(run.folder)
    look = run.result.get("second_look") or {}
    seen = look.get("contacts") == 0 and look.get("motions") == len(run.motions)
    looks = MotionLooks(station_of(run)) if run.planned and not seen else None
    for item in run.motions:
        where = f"motions.{item.key}"
        trajectory = item.motion.trajectory
        if trajectory is None:
            faults.append(
                Fault(
                    "export-motion",
                    file=file,
                    field=where,
                    value=item.motion.status.value,
                    legal="a motion with a trajectory",
                    fix=item.motion.status.advice,
                )
            )
            continue
        touch = None if looks is None else looks.touch(item)
        if item.motion.certified is False or touch is not None:
            faults.append(
                Fault(
                    "export-uncertified",
                    file=file,
                    field=where,
                    value="not certified" if touch is None else str(touch),
                    legal="every motion certified free of collision between its knots",
                    fix="plan again with more intervals or repair rounds, or another departure",
                )
            )
        faults += _limit_faults(run, where, trajectory)
    for number, weld in enumerate(run.welds):
        faults += _outside(
            run,
            f"welds[{number}]",
            "q_rad",
            weld.q_rad[None],
            run.limit("q_lower_rad"),
            run.limit("q_upper_rad"),
            POSITION_SLACK_RAD,
            np.zeros(1),
        )
    if faults:
        raise InputError(faults)


def _limit_faults(run: Run, where: str, trajectory: JointTrajectory) -> list[Fault]:
    share = np.arange(_PER_INTERVAL) / _PER_INTERVAL
    h = np.diff(trajectory.t_s)[:, None]
    times = np.append((trajectory.t_s[:-1, None] + h * share).ravel(), trajectory.t_s[-1])
    sample = trajectory.on(None).sample(times)
    speed, torque = run.limit("velocity_limit_rad_s"), run.limit("torque_limit_nm")
    return [
        *_outside(
            run,
            where,
            "q_rad",
            sample.q_rad,
            run.limit("q_lower_rad"),
            run.limit("q_upper_rad"),
            POSITION_SLACK_RAD,
            times,
        ),
        *_outside(
            run,
            where,
            "velocity_rad_s",
            sample.velocity_rad_s,
            -speed,
            speed,
            SPEED_SLACK * speed,
            times,
        ),
        *_outside(
            run,
            where,
            "torque_nm",
            trajectory.torque_nm,
            -torque,
            torque,
            TORQUE_SLACK * torque,
            trajectory.t_s[:-1],
        ),
    ]


def _outside(
    run: Run,
    where: str,
    name: str,
    values: Array,
    low: Array,
    high: Array,
    slack: Array | float,
    times: Array,
) -> list[Fault]:
    """One fault per joint that is outside, at the time where it is worst."""
    excess = np.maximum(values - high, low - values) - slack
    faults = []
    for j in np.flatnonzero(np.max(excess, axis=0) > 0):
        row = int(np.argmax(excess[:, j]))
        unit = name.rsplit("_", 1)[0] and name.split("_", 1)[1].replace("_", "/")
        faults.append(
            Fault(
                "export-limit",
                file=str(run.folder),
                field=f"{where}.{name}[{j}]",
                value=f"{values[row, j]:.6g} {unit} at {times[row]:.3f} s",
                legal=f"[{low[j]:.6g}, {high[j]:.6g}] {unit} ({run.joint_names[j]})",
                fix="plan again with more intervals or with lower limits",
            )
        )
    return faults
