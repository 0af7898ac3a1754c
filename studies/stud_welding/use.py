"""Time, effort and electrical energy of a whole cycle, and its motions at full speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmoc.curves.time_scaling import time_scale
from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointPath, JointTrajectory
from dmoc.physics.running_cost import trajectory_cost
from dmoc.robot.drive import drive_from_mapping, electrical_power_w
from studies.stud_welding.model import Model, travels
from studies.stud_welding.types import Use

SAMPLES_PER_INTERVAL = 4
PATH_POINTS = 61


def trajectories_of(model: Model, nodes: tuple[int, ...]) -> list[JointTrajectory]:
    """Screening motions of a cycle whose travels are all solved, in their direction."""
    found = [motion.trajectory for motion in model.edges.motions(travels(nodes))]
    return [trajectory for trajectory in found if trajectory is not None]


def cycle_use(
    model: Model, nodes: tuple[int, ...], motions: Sequence[JointTrajectory] | None = None
) -> Use:
    """What the cycle takes with its screening motions, or with `motions` instead."""
    robot = model.station.robot
    drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
    times = {stud.id: stud.weld_time_s for stud in model.station.studs}
    moving = effort = drawn = net = 0.0
    for curve in trajectories_of(model, nodes) if motions is None else motions:
        step = np.diff(curve.t_s)
        effort += float(step @ np.sum(curve.torque_nm**2, axis=1))
        moving += curve.duration_s
        grid = np.linspace(
            curve.t_s[0], curve.t_s[-1], SAMPLES_PER_INTERVAL * curve.num_intervals + 1
        )
        state = curve.on(robot).sample(grid)
        power = electrical_power_w(
            state.velocity_rad_s, state.acceleration_rad_s2, state.torque_nm, drive
        ).sum(axis=1)
        drawn += float(np.trapezoid(np.maximum(power, 0.0), grid))
        net += float(np.trapezoid(power, grid))
    welding = 0.0
    for v in nodes:
        if v == model.nodes.home:
            continue
        held = times[model.nodes.stud[v]]
        torque = robot.gravity_torque_nm(model.nodes.q_rad[v])
        still = np.zeros(robot.num_joints)
        power = float(np.sum(electrical_power_w(still, still, torque, drive)))
        welding += held
        effort += held * float(torque @ torque)
        drawn, net = drawn + held * power, net + held * power
    total = moving + welding
    return Use(total, moving, effort, drawn, net, drawn + drive.base_power_w * total)


def at_full_speed(model: Model, curve: JointTrajectory) -> JointTrajectory:
    """The path of a motion, run as fast as speed, acceleration and torque limits allow.

    The geometry stays (it is certified); only the time law changes. It is what a controller does
    that is told to go as fast as it can along the path.
    """
    times = np.linspace(curve.t_s[0], curve.t_s[-1], PATH_POINTS)
    q = curve.sample(times).q_rad.copy()
    q[0], q[-1] = curve.q_rad[0], curve.q_rad[-1]
    fastest = Cost(time=1.0, effort=0.0, velocity=0.0)
    problem = MotionProblem(model.station.robot, q[0], q[-1], fastest)
    return time_scale(JointPath(q), problem, laws=("toppra",)).trajectory


def full_speed_cost(model: Model, motions: Sequence[JointTrajectory]) -> float:
    """J of the station's weights for motions that were not made for it."""
    robot, cost = model.station.robot, model.station.cost
    return float(sum(trajectory_cost(motion, robot, cost) for motion in motions))
