r"""An independent look at a motion: simulate its torques and see where the arm goes.

The simulator is the classical Runge–Kutta method with fine steps on `pinocchio`'s forward
dynamics; nothing of the transcription is used but its knots and torques. Three views:

* windows: from (q_k, q̇_k) the torques of `WINDOW` intervals are applied open loop; the error at
  the window's end is what the discretisation leaves behind in that time;
* tracking: the whole motion with the feedback that any controller has, computed torque with
  K_p = ω², K_d = 2ω on the Hermite reference;
* open loop over the whole horizon, for information: an arm held up against gravity is an unstable
  system, so this grows without bound however exact the torques are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.motion.constraints import EndCost
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.motion import Motion, Replay
from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.running_cost import trajectory_cost
from dmoc.physics.state import wrench_torque
from dmoc.robot.robot import Robot

WINDOW = 4
SUBSTEPS = 8
TRACKING_RAD_S = 15.0


def replay_motion(
    motion: Motion,
    cost: Cost | ElectricalCost | None = None,
    wrench: Array | None = None,
    end_cost: EndCost | None = None,
) -> Motion:
    """The same motion with `replay` and `replay_error_rad` (its largest window error) filled in.

    `cost` prices the interpolant (default `Cost()`); `wrench` (6,) and `end_cost` are the
    problem's, if it had any: then the price agrees with `motion.cost` to second order in the step.
    Where `cost` is given the motion is judged by that price: `executed_cost`, and the status
    `coarse` where it is not what the motion states.
    Errors: `ProblemError` when the motion has no trajectory or the trajectory no robot.
    """
    trajectory = motion.trajectory
    robot = None if trajectory is None else trajectory.robot
    if trajectory is None or robot is None:
        raise ProblemError.of(
            "no-trajectory",
            field="motion.trajectory",
            value="nothing to replay",
            legal="a trajectory with its robot",
            fix="replay motions whose status is ok",
        )
    count = trajectory.num_intervals
    width = min(WINDOW, count)
    starts = list(range(0, count - width + 1, width))
    if starts[-1] != count - width:
        starts.append(count - width)
    errors = np.array(
        [
            simulate_open_loop(robot, trajectory, k, k + width, wrench)[-1]
            - trajectory.q_rad[k + width]
            for k in starts
        ]
    )
    tracked = simulate_tracking(robot, trajectory, wrench=wrench)
    free = simulate_open_loop(robot, trajectory, 0, count, wrench)
    replay = Replay(
        window_error_rad=np.abs(errors),
        window_intervals=width,
        tracking_error_rad=float(np.max(np.abs(tracked - trajectory.q_rad))),
        open_loop_error_rad=float(np.max(np.abs(free[-1] - trajectory.q_rad[-1]))),
        cost=trajectory_cost(trajectory, robot, cost or Cost(), wrench, end_cost),
    )
    judged = motion if cost is None else motion.judged(replay.cost)
    return judged.replace(replay=replay, replay_error_rad=float(replay.window_error_rad.max()))


def simulate_open_loop(
    robot: Robot, trajectory: JointTrajectory, first: int, last: int, wrench: Array | None = None
) -> Array:
    """Joints (last − first + 1, n) [rad] at the knots, torques of the transcription applied."""
    accelerate = _plant(robot, wrench)
    q, v = np.array(trajectory.q_rad[first]), np.array(trajectory.velocity_rad_s[first])
    out = [q]
    for k in range(first, last):
        step = (trajectory.t_s[k + 1] - trajectory.t_s[k]) / SUBSTEPS
        torque = trajectory.torque_nm[k]
        for _ in range(SUBSTEPS):
            q, v = _runge_kutta(accelerate, q, v, torque, step)
        out.append(q)
    return np.array(out)


def simulate_tracking(
    robot: Robot, trajectory: JointTrajectory, wrench: Array | None = None
) -> Array:
    """Joints (N+1, n) [rad] at the knots under u_k + M(q)(ω² (q_ref − q) + 2ω (q̇_ref − q̇)).

    The correction is held over each of the `SUBSTEPS` steps of an interval.
    """
    model, data, accelerate = robot.model, robot.model.createData(), _plant(robot, wrench)
    q, v = np.array(trajectory.q_rad[0]), np.array(trajectory.velocity_rad_s[0])
    out, w = [q], TRACKING_RAD_S
    share = np.arange(SUBSTEPS) / SUBSTEPS
    times = trajectory.t_s[:-1, None] + np.diff(trajectory.t_s)[:, None] * share
    wanted = trajectory.on(None).sample(times.ravel())
    for i in range(len(times.ravel())):
        k = i // SUBSTEPS
        step = (trajectory.t_s[k + 1] - trajectory.t_s[k]) / SUBSTEPS
        inertia = pin.crba(model, data, q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        error = w * w * (wanted.q_rad[i] - q) + 2 * w * (wanted.velocity_rad_s[i] - v)
        q, v = _runge_kutta(accelerate, q, v, trajectory.torque_nm[k] + inertia @ error, step)
        if (i + 1) % SUBSTEPS == 0:
            out.append(q)
    return np.array(out)


Plant = Callable[[Array, Array, Array], Array]


def _plant(robot: Robot, wrench: Array | None) -> Plant:
    """q̈ = M⁻¹(u + Jᵀw − b(q, q̇)), rotor armature included."""
    model, data = robot.model, robot.model.createData()
    if wrench is None:
        return lambda q, v, u: pin.aba(model, data, q, v, u).copy()
    return lambda q, v, u: pin.aba(model, data, q, v, u + wrench_torque(robot, q, wrench)).copy()


def _runge_kutta(
    accelerate: Plant, q: Array, v: Array, torque: Array, step: float
) -> tuple[Array, Array]:
    """One classical step."""
    half = step / 2
    a1 = accelerate(q, v, torque)
    v2 = v + half * a1
    a2 = accelerate(q + half * v, v2, torque)
    v3 = v + half * a2
    a3 = accelerate(q + half * v2, v3, torque)
    v4 = v + step * a3
    a4 = accelerate(q + step * v3, v4, torque)
    return q + step / 6 * (v + 2 * v2 + 2 * v3 + v4), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
