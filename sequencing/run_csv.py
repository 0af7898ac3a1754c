"""One CSV file per motion: the common interpolant, sampled between the knots too."""

from __future__ import annotations

import re

import numpy as np

from dmoc.robot import Robot
from dmoc.trajectory import JointTrajectory
from sequencing.cycle_types import CycleMotion
from sequencing.run_archive import csv_text

_SAMPLES_PER_INTERVAL = 4


def motion_file_name(item: CycleMotion) -> str:
    """`m000_S01_S07.csv`; characters that a file name should not have become `-`."""
    parts = [re.sub(r"[^A-Za-z0-9.-]+", "-", text) for text in (item.origin, item.target)]
    return "_".join([item.key, *parts]) + ".csv"


def motion_csv(trajectory: JointTrajectory, robot: Robot) -> str:
    """Time, q, q̇, q̈, τ at the knots and three times between, with units in the header.

    τ is the inverse dynamics of the interpolant (`torque_nm`); `control_nm` is the transcription's
    torque, constant on the interval that begins with the row (the last interval's at the end).
    """
    if trajectory.robot is None:
        trajectory = trajectory.on(robot)
    steps = np.arange(_SAMPLES_PER_INTERVAL * trajectory.num_intervals + 1)
    knot = np.minimum(steps // _SAMPLES_PER_INTERVAL, trajectory.num_intervals - 1)
    share = (steps - knot * _SAMPLES_PER_INTERVAL) / _SAMPLES_PER_INTERVAL
    times = trajectory.t_s[knot] + share * (trajectory.t_s[knot + 1] - trajectory.t_s[knot])
    sample = trajectory.sample(times)
    columns = [
        times[:, None] - trajectory.t_s[0], sample.q_rad, sample.velocity_rad_s,
        sample.acceleration_rad_s2, sample.torque_nm, trajectory.torque_nm[knot],
    ]  # fmt: skip
    joints = range(1, trajectory.q_rad.shape[1] + 1)
    header = ["t_s"]
    for unit in ("q{}_rad", "velocity{}_rad_s", "acceleration{}_rad_s2", "torque{}_nm",
                 "control{}_nm"):  # fmt: skip
        header += [unit.format(j) for j in joints]
    return csv_text(header, np.hstack(columns).tolist())
