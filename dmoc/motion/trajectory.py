"""Joint paths and the one interpolant that certificate, replay, export and DC link share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array, readonly
from dmoc.errors import ProblemError

if TYPE_CHECKING:
    from dmoc.robot.robot import Robot


class Sample(NamedTuple):
    """State of the interpolant at K times; `torque_nm` is None without a robot."""

    q_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array | None


@dataclass(frozen=True)
class JointPath:
    """A piecewise linear path through `q_rad` (K, n) [rad], without timing."""

    q_rad: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "q_rad", readonly(self.q_rad, "q_rad", ndim=2))


@dataclass(frozen=True)
class JointTrajectory:
    """Knots of a motion: `t_s` (N+1,), `q_rad` and `velocity_rad_s` (N+1, n), `torque_nm` (N, n).

    `torque_nm` is the transcription's torque, constant on every interval. Between the knots the
    motion *is* the cubic Hermite curve through (q_k, v_k): what is certified, replayed and
    exported. `robot` is needed only for torques along the curve (by inverse dynamics).
    """

    t_s: Array
    q_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    robot: Robot | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, ndim in (("t_s", 1), ("q_rad", 2), ("velocity_rad_s", 2), ("torque_nm", 2)):
            object.__setattr__(self, name, readonly(getattr(self, name), name, ndim=ndim))
        knots, joints = self.q_rad.shape
        shapes = (self.t_s.shape, self.velocity_rad_s.shape, self.torque_nm.shape)
        if shapes != ((knots,), (knots, joints), (knots - 1, joints)):
            raise ProblemError.of(
                "trajectory-shape",
                field="JointTrajectory",
                value=str(shapes),
                legal=f"t_s ({knots},), velocity ({knots}, {joints}), "
                f"torque ({knots - 1}, {joints})",
                fix="give one row per knot",
            )
        if knots < 2 or np.any(np.diff(self.t_s) <= 0):
            raise ProblemError.of(
                "trajectory-time",
                field="t_s",
                value=f"{knots} knots",
                legal="at least two strictly increasing times",
                fix="remove repeated time stamps",
            )

    @property
    def duration_s(self) -> float:
        """Time from the first to the last knot [s]."""
        return float(self.t_s[-1] - self.t_s[0])

    @property
    def num_intervals(self) -> int:
        """N."""
        return len(self.t_s) - 1

    def sample(self, t_s: Array | float) -> Sample:
        """q, q̇, q̈ (K, n) at times `t_s` (K,) by cubic Hermite; τ by inverse dynamics of it.

        Times outside [t_0, t_N] are clamped. At a knot the acceleration is that of the interval
        to its right (of the last interval at the end).
        """
        t = np.clip(np.atleast_1d(np.asarray(t_s, dtype=float)), self.t_s[0], self.t_s[-1])
        k = np.clip(np.searchsorted(self.t_s, t, side="right") - 1, 0, self.num_intervals - 1)
        h = (self.t_s[k + 1] - self.t_s[k])[:, None]
        s = (t[:, None] - self.t_s[k][:, None]) / h
        q0, q1 = self.q_rad[k], self.q_rad[k + 1]
        v0, v1 = self.velocity_rad_s[k] * h, self.velocity_rad_s[k + 1] * h
        d = q1 - q0
        c2, c3 = 3 * d - 2 * v0 - v1, v0 + v1 - 2 * d
        q = q0 + s * (v0 + s * (c2 + s * c3))
        v = (v0 + s * (2 * c2 + 3 * s * c3)) / h
        a = (2 * c2 + 6 * s * c3) / (h * h)
        torque = None
        if self.robot is not None:
            torque = inverse_dynamics(self.robot.model, q, v, a)
        return Sample(q, v, a, torque)

    def on(self, robot: Robot | None) -> JointTrajectory:
        """The same knots with `robot` for the torques along them; None samples without torques."""
        return self if self.robot is robot else replace(self, robot=robot)

    def reversed(self) -> JointTrajectory:
        """The same curve run backwards; torques stay (no friction)."""
        return JointTrajectory(
            self.t_s[-1] - self.t_s[::-1],
            self.q_rad[::-1],
            -self.velocity_rad_s[::-1],
            self.torque_nm[::-1],
            self.robot,
        )


def inverse_dynamics(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """τ (K, n) [N·m] of `pin.rnea`, rotor armature included, for rows of q, v, a (K, n)."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(q, v, a)])
