"""A Bézier motion to be found, and its batched evaluation: cost, limits and their gradient."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array, joint_vector
from dmoc.bezier import NUM_CONTROLS, BezierMotion, bernstein
from dmoc.chain import Chain, chain_of
from dmoc.errors import Fault, ProblemError
from dmoc.motion_metrics import Metric, MotionState, metric_of
from dmoc.robot import Robot
from dmoc.trajectory import JointTrajectory

__all__ = ["BezierProblem", "BezierResult", "Evaluator", "metric_values"]

# The search keeps this share of every limit, because it looks at samples only.
LIMIT_SHARE = 0.99


@dataclass(frozen=True)
class BezierProblem:
    """Seven control points per joint; the first and the last are `start_rad` and `goal_rad` (n,).

    The second and the last but one stay within `end_range_rad` of them (the paper's Δ_1, Δ_5), so
    end velocities are at most 6·end_range/T; 0 means at rest. The three in between are free in
    [−box_rad, box_rad] and the joint limits. `metric` is a name of `dmoc.motion_metrics`; it is
    integrated over `num_samples` midpoints during the search. Velocity, acceleration and torque
    limits of the robot hold throughout.

    Source: Vysocký et al. (2020), Table 1 and Fig. 3.
    """

    robot: Robot
    start_rad: Array
    goal_rad: Array
    duration_s: float = 3.0
    metric: str = "energy"
    end_range_rad: float = 0.1
    box_rad: float = 6.28
    num_samples: int = 48

    def __post_init__(self) -> None:
        n = self.robot.num_joints
        for name in ("start_rad", "goal_rad"):
            object.__setattr__(self, name, joint_vector(getattr(self, name), name, n))
        legal = {"duration_s": 1e-3, "end_range_rad": 0.0, "box_rad": 1e-3, "num_samples": 8}
        faults = [
            Fault("bezier-value", field=name, value=repr(getattr(self, name)), legal=f">= {least}",
                  fix="see BezierProblem")
            for name, least in legal.items()
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= least)
        ]  # fmt: skip
        for name in ("start_rad", "goal_rad"):
            q = getattr(self, name)
            low, high = self._hull()
            if np.any(q < low) or np.any(q > high):
                faults.append(
                    Fault("joint-limit", field=name, value=np.array2string(q, precision=4),
                          legal="within the joint limits and ±box_rad",
                          fix="choose a configuration within the limits")
                )  # fmt: skip
        if faults:
            raise ProblemError(faults)
        metric_of(self.metric, self.robot)

    def _hull(self) -> tuple[Array, Array]:
        return (
            np.maximum(self.robot.q_lower_rad, -self.box_rad),
            np.minimum(self.robot.q_upper_rad, self.box_rad),
        )

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (5 n,) of the inner control points, point by point."""
        low, high = self._hull()
        lower = np.tile(low, (5, 1))
        upper = np.tile(high, (5, 1))
        for row, end in ((0, self.start_rad), (4, self.goal_rad)):
            lower[row] = np.maximum(low, end - self.end_range_rad)
            upper[row] = np.minimum(high, end + self.end_range_rad)
        return lower.ravel(), upper.ravel()

    def controls(self, x: Array) -> Array:
        """Control points (..., 7, n) of search points x (..., 5 n)."""
        n = self.robot.num_joints
        inner = np.asarray(x, dtype=float).reshape(*np.shape(x)[:-1], 5, n)
        ends = (
            np.broadcast_to(self.start_rad, (*inner.shape[:-2], 1, n)),
            np.broadcast_to(self.goal_rad, (*inner.shape[:-2], 1, n)),
        )
        return np.concatenate([ends[0], inner, ends[1]], axis=-2)

    def motion(self, x: Array) -> BezierMotion:
        """The motion of one search point x (5 n,)."""
        return BezierMotion(self.controls(x), self.duration_s)

    @property
    def idle_joints(self) -> npt.NDArray[np.bool_]:
        """Joints (n,) that start and goal do not ask to move."""
        return np.asarray(np.abs(self.goal_rad - self.start_rad) < 1e-9)

    @property
    def straight(self) -> Array:
        """Search point (5 n,) of the straight line, at rest at both ends."""
        share = np.array([0.0, 0.25, 0.5, 0.75, 1.0])[:, None]
        return np.ravel(self.start_rad + share * (self.goal_rad - self.start_rad))


@dataclass(frozen=True)
class BezierResult:
    """Best motion of a search and its value in the problem's metric, integrated finely.

    `limits` holds the largest share of each limit that is used (`BezierMotion.limit_use`);
    `feasible` says that none exceeds 1 and that nothing was forbidden; `evaluations` counts curves,
    `gradients` those with a gradient; `history` is the best value after each iteration, in the
    search's own quadrature, infinite before anything legal was met.
    """

    motion: BezierMotion
    value: float
    feasible: bool
    limits: dict[str, float]
    evaluations: int
    gradients: int
    history: Array
    note: str = ""


class Evaluation(NamedTuple):
    """Costs (P,) in the metric and how far samples exceed the limits (P,), 0 where legal."""

    cost: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class Evaluator:
    """Everything about a problem that does not change during a search."""

    problem: BezierProblem
    metric: Metric = field(init=False)
    chain: Chain = field(init=False)
    basis: tuple[Array, ...] = field(init=False)
    ends: tuple[Array, Array] = field(init=False)
    weight: float = field(init=False)

    def __post_init__(self) -> None:
        p = self.problem
        u = (np.arange(p.num_samples) + 0.5) / p.num_samples
        basis = tuple(p.duration_s**-k * bernstein(u, NUM_CONTROLS - 1, k) for k in range(4))
        for name, value in {
            "metric": metric_of(p.metric, p.robot), "chain": chain_of(p.robot), "basis": basis,
            "weight": p.duration_s / p.num_samples,
            "ends": tuple(
                p.duration_s**-k * bernstein(np.array([0.0, 1.0]), NUM_CONTROLS - 1, k)
                for k in (1, 2)
            ),
        }.items():  # fmt: skip
            object.__setattr__(self, name, value)

    def curves(self, x: Array) -> Array:
        """Sampled q (..., K, n) of search points x (..., 5 n)."""
        return np.asarray(self.basis[0] @ self.problem.controls(x))

    def evaluate(self, x: Array, smoothing: float = 0.0) -> Evaluation:
        """Costs and limit excess of search points x (P, 5 n), all at once."""
        controls = self.problem.controls(x)
        state, _ = self._state(controls)
        cost = self.weight * self.metric.rate(state, smoothing).sum(axis=-1)
        excess = np.zeros(len(cost))
        for value, limit in self._limited(state):
            over = np.maximum(np.abs(value) / limit - LIMIT_SHARE, 0.0)
            excess += over.max(axis=(1, 2))
        for basis, limit in self._end_limits():
            over = np.maximum(np.abs(basis @ controls) / limit - LIMIT_SHARE, 0.0)
            excess += over.max(axis=(1, 2))
        return Evaluation(cost, excess)

    def descend(self, x: Array, smoothing: float, price: float) -> tuple[float, Array]:
        """Cost plus `price`·∫Σ excess² of one search point x (5 n,), and its gradient (5 n,)."""
        controls = self.problem.controls(x)
        state, q = self._state(controls)
        pull = self.metric.pull(state, smoothing)
        value = self.weight * float(pull.rate.sum())
        by: list[Any] = [pull.velocity, pull.acceleration, pull.jerk, pull.torque]
        for index, (array, limit) in zip((0, 1, 3), self._limited(state)):
            over = np.abs(array) / limit - LIMIT_SHARE
            if over.max() > 0:
                over = np.maximum(over, 0.0)
                value += price * self.weight * float(np.sum(over * over))
                slope = 2.0 * price * over * np.sign(array) / limit
                by[index] = slope if by[index] is None else by[index] + slope
        gradient = np.zeros_like(controls)
        for basis, limit in self._end_limits():
            array = basis @ controls
            over = np.maximum(np.abs(array) / limit - LIMIT_SHARE, 0.0)
            if over.max() > 0:
                value += price * self.weight * float(np.sum(over * over))
                gradient += basis.T @ (2.0 * price * over * np.sign(array) / limit)
        if by[3] is not None:
            by_q, by_v, by_a = self.chain.pull_back(q, state.velocity, state.acceleration, by[3])
            gradient += self.basis[0].T @ by_q
            by[0] = by_v if by[0] is None else by[0] + by_v
            by[1] = by_a if by[1] is None else by[1] + by_a
        for basis, part in zip(self.basis[1:], by):
            if part is not None:
                gradient += basis.T @ part
        return value, self.weight * gradient[1:-1].ravel()

    def _state(self, controls: Array) -> tuple[MotionState, Array]:
        q, v, a = (basis @ controls for basis in self.basis[:3])
        jerk = a if self.metric.needs_torque else self.basis[3] @ controls
        return MotionState(v, a, jerk, self.chain.torque_nm(q, v, a)), q

    def _end_limits(self) -> tuple[tuple[Array, Array], ...]:
        """Velocity and acceleration at both ends, where midpoints do not look."""
        robot = self.problem.robot
        limits = (robot.velocity_limit_rad_s, robot.acceleration_limit_rad_s2)
        return tuple(zip(self.ends, limits))

    def _limited(self, state: MotionState) -> tuple[tuple[Array, Array], ...]:
        robot = self.problem.robot
        return (
            (state.velocity, robot.velocity_limit_rad_s),
            (state.acceleration, robot.acceleration_limit_rad_s2),
            (state.torque, robot.torque_limit_nm),
        )


def metric_values(
    motion: BezierMotion | JointTrajectory,
    robot: Robot,
    names: tuple[str, ...],
    num_samples: int = 2000,
) -> dict[str, float]:
    """Exact (unsmoothed) value of each metric, integrated over `num_samples` midpoints.

    The common fine replay of Bézier motions and of trajectories (whose jerk counts as 0).
    """
    step = float(motion.duration_s / num_samples)
    t: Array = (np.arange(num_samples) + 0.5) * step
    if isinstance(motion, BezierMotion):
        q, v, a, jerk = (motion.derivative(t, k) for k in range(4))
    else:
        sample = replace(motion, robot=None).sample(motion.t_s[0] + t)
        q, v, a = sample.q_rad, sample.velocity_rad_s, sample.acceleration_rad_s2
        jerk = np.zeros_like(a)
    state = MotionState(v, a, jerk, chain_of(robot).torque_nm(q, v, a))
    return {name: step * float(metric_of(name, robot).rate(state, 0.0).sum()) for name in names}
