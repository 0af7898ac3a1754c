"""A Bézier motion to be found, and its batched evaluation: cost, limits and their gradient."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array, joint_vector
from dmoc.errors import Fault, ProblemError
from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.metrics import MotionState, metric_of, settled
from dmoc.robot.robot import Robot
from studies.ur3.adjoint_dynamics import chain_of
from studies.ur3.bezier_motion import NUM_CONTROLS, BezierMotion, bernstein
from studies.ur3.curve_cost import CurveCost, CurveEvaluation


@dataclass(frozen=True)
class BezierProblem:
    """Seven control points per joint; the first and the last are `start_rad` and `goal_rad` (n,).

    The second and the last but one stay within `end_range_rad` of them (the paper's Δ_1, Δ_5), so
    end velocities are at most 6·end_range/T; 0 means at rest. The three in between are free in
    [−box_rad, box_rad] and the joint limits. `metric` is a name of `dmoc.physics.metrics`; it is
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
            Fault(
                "bezier-value",
                field=name,
                value=repr(getattr(self, name)),
                legal=f">= {least}",
                fix="see BezierProblem",
            )
            for name, least in legal.items()
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= least)
        ]
        for name in ("start_rad", "goal_rad"):
            q = getattr(self, name)
            low, high = self._hull()
            if np.any(q < low) or np.any(q > high):
                faults.append(
                    Fault(
                        "joint-limit",
                        field=name,
                        value=np.array2string(q, precision=4),
                        legal="within the joint limits and ±box_rad",
                        fix="choose a configuration within the limits",
                    )
                )
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


@dataclass(frozen=True, eq=False)
class Evaluator:
    """Everything about a problem that does not change during a search."""

    problem: BezierProblem
    cost: CurveCost = field(init=False)

    def __post_init__(self) -> None:
        p = self.problem
        u = (np.arange(p.num_samples) + 0.5) / p.num_samples
        scale = [float(p.duration_s**-k) for k in range(4)]
        q, v, a, jerk = (scale[k] * bernstein(u, NUM_CONTROLS - 1, k) for k in range(4))
        first, second = (
            scale[k] * bernstein(np.array([0.0, 1.0]), NUM_CONTROLS - 1, k) for k in (1, 2)
        )
        weight = p.duration_s / p.num_samples
        cost = CurveCost(p.robot, p.metric, (q, v, a, jerk), (first, second), weight)
        object.__setattr__(self, "cost", cost)

    def curves(self, x: Array) -> Array:
        """Sampled q (..., K, n) of search points x (..., 5 n)."""
        return np.asarray(self.cost.basis[0] @ self.problem.controls(x))

    def evaluate(self, x: Array, smoothing: float = 0.0) -> CurveEvaluation:
        """Costs and limit excess of search points x (P, 5 n), all at once."""
        return self.cost.evaluate(self.problem.controls(x), smoothing)

    def descend(self, x: Array, smoothing: float, price: float) -> tuple[float, Array]:
        """Cost plus `price`·∫Σ excess² of one search point x (5 n,), and its gradient (5 n,)."""
        value, gradient = self.cost.descend(self.problem.controls(x), smoothing, price)
        return value, gradient[1:-1].ravel()


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
    t = np.linspace(0.5 * step, motion.duration_s - 0.5 * step, num_samples)
    if isinstance(motion, BezierMotion):
        q, v, a, jerk = (motion.derivative(t, k) for k in range(4))
    else:
        sample = replace(motion, robot=None).sample(motion.t_s[0] + t)
        q, v, a = sample.q_rad, sample.velocity_rad_s, sample.acceleration_rad_s2
        jerk = np.zeros_like(a)
    v = settled(v)
    state = MotionState(v, a, jerk, chain_of(robot).torque_nm(q, v, a))
    return {name: step * float(metric_of(name, robot).rate(state, 0.0).sum()) for name in names}
