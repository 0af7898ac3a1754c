"""Slow oracle of a schedule's energy: inverse dynamics and the drive at every fine instant."""

import numpy as np
import pinocchio as pin

from dmoc.robot.drive import electrical_power_w


def robot_power_w(robot, drive, trajectory, start_s, override, t_s):
    """Power of one robot running one trajectory, straight from `pin.rnea`, at one time."""
    data = robot.model.createData()
    s = (t_s - start_s) * override
    moving = 0.0 <= s < trajectory.duration_s
    sample = trajectory.sample(np.array([min(max(s, 0.0), trajectory.duration_s)]))
    qd = sample.velocity_rad_s[0] * override * moving
    qdd = sample.acceleration_rad_s2[0] * override**2 * moving
    tau = pin.rnea(robot.model, data, sample.q_rad[0], qd, qdd)
    return float(electrical_power_w(qd, qdd, tau, drive).sum())


def grid_energy_j(robots, drive, trajectories, start_s, override, total_s, link, steps=4000):
    """One trajectory for each robot on one link: midpoint sums and the clip recursion."""
    dt = total_s / steps
    w = link.min_energy_j
    bought = 0.0
    for k in range(steps):
        t = (k + 0.5) * dt
        power = sum(
            robot_power_w(r, drive, tr, a, d, t)
            for r, tr, a, d in zip(robots, trajectories, start_s, override)
        )
        y = w - power * dt
        bought += max(0.0, link.min_energy_j - y)
        w = min(max(y, link.min_energy_j), link.max_energy_j)
    return link.grid_factor * (bought - (w - link.min_energy_j))
