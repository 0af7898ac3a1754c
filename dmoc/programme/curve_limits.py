r"""Speed and acceleration of the executed curve, and rows of a programme that keep them.

What is exported is the cubic Hermite curve through (q_k, q̇_k). On an interval its acceleration is
linear, α_k ∓ β_k/2 at the two ends, with α_k = (q̇_{k+1} − q̇_k)/h and
β_k = 6 (q̇_k + q̇_{k+1} − 2 (q_{k+1} − q_k)/h)/h. The torque is constant there, so β is small.

Second differences of the knots show only the mean of two neighbouring α, so an alternating
acceleration would pass them. Its other half is the jump of the torque, α_k − α_{k−1} ≈ M⁻¹Δu:

.. math:: α_k ≈ (q_{k+1} - 2 q_k + q_{k-1})/h^2 + M_k^{-1} (u_k - u_{k-1})/2, \qquad
          \dot q_k ≈ (q_{k+1} - q_{k-1})/2h - h M_k^{-1} (u_k - u_{k-1})/4 .

These are the rows. M_k, β and what the two formulas miss are taken from the solution before, so
that a solution which repeats them keeps the limits exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.physics.state import mass_matrices
from dmoc.robot.robot import Robot

# The curve may exceed a limit by this share; the promise made to users is 1 %.
CURVE_SLACK = 0.005
# Nor may it leave the range of a joint by more [rad].
POSITION_SLACK_RAD = 1e-5
# More than this is never taken off a limit.
_MOST_MARGIN = 0.3
# Nor more than this on the word of a solution that breaks the limits.
_MOST_GUESSED = 0.1


@dataclass(frozen=True)
class Curve:
    """The curve as shares of the limits: α `mean` and β `slope` (N, n) of q̈, |q̇| `speed` (N, n).

    `knot_speed` (N−1, n) is q̇ at the inner knots.
    """

    mean: Array
    slope: Array
    speed: Array
    knot_speed: Array

    @property
    def hardest(self) -> Array:
        """The largest |q̈| (N, n)."""
        return np.abs(self.mean) + np.abs(self.slope) / 2

    def breaks_acceleration(self, slack: float = CURVE_SLACK) -> bool:
        """Whether q̈ exceeds its limit by more than the share `slack`."""
        return bool(self.hardest.max() > 1.0 + slack)

    def breaks_velocity(self, slack: float = CURVE_SLACK) -> bool:
        """Whether q̇ exceeds its limit by more than the share `slack`."""
        return bool(self.speed.max() > 1.0 + slack)


@dataclass(frozen=True)
class Lag:
    """What the rows take from an earlier solution, as shares: `slope` β (N, n), and what the rows
    lack, `acceleration` (N, n), `velocity` (N−1, n) and `jerk` (N+1, n)."""

    slope: Array
    acceleration: Array
    velocity: Array
    jerk: Array

    def tempered(self, curve: Curve) -> Lag:
        """Less of it the further its curve is outside the limits, where it says little."""
        share = 1.0 / max(1.0, float(curve.hardest.max()), float(curve.speed.max()) ** 2)
        parts = (self.slope, self.acceleration, self.velocity, self.jerk)
        return Lag(*(np.clip(share * part, -_MOST_GUESSED, _MOST_GUESSED) for part in parts))


@dataclass(frozen=True)
class Margins:
    """Bounds of the rows: a lag, and `brake` (N, n), `slow` (N−1, n) taken off the limits.

    `inside` (2, N+1, n) [rad] is taken off the lower and the upper ends of the joints' ranges.
    `smooth` (N+1, n) is taken off the limits of the rows of jerk.
    `mobility` (N−1, n, n) is M⁻¹ at the inner knots, None where no rows need it.
    """

    lag: Lag
    brake: Array
    slow: Array
    inside: Array
    smooth: Array
    mobility: Array | None = None

    @property
    def acceleration(self) -> tuple[Array, Array]:
        """Lower and upper bounds (N, n) of the rows of acceleration."""
        room = 1.0 - np.minimum(np.abs(self.lag.slope) / 2 + self.brake, _MOST_MARGIN)
        return -room - self.lag.acceleration, room - self.lag.acceleration

    @property
    def velocity(self) -> tuple[Array, Array]:
        """Lower and upper bounds (N−1, n) of the rows of velocity."""
        room = 1.0 - np.minimum(self.slow, _MOST_MARGIN)
        return -room - self.lag.velocity, room - self.lag.velocity

    @property
    def jerk(self) -> tuple[Array, Array]:
        """Lower and upper bounds (N+1, n) of the rows of jerk."""
        room = 1.0 - np.minimum(self.smooth, _MOST_MARGIN)
        return -room - self.lag.jerk, room - self.lag.jerk

    def smoothed(self, jerk: Array) -> Margins:
        """The rows of jerk give way by the share that `jerk` (N+1, n) is beyond the limit."""
        return replace(self, smooth=self.smooth + np.maximum(np.abs(jerk) - 1.0, 0.0))

    def corrected(self, curve: Curve) -> Margins:
        """Bounds give way by as much as the curve is still beyond a limit."""
        beyond = np.maximum(np.maximum(curve.speed[:-1], curve.speed[1:]) - 1.0, 0.0)
        return replace(
            self, brake=self.brake + np.maximum(curve.hardest - 1.0, 0.0), slow=self.slow + beyond
        )


def no_margins(lag: Lag) -> Margins:
    """The limits themselves."""
    count, n = lag.slope.shape
    return Margins(
        lag,
        np.zeros_like(lag.slope),
        np.zeros_like(lag.velocity),
        np.zeros((2, count + 1, n)),
        np.zeros((count + 1, n)),
    )


def jerk_of(problem: MotionProblem, velocity_rad_s: Array, h: float) -> Array:
    """The change of the acceleration at every knot per step, (N+1, n) in shares of the limit.

    Before and after the motion the speed is steady; zero where there is no limit.
    """
    still, limit = np.zeros((1, problem.robot.num_joints)), problem.jerk_limit_rad_s3
    jerk = np.diff(np.vstack([still, np.diff(velocity_rad_s, axis=0) / h, still]), axis=0) / h
    if problem.limits.free_goal_velocity:  # what follows is unknown
        jerk[-1] = 0.0
    return np.zeros_like(jerk) if limit is None else jerk / limit


def excess_of(robot: Robot, q_rad: Array, velocity_rad_s: Array, h: float) -> Array:
    """How far [rad] the curve leaves the joints' ranges, (2, N, n): below and above."""
    q0, d = q_rad[:-1], np.diff(q_rad, axis=0)
    v0, v1 = h * velocity_rad_s[:-1], h * velocity_rad_s[1:]
    c2, c3 = 3 * d - 2 * v0 - v1, v0 + v1 - 2 * d
    # Where q̇ = v0 + 2 c2 s + 3 c3 s² is zero; the stable form of both roots.
    root = np.sqrt(np.maximum(c2 * c2 - 3 * c3 * v0, 0.0))
    sum_ = -(c2 + np.where(c2 < 0, -root, root))
    low, high = np.minimum(q_rad[:-1], q_rad[1:]), np.maximum(q_rad[:-1], q_rad[1:])
    for top, bottom in ((sum_, 3 * c3), (v0, sum_)):
        share = np.divide(top, bottom, out=np.zeros_like(top), where=bottom != 0.0)
        s = np.clip(share, 0.0, 1.0)
        q = q0 + s * (v0 + s * (c2 + s * c3))
        low, high = np.minimum(low, q), np.maximum(high, q)
    return np.stack([robot.q_lower_rad - low, high - robot.q_upper_rad])


