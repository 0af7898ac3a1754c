"""A motion to be found (`MotionProblem`) and a motion that was found (`Motion`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from dmoc.arrays import Array, joint_vector, readonly
from dmoc.errors import Fault, ProblemError
from dmoc.motion.constraints import MotionLimits
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointPath, JointTrajectory
from dmoc.robot.robot import Robot

NO_LIMITS = MotionLimits()
#: A motion that costs more or less than it states by more than this share is called coarse.
LARGEST_COST_GAP = 0.01


@dataclass(frozen=True)
class MotionProblem:
    """One motion of one robot between two joint vectors.

    `start_rad`, `goal_rad` (n,); end velocities (n,) or 0; `duration_s` None leaves the time
    free. `depart_rad` and `arrive_rad` (m, n), if given, are the joint vectors of the first and
    last interior knots, in time order: q_1..q_m and q_{N−m}..q_{N−1} are fixed to them (a weld is
    left and reached on its departure line, without stopping there). `limits` come on top of the
    robot's; `wrench` (6,) is a constant force [N] and moment [N·m] on the tool tip, world axes.
    """

    robot: Robot
    start_rad: Array
    goal_rad: Array
    cost: Cost | ElectricalCost = Cost()
    num_intervals: int = 40
    start_velocity_rad_s: Array | float = 0.0
    goal_velocity_rad_s: Array | float = 0.0
    duration_s: float | None = None
    depart_rad: Array | None = None
    arrive_rad: Array | None = None
    limits: MotionLimits = NO_LIMITS
    wrench: Array | None = None

    def __post_init__(self) -> None:
        n = self.robot.num_joints
        if self.wrench is not None:
            object.__setattr__(self, "wrench", joint_vector(self.wrench, "wrench", 6))
        for name in ("start_rad", "goal_rad", "start_velocity_rad_s", "goal_velocity_rad_s"):
            object.__setattr__(self, name, joint_vector(getattr(self, name), name, n))
        for name in ("depart_rad", "arrive_rad"):
            if getattr(self, name) is not None:
                value = readonly(getattr(self, name), name, ndim=2)
                if value.shape[1] != n:
                    raise ProblemError.of(
                        "joint-vector",
                        field=name,
                        value=f"shape {value.shape}",
                        legal=f"(m, {n})",
                        fix="give one joint vector per knot",
                    )
                object.__setattr__(self, name, value)
        fixed = sum(0 if v is None else len(v) for v in (self.depart_rad, self.arrive_rad))
        if self.num_intervals < fixed + 2:
            raise ProblemError.of(
                "num-intervals",
                field="num_intervals",
                value=str(self.num_intervals),
                legal=f">= {fixed + 2}",
                fix="use more intervals",
            )
        if self.duration_s is not None and not (
            np.isfinite(self.duration_s) and self.duration_s > 0
        ):
            raise ProblemError.of(
                "duration",
                field="duration_s",
                value=repr(self.duration_s),
                legal="None or > 0 s",
                fix="leave it out for a free final time",
            )
        self._require_limits()

    def _require_limits(self) -> None:
        robot, faults = self.robot, []
        slack = 1e-9
        for name in ("start_rad", "goal_rad"):
            q = getattr(self, name)
            for j in np.flatnonzero(
                (q < robot.q_lower_rad - slack) | (q > robot.q_upper_rad + slack)
            ):
                faults.append(
                    Fault(
                        "joint-limit",
                        field=f"{name}[{j}]",
                        value=f"{q[j]:.6g} rad",
                        legal=f"[{robot.q_lower_rad[j]:.6g}, {robot.q_upper_rad[j]:.6g}] rad",
                        fix=f"choose a configuration within the limits of {robot.name}",
                    )
                )
        for name in ("start_velocity_rad_s", "goal_velocity_rad_s"):
            v = getattr(self, name)
            for j in np.flatnonzero(np.abs(v) > robot.velocity_limit_rad_s + slack):
                faults.append(
                    Fault(
                        "velocity-limit",
                        field=f"{name}[{j}]",
                        value=f"{v[j]:.6g} rad/s",
                        legal=f"|v| <= {robot.velocity_limit_rad_s[j]:.6g} rad/s",
                        fix="lower the end velocity",
                    )
                )
        if faults:
            raise ProblemError(faults)

    @property
    def jerk_limit_rad_s3(self) -> Array | None:
        """The tighter of the robot's and the motion's own limit (n,), None without either."""
        given = (self.robot.jerk_limit_rad_s3, self.limits.jerk_limit_rad_s3)
        n = self.robot.num_joints
        vectors = [joint_vector(x, "jerk_limit_rad_s3", n) for x in given if x is not None]
        return np.min(vectors, axis=0) if vectors else None

    def replace(self, **changes: Any) -> MotionProblem:
        """The same problem with some fields changed."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Replay:
    """What an independent simulation of a motion found (`dmoc.replay_motion`).

    `window_error_rad` (W, n): joint errors after every window of `window_intervals` intervals that
    started from the motion's own state; `tracking_error_rad` the largest joint error at a knot in
    closed loop; `open_loop_error_rad` at the end of the whole motion without feedback; `cost` the
    cost of the interpolant with the torques that it needs.
    """

    window_error_rad: Array
    window_intervals: int
    tracking_error_rad: float
    open_loop_error_rad: float
    cost: float


