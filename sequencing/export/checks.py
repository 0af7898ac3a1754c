"""What must hold before a program is written for a real controller."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError
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

    def refuse(code: str, field: str, value: str, legal: str, fix: str) -> None:
        faults.append(Fault(code, str(run.folder), field, value, legal, fix))

    def check(
        where: str,
        name: str,
        values: Array,
        low: Array,
        high: Array,
        slack: Array | float,
        t: Array,
    ) -> None:
        """One fault per joint that is outside, at the time where it is worst."""
        excess = np.maximum(values - high, low - values) - slack
        unit = name.split("_", 1)[1].replace("_", "/")
        for j in np.flatnonzero(np.max(excess, axis=0) > 0):
            row = int(np.argmax(excess[:, j]))
            refuse(
                "export-limit",
                f"{where}.{name}[{j}]",
                f"{values[row, j]:.6g} {unit} at {t[row]:.3f} s",
                f"[{low[j]:.6g}, {high[j]:.6g}] {unit} ({run.joint_names[j]})",
                "plan again with more intervals or with lower limits",
            )

    speed, torque = run.limit("velocity_limit_rad_s"), run.limit("torque_limit_nm")
    angles = (run.limit("q_lower_rad"), run.limit("q_upper_rad"), POSITION_SLACK_RAD)
    share = np.arange(_PER_INTERVAL) / _PER_INTERVAL
    look = run.result.get("second_look") or {}
    seen = look.get("contacts") == 0 and look.get("motions") == len(run.motions)
    looks = MotionLooks(station_of(run)) if run.planned and not seen else None
    for item in run.motions:
        where = f"motions.{item.key}"
        trajectory, status = item.motion.trajectory, item.motion.status
        if trajectory is None:
            legal = "a motion with a trajectory"
            refuse("export-motion", where, status.value, legal, status.advice)
            continue
        touch = None if looks is None else looks.touch(item)
        if item.motion.certified is False or touch is not None:
            refuse(
                "export-uncertified",
                where,
                "not certified" if touch is None else str(touch),
                "every motion certified free of collision between its knots",
                "plan again with more intervals or repair rounds, or another departure",
            )
        t, h = trajectory.t_s, np.diff(trajectory.t_s)[:, None]
        times = np.append((t[:-1, None] + h * share).ravel(), t[-1])
        q, v, *_ = trajectory.on(None).sample(times)
        check(where, "q_rad", q, *angles, times)
        check(where, "velocity_rad_s", v, -speed, speed, SPEED_SLACK * speed, times)
        torques = (-torque, torque, TORQUE_SLACK * torque)
        check(where, "torque_nm", trajectory.torque_nm, *torques, t[:-1])
    for number, weld in enumerate(run.welds):
        check(f"welds[{number}]", "q_rad", weld.q_rad[None], *angles, np.zeros(1))
    if faults:
        raise InputError(faults)