def moved_inside(inside: Array, excess: Array) -> Array:
    """`inside` and what the curve beside each knot still has in excess."""
    more = np.maximum(excess, 0.0)
    grown = np.array(inside)
    grown[:, :-1] += more
    grown[:, 1:] = np.maximum(grown[:, 1:], inside[:, 1:] + more)
    return grown


def no_lag(num_intervals: int, num_joints: int) -> Lag:
    """Of a curve with constant acceleration on every interval."""
    zero = np.zeros((num_intervals, num_joints))
    return Lag(zero, zero, zero[1:], np.zeros((num_intervals + 1, num_joints)))


def curve_of(robot: Robot, q_rad: Array, velocity_rad_s: Array, h: float) -> Curve:
    """The curve through knots q, q̇ (N+1, n) with step h [s]."""
    v0, v1 = velocity_rad_s[:-1], velocity_rad_s[1:]
    v = np.diff(q_rad, axis=0) / h
    mean, slope = (v1 - v0) / h, 6 * (v0 + v1 - 2 * v) / h
    first, last = mean - slope / 2, mean + slope / 2
    # Where q̈ changes its sign q̇ has an extreme of its own.
    turns = first * last < 0
    share = np.where(turns, first / np.where(turns, first - last, 1.0), 0.0)
    peak = np.abs(v0 + h * share * first / 2)
    speed = np.maximum(peak, np.maximum(np.abs(v0), np.abs(v1)))
    a, top = robot.acceleration_limit_rad_s2, robot.velocity_limit_rad_s
    return Curve(mean / a, slope / a, speed / top, velocity_rad_s[1:-1] / top)


