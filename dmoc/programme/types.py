"""What goes into and comes out of one nonlinear programme of a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.status import Status


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