@dataclass(frozen=True)
class Motion:
    """What a solve found.

    `cost` is the problem's cost as the discrete equations state it, without smoothing,
    `smoothing_cost` the smoothing term, `executed_cost` the integral along the executed curve with
    the torques that it needs (`trajectory_cost`; None where nobody asked for it); `max_defect` the
    largest residual of the discrete Euler–Lagrange equations as a fraction of h·u_max (None for a
    fallback, which reports its inverse-dynamics error as `replay_error_rad`); `replay_error_rad`
    the largest joint error over 4-interval windows of an independent simulation; `certified`,
    `min_clearance_m` (the smallest distance met) and `proven_clearance_m` (what nothing undercuts
    between the knots either, at most the clearance that was asked for) come from the certificate
    and are None where nobody asked for one. CPU time is reported beside a motion, never in it.

    Who made it, each empty where nobody said: `solver` (`ipopt`, `structured`; `none` for a
    time-scaled path), `planner` of the path it started from (`ompl`, `compiled`; `none` where no
    path was planned) and `method` (`free`, `half-spaces`, `boxes`, `time-scaled`).
    """

    status: Status
    source: Literal["refined", "fallback"]
    trajectory: JointTrajectory | None
    cost: float
    smoothing_cost: float = 0.0
    iterations: int = 0
    max_defect: float | None = None
    replay_error_rad: float | None = None
    min_clearance_m: float | None = None
    certified: bool | None = None
    note: str = ""
    replay: Replay | None = None
    proven_clearance_m: float | None = None
    solver: str = ""
    planner: str = ""
    method: str = ""
    executed_cost: float | None = None

    @property
    def cost_gap(self) -> float | None:
        """Executed over stated cost, less one; above `LARGEST_COST_GAP` the status is `coarse`."""
        if self.executed_cost is None or not 0 < abs(self.cost) < float("inf"):
            return None
        return (self.executed_cost - self.cost) / abs(self.cost)

    def judged(self, executed_cost: float) -> Motion:
        """This motion with its executed cost, and `coarse` where that is not what it states."""
        judged = replace(self, executed_cost=executed_cost)
        gap = judged.cost_gap
        coarse = self.status.ok and gap is not None and abs(gap) > LARGEST_COST_GAP
        return replace(judged, status=Status.COARSE) if coarse else judged

    @property
    def duration_s(self) -> float:
        """Duration [s]; infinite without a trajectory."""
        return float("inf") if self.trajectory is None else self.trajectory.duration_s

    def replace(self, **changes: Any) -> Motion:
        """The same motion with some fields changed."""
        return replace(self, **changes)

    def require(self, problem: MotionProblem | None = None) -> Motion:
        """This motion if it may be used, else `MotionNotSolved`."""
        if not self.status.ok or self.trajectory is None:
            raise MotionNotSolved(problem, self)
        return self


class MotionNotSolved(RuntimeError):
    """`Motion.require()` on a motion that was not found; carries problem and motion."""

    def __init__(self, problem: MotionProblem | None, motion: Motion) -> None:
        self.problem, self.motion = problem, motion
        detail = f" ({motion.note})" if motion.note else ""
        super().__init__(f"{motion.status.value}{detail}: {motion.status.advice}")

    def __reduce__(self) -> tuple[type[MotionNotSolved], tuple[Any, ...]]:
        return (type(self), (self.problem, self.motion))


def straight_path(problem: MotionProblem) -> JointPath:
    """The straight joint-space path of a problem, through its departure and arrival knots."""
    parts = [problem.start_rad[None]]
    parts += [p for p in (problem.depart_rad, problem.arrive_rad) if p is not None]
    parts.append(problem.goal_rad[None])
    return JointPath(np.vstack(parts))
