"""What refinement needs to know of a station's geometry, without knowing any shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory


@dataclass(frozen=True)
class CertificateFailure:
    """A place that could not be proven free: interval k, λ in [0, 1] within it, and the pair."""

    interval: int
    fraction: float
    pair: tuple[str, str]
    distance_m: float


@dataclass(frozen=True)
class Certificate:
    """Whether a whole trajectory is proven free between its knots, and what was evaluated.

    `min_clearance_m` is the smallest distance met at the configurations that were evaluated
    (capped distances), not a proven minimum; `evaluations` counts them. `proven_clearance_m` is a
    distance that no pair undercuts anywhere on the trajectory, allowed contacts left out: at most
    the clearance that was asked for, None where nothing is proven.
    """

    ok: bool
    failures: tuple[CertificateFailure, ...]
    min_clearance_m: float
    evaluations: int
    proven_clearance_m: float | None = None


@dataclass(frozen=True)
class Rows:
    """Linearised distances near K configurations: for row r

    d_r(q) ≈ distance_m[r] + gradient[r] · (q − q_knot[r]),

    `knot` (R,) indexes the configurations that were passed in, `gradient` is (R, n) [m/rad],
    `pair` names the two bodies.
    """

    knot: npt.NDArray[np.int64]
    distance_m: Array
    gradient: Array
    pair: tuple[tuple[str, str], ...]


class Clearance(Protocol):
    """Distances between robot and surroundings (self included), as planning implements them.

    All configurations are rows of (K, n) arrays [rad]; distances [m] are negative in penetration.
    Contacts that are allowed (the gun tip at the weld, on its departure line) are left out.
    """

    def phi(self, q: Array) -> Array:
        """Smallest distance (K,), capped at the implementation's cap."""
        ...

    def weights(self, q: Array) -> Array:
        """The paper's w_i(q) = max_p ‖∂p/∂q_i‖₁ (K, n) [m/rad], never too small."""
        ...

    def reach(self, q: Array) -> Array:
        """R_j(q) (K, n) [m]: largest distance of a moved robot point to the axis of joint j."""
        ...

    def rows(self, q: Array, cap_m: float) -> Rows:
        """All pairs nearer than `cap_m`, linearised."""
        ...

    def certify(self, trajectory: JointTrajectory) -> Certificate:
        """Proof, or the places where it fails, on the trajectory's own interpolant."""
        ...
