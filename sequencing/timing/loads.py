"""Payloads and external wrenches of single trajectories, as cell.yaml gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dmoc.robot import Robot
from dmoc.trajectory import JointTrajectory, inverse_dynamics
from dmoc.yaml_file import Refuse
from sequencing.timing.cell_file import LoadEntry
from sequencing.timing.cell_types import CellRobot


def with_loads(robot: CellRobot, loads: Sequence[LoadEntry], refuse: Refuse) -> CellRobot:
    """`robot` with the payloads and wrenches of `loads`; later entries override earlier ones."""
    loaded, wrench = list(robot.loaded), list(robot.wrench)
    trajectories = list(robot.trajectories)
    size = len(trajectories)
    arms: dict[float, Robot] = {}
    for m, load in enumerate(loads):
        if load.payload_kg is None and load.force_n is None and load.torque_nm is None:
            refuse("load-empty", "no load", "payload_kg, force_n or torque_nm",
                   "say what these trajectories carry", "loads", m)  # fmt: skip
        for at, k in enumerate(load.trajectories):
            if k >= size:
                refuse("load-trajectory", str(k), f"0 .. {size - 1}",
                       "count trajectories from 0", "loads", m, "trajectories", at)  # fmt: skip
                continue
            if load.payload_kg is not None:
                arm = arms.setdefault(load.payload_kg, robot.robot.with_payload(load.payload_kg))
                loaded[k], trajectories[k] = arm, _carried(trajectories[k], arm)
            if load.force_n is not None or load.torque_nm is not None:
                wrench[k] = np.array([*(load.force_n or [0.0] * 3), *(load.torque_nm or [0.0] * 3)])
    return replace(
        robot, loaded=tuple(loaded), wrench=tuple(wrench), trajectories=tuple(trajectories)
    )


def _carried(trajectory: JointTrajectory, arm: Robot) -> JointTrajectory:
    """The same motion with the torques of `arm` at the middles of its intervals."""
    t = trajectory.t_s
    state = trajectory.on(None).sample(0.5 * (t[1:] + t[:-1]))
    torque = inverse_dynamics(
        arm.model, state.q_rad, state.velocity_rad_s, state.acceleration_rad_s2
    )
    return replace(trajectory, torque_nm=torque, robot=arm)
