"""What a motion's cost consists of: its shares of time, effort and velocity."""

from __future__ import annotations

import numpy as np

from dmoc.cost import Cost, ElectricalCost
from dmoc.trajectory import JointTrajectory


def cost_shares(trajectory: JointTrajectory, cost: Cost | ElectricalCost) -> dict[str, float]:
    r"""The terms of J on the knots, in the order they are printed.

    .. math:: J = c_t T + c_e \sum_k h_k u_k^T u_k
              + c_v \sum_k h_k \| (q_{k+1} - q_k) / h_k \|^2

    with u_k the torque that is constant on interval k. The keys are `time`, `effort`, `velocity`.
    For an `ElectricalCost` the effort is the price of the joules, which needs the drive model and
    is therefore left out; time and velocity are the same. Matrices Q, R add a term `matrices`,
    with the state at the middle of an interval.
    """
    h = np.diff(trajectory.t_s)
    speed = np.diff(trajectory.q_rad, axis=0) / h[:, None]
    shares = {"time": cost.time * float(h.sum())}
    if isinstance(cost, Cost):
        shares["effort"] = cost.effort * float(h @ np.sum(trajectory.torque_nm**2, axis=1))
    shares["velocity"] = cost.velocity * float(h @ np.sum(speed**2, axis=1))
    if isinstance(cost, Cost) and (cost.state_matrix or cost.torque_matrix):
        middle = (trajectory.q_rad[1:] + trajectory.q_rad[:-1]) / 2
        shares["matrices"] = float(h @ cost.matrix_rate(middle, speed, trajectory.torque_nm))
    return shares
