"""What goes into and comes out of one nonlinear programme of a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.errors import Fault, ProblemError
from dmoc.motion.status import Status

SOLVERS = ("ipopt", "structured")


@dataclass(frozen=True)
class SolveParams:
    """Options of a solve. `tolerance` is Ipopt's `tol` on the scaled problem.

    With `limit_curve` position, speed, acceleration and jerk limits hold on the whole executed
    curve (to 1 %, position to 1e-5 rad), else only for the knots. What the curve does beyond its
    rows is known only afterwards: up to `curve_corrections` further solves take it in; with 0 the
    next warm start does.
    `solver` is `ipopt`, or `structured`, our own interior-point method (`dmoc.interior`), which
    finds the same optima several times faster and hands on to Ipopt what does not fit it (RMS
    torque, conditions on the end, rows with equal bounds) or where it gets stuck.
    """

    tolerance: float = 1e-6
    acceptable_tolerance: float = 1e-4
    acceptable_iterations: int = 15
    max_iterations: int = 300
    limit_curve: bool = True
    curve_corrections: int = 5
    solver: str = "ipopt"

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise ProblemError(
                Fault(
                    "solver",
                    field="params.solver",
                    value=self.solver,
                    legal=", ".join(SOLVERS),
                    fix="leave it out",
                )
            )


DEFAULT_PARAMS = SolveParams()


@dataclass(frozen=True)
class Box:
    """Bounds of the knots, (N+1, n) each, within the robot's limits."""

    q_lower_rad: Array
    q_upper_rad: Array


@dataclass(frozen=True)
class PathRows:
    """Half-spaces gradient·((1−λ) q_i + λ q_{i+1}) ≥ lower for R rows.

    `interval` (R,) is i in 0..N−1, `fraction` (R,) is λ in [0, 1], `gradient` (R, n) [m/rad],
    `lower` (R,) [m].
    """

    interval: npt.NDArray[np.int64]
    fraction: Array
    gradient: Array
    lower: Array


@dataclass(frozen=True)
class Guess:
    """Where a solve starts: knots (N+1, n), torques (N, n), step [s], and multipliers if warm."""

    q_rad: Array
    torque_nm: Array
    step_s: float
    multipliers: Any = None


@dataclass(frozen=True)
class NlpSolution:
    """Where it ended. `multipliers` is opaque and only fed back through `Guess`.

    `cost` is J as `Cost.transcription` says that it is reported, without smoothing.

    `solver` is the one that found it: with `structured` it is `ipopt` where that had to go on, and
    `iterations` are those of both.
    """

    status: Status
    q_rad: Array
    torque_nm: Array
    velocity_rad_s: Array
    step_s: float
    cost: float
    smoothing_cost: float
    iterations: int
    max_defect: float
    multipliers: Any
    solver: str = "ipopt"
