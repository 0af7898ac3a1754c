"""Certificate: a proof that a trajectory is free of contact between its knots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.clearance import Certificate, CertificateFailure
from dmoc.motion.trajectory import JointTrajectory
from planning.collision.kernels.proof import bisection_workspace, prove

if TYPE_CHECKING:
    from planning.collision.scene import Scene, Scope


class JudgedWorld(Protocol):
    """What the certificate reads of a world."""

    @property
    def scene(self) -> Scene: ...
    @property
    def clearance_m(self) -> float: ...
    def pair_of(self, pair: int) -> tuple[str, str]: ...


class Judged(Protocol):
    """The clearance of one motion, as `planning.collision.world.EdgeClearance` implements it."""

    @property
    def world(self) -> JudgedWorld: ...
    @property
    def scope(self) -> Scope: ...
    @property
    def tracking_error_m(self) -> float: ...
    def phi(self, q_rad: Array) -> Array: ...


MAX_DEPTH = 14
MAX_FAILURES = 64
#: The proven clearance is at most this share of the demanded one below the smallest distance,
LEVEL_TOLERANCE = 0.02
#: or as low as so many halvings of an interval can prove.
LEVEL_DEPTH = 11


def bezier_of(trajectory: JointTrajectory) -> Array:
    """Bézier control points (N, 4, n) of the trajectory's cubic Hermite curve: q_k, q_k + h v_k/3,
    q_{k+1} − h v_{k+1}/3, q_{k+1}. The curve lies within their bounds on every interval.
    """
    h = np.diff(trajectory.t_s)[:, None]
    q, v = trajectory.q_rad, trajectory.velocity_rad_s
    return np.ascontiguousarray(
        np.stack([q[:-1], q[:-1] + h * v[:-1] / 3, q[1:] - h * v[1:] / 3, q[1:]], axis=1)
    )


def certify(
    clearance: Judged, trajectory: JointTrajectory, *, max_depth: int = MAX_DEPTH
) -> Certificate:
    """Prove that every pair stays farther apart than the clearance's tracking error.

    Adaptive bisection on the curve that `trajectory.sample` gives (see `kernels.proof`
    for the bound). Distances are lower bounds by separating planes, so neither an unfinished
    iteration nor an engine's error can pass as proof. A pair exempted by a departure line must
    keep its distance wherever the tip is not proven to lie in the line's tube. A failure names
    the first place found for a pair in an interval: contact, or no proof after `max_depth`
    bisections.

    The clearance of the world is proven in the same pass as far as the motion keeps it:
    `proven_clearance_m` is what no pair undercuts anywhere (departure exemptions applied), about a
    fiftieth of the clearance below the smallest distance where that is nearer. `min_clearance_m`
    is the smallest distance met (capped) at the knots, at three points between neighbouring ones
    and where the bisection looked.
    """
    bezier = bezier_of(trajectory)
    where = np.empty((MAX_FAILURES, 2), dtype=np.int64)
    place = np.empty((MAX_FAILURES, 2))
    samples = sub_points(bezier, 4)
    lowest = float(clearance.phi(samples).min())
    tolerance = LEVEL_TOLERANCE * clearance.world.clearance_m
    wanted = min(clearance.world.clearance_m, lowest - tolerance)
    found, evaluations, met, level = _bisected(
        clearance, bezier, max_depth, where, place, wanted, tolerance
    )
    lowest = min(lowest, met)
    failures = []
    for (interval, pair), (fraction, bound) in zip(where[:found], place[:found]):
        distance = float(bound)
        if bound <= 0.0:
            distance = _depth(clearance, bezier[interval], float(fraction), int(pair))
            lowest = min(lowest, distance)
        failures.append(
            CertificateFailure(
                int(interval), float(fraction), clearance.world.pair_of(pair), distance
            )
        )
    return Certificate(
        not failures,
        tuple(failures),
        lowest,
        evaluations + len(samples),
        None if failures else level,
    )


def prove_path(clearance: Judged, q_rad: Array, *, max_depth: int = 11) -> bool:
    """Whether the piecewise linear path through `q_rad` (K, n) is proven free, as `certify`."""
    t = (np.arange(4) / 3.0)[None, :, None]
    q = np.asarray(q_rad, dtype=float)
    return _proven(clearance, q[:-1, None] + t * (q[1:] - q[:-1])[:, None], max_depth)


def prove_curve(clearance: Judged, trajectory: JointTrajectory, *, max_depth: int = 9) -> bool:
    """Whether the trajectory is proven free, as `certify` and without its report."""
    return _proven(clearance, bezier_of(trajectory), max_depth)


def _proven(clearance: Judged, bezier: Array, max_depth: int) -> bool:
    where, place = np.empty((1, 2), dtype=np.int64), np.empty((1, 2))
    curve = np.ascontiguousarray(bezier)
    return _bisected(clearance, curve, max_depth, where, place, 0.0, 0.0)[0] == 0


def _bisected(
    clearance: Judged,
    bezier: Array,
    max_depth: int,
    where: npt.NDArray[np.int64],
    place: Array,
    wanted_m: float,
    tolerance_m: float,
) -> tuple[int, int, float, float]:
    """`prove` on the curve; as many failures as `where` and `place` have rows."""
    scene, scope = clearance.world.scene, clearance.scope
    tree = bisection_workspace(len(scene.pieces), len(scope.pairs.body), max_depth)
    failures, evaluations, smallest, level = prove(
        scene.view(scope),
        bezier,
        clearance.tracking_error_m,
        tree,
        len(where),
        where,
        place,
        wanted_m,
        tolerance_m,
        LEVEL_DEPTH,
    )
    return int(failures), int(evaluations), float(smallest), float(level)


def sub_points(bezier: Array, parts: int) -> Array:
    """Configurations at λ = 0, 1/parts, … of every interval and at the end, (N parts + 1, n)."""
    s = (np.arange(parts) / parts)[None, :, None]
    b0, b1, b2, b3 = (bezier[:, i, None, :] for i in range(4))
    r = 1.0 - s
    points = r**3 * b0 + 3 * r * r * s * b1 + 3 * r * s * s * b2 + s**3 * b3
    return np.ascontiguousarray(
        np.vstack([points.reshape(-1, bezier.shape[2]), bezier[-1, 3][None]])
    )


def _depth(clearance: Judged, control: Array, fraction: float, pair: int) -> float:
    """Signed distance of one failing piece pair as the world's engine measures it [m]."""
    s, r = fraction, 1.0 - fraction
    weights = np.array([r**3, 3 * r * r * s, 3 * r * s * s, s**3])
    return clearance.world.scene.pair_distance(weights @ control, pair).distance_m