def mean_curve_of(problem: MotionProblem, q_rad: Array, h: float) -> Curve:
    """Mean speeds of the intervals and accelerations between them: all that a coarse grid knows."""
    robot = problem.robot
    v = np.diff(q_rad, axis=0) / h
    ends = 2 * (v[:1] - problem.start_velocity_rad_s), 2 * (problem.goal_velocity_rad_s - v[-1:])
    steps = [ends[0], np.diff(v, axis=0)]
    if not problem.limits.free_goal_velocity:
        steps.append(ends[1])
    accelerations = np.vstack(steps) / (h * robot.acceleration_limit_rad_s2)
    speeds = np.abs(v) / robot.velocity_limit_rad_s
    return Curve(accelerations, np.zeros_like(accelerations), speeds, speeds)


def mobility_of(robot: Robot, q_rad: Array) -> Array:
    """M⁻¹ (N−1, n, n) at the inner ones of the knots q (N+1, n)."""
    return np.array(np.linalg.inv(mass_matrices(robot, q_rad[1:-1])), dtype=float)


def lag_of(
    problem: MotionProblem,
    curve: Curve,
    q_rad: Array,
    velocity_rad_s: Array,
    torque_nm: Array,
    h: float,
    mobility: Array,
) -> Lag:
    """What the rows with M⁻¹ = `mobility` lack at a solution whose curve is `curve`."""
    robot = problem.robot
    v = np.diff(q_rad, axis=0) / h
    jump = np.einsum("kij,kj->ki", mobility, np.diff(torque_nm, axis=0))
    first = 2 * (v[:1] - problem.start_velocity_rad_s) / h
    accelerations = np.vstack([first, np.diff(v, axis=0) / h + jump / 2])
    speeds = (v[1:] + v[:-1]) / 2 - h * jump / 4
    return Lag(
        curve.slope,
        curve.mean - accelerations / robot.acceleration_limit_rad_s2,
        curve.knot_speed - speeds / robot.velocity_limit_rad_s,
        _jerk_lag(problem, v, jump, velocity_rad_s, h),
    )


def _jerk_lag(
    problem: MotionProblem, v: Array, jump: Array, velocity_rad_s: Array, h: float
) -> Array:
    """What the rows of jerk lack; `v` (N, n) are mean speeds, `jump` (N−1, n) is M⁻¹Δu."""
    found, limit = jerk_of(problem, velocity_rad_s, h), problem.jerk_limit_rad_s3
    if limit is None:
        return found
    first = 2 * (v[:1] - problem.start_velocity_rad_s) / h
    last = 2 * (v[-1:] - problem.goal_velocity_rad_s) / h
    return np.asarray(found - np.vstack([first, jump, last]) / (h * limit))
