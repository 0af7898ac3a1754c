r"""Joint motions as Bézier curves with seven control points.

.. math:: q(t) = \sum_{i=0}^{d} B_{d,i}(t/T) P_i, \qquad
          B_{d,i}(u) = \binom{d}{i} u^i (1-u)^{d-i}

with d = 6 in the UR3 paper (Eqs. 4 and 5). Every derivative is again a Bézier curve, of the
differences of the control points, so velocity and acceleration are exact, and so are their
extremes: roots of polynomials, not samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, perm

import numpy as np

from dmoc.arrays import Array, readonly
from dmoc.errors import ProblemError
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.robot.robot import Robot

NUM_CONTROLS = 7


def bernstein(u: Array, degree: int, derivative: int = 0) -> Array:
    """Matrix (K, degree + 1) that maps control points to the curve's `derivative` in u at u (K,).

    The k-th derivative is d!/(d−k)! Σ B_{d−k,i}(u) Δᵏ P_i.
    """
    u = np.asarray(u, dtype=float)[:, None]
    lower = degree - derivative
    i = np.arange(lower + 1)
    basis = np.array([comb(lower, int(k)) for k in i]) * u**i * (1.0 - u) ** (lower - i)
    differences = np.diff(np.eye(degree + 1), n=derivative, axis=0)
    return np.asarray(perm(degree, derivative) * basis @ differences)


@dataclass(frozen=True)
class BezierMotion:
    """Control points `control_rad` (d + 1, n) [rad], run through in `duration_s` [s]."""

    control_rad: Array
    duration_s: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "control_rad", readonly(self.control_rad, "control_rad", 2))
        if len(self.control_rad) < 4:
            raise ProblemError.of(
                "bezier-controls",
                field="control_rad",
                value=f"{len(self.control_rad)}",
                legal=">= 4 control points",
                fix="use seven, as the paper does",
            )
        if not (np.isfinite(self.duration_s) and self.duration_s > 0):
            raise ProblemError.of(
                "duration",
                field="duration_s",
                value=repr(self.duration_s),
                legal="> 0 s",
                fix="give the time that the motion takes",
            )

    @property
    def degree(self) -> int:
        """d."""
        return len(self.control_rad) - 1

    @property
    def end_velocity_rad_s(self) -> tuple[Array, Array]:
        """Velocities (n,) at start and end: d (P_1 − P_0)/T and d (P_d − P_{d−1})/T."""
        rate = self.degree / self.duration_s
        first, last = np.diff(self.control_rad, axis=0)[[0, -1]]
        return rate * first, rate * last

    def derivative(self, t_s: Array, order: int) -> Array:
        """The `order`-th time derivative (K, n) at times `t_s` (K,) in [0, T]; 0 is q itself."""
        u = np.clip(np.asarray(t_s, dtype=float) / self.duration_s, 0.0, 1.0)
        scale = self.duration_s**-order
        return np.asarray(scale * bernstein(u, self.degree, order) @ self.control_rad)

    def largest(self, order: int) -> Array:
        """Largest |derivative of `order`| (n,) over the whole motion, exactly.

        The extremes lie at the ends or at roots of the next derivative.
        """
        found = np.abs(self.derivative(np.array([0.0, self.duration_s]), order)).max(axis=0)
        for j, coefficients in enumerate(self._power_basis(order + 1).T):
            roots = np.roots(coefficients[::-1])
            u = roots.real[(np.abs(roots.imag) < 1e-7) & (roots.real > 0) & (roots.real < 1)]
            if u.size:
                inside = self.derivative(u * self.duration_s, order)[:, j]
                found[j] = max(found[j], np.abs(inside).max())
        return found

    def _power_basis(self, order: int) -> Array:
        """Coefficients (d − order + 1, n) of u⁰, u¹, … of the derivative in u."""
        lower = self.degree - order
        points = perm(self.degree, order) * np.diff(self.control_rad, n=order, axis=0)
        rows = [comb(lower, k) * np.diff(points[: k + 1], n=k, axis=0)[0] for k in range(lower + 1)]
        return np.array(rows)

    def limit_use(self, robot: Robot) -> dict[str, float]:
        """Largest share of each limit that is used: 1 is on the limit, more is beyond it.

        `velocity` and `acceleration` are exact; `position` is that of the control points, whose
        hull holds the curve; `torque` is sampled at 401 times.
        """
        t = np.linspace(0.0, self.duration_s, 401)
        torque = inverse_dynamics(robot.model, *(self.derivative(t, k) for k in range(3)))
        middle = 0.5 * (robot.q_upper_rad + robot.q_lower_rad)
        half = 0.5 * (robot.q_upper_rad - robot.q_lower_rad)
        return {
            "position": float(np.max(np.abs(self.control_rad - middle) / half)),
            "velocity": float(np.max(self.largest(1) / robot.velocity_limit_rad_s)),
            "acceleration": float(np.max(self.largest(2) / robot.acceleration_limit_rad_s2)),
            "torque": float(np.max(np.abs(torque) / robot.torque_limit_nm)),
        }

    def trajectory(self, robot: Robot, num_intervals: int = 100) -> JointTrajectory:
        """Knots of the curve, uniform in time; torques by inverse dynamics at the midpoints."""
        t = np.linspace(0.0, self.duration_s, num_intervals + 1)
        middle = 0.5 * (t[1:] + t[:-1])
        torque = inverse_dynamics(robot.model, *(self.derivative(middle, k) for k in range(3)))
        q = self.derivative(t, 0)
        q[0], q[-1] = self.control_rad[0], self.control_rad[-1]
        return JointTrajectory(t, q, self.derivative(t, 1), torque, robot)


def fitted_controls(trajectory: JointTrajectory) -> Array:
    """Control points (`NUM_CONTROLS`, n) of the curve nearest to a trajectory, its ends kept.

    Least squares over 101 times; P_1 = P_0 and P_{d−1} = P_d, so the curve starts and ends at rest.
    """
    u = np.linspace(0.0, 1.0, 101)
    q = trajectory.sample(trajectory.t_s[0] + u * trajectory.duration_s).q_rad
    basis = bernstein(u, NUM_CONTROLS - 1)
    start, goal = trajectory.q_rad[0], trajectory.q_rad[-1]
    rest = q - basis[:, :2].sum(axis=1)[:, None] * start - basis[:, -2:].sum(axis=1)[:, None] * goal
    inner = np.linalg.lstsq(basis[:, 2:-2], rest, rcond=None)[0]
    return np.vstack([start, start, inner, goal, goal])
