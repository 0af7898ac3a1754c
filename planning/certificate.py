"""Certificate: a proof that a trajectory is free of contact between its knots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dmoc.arrays import Array
from dmoc.clearance import Certificate, CertificateFailure
from dmoc.trajectory import JointTrajectory
from planning.kernels.proof import prove

if TYPE_CHECKING:
    from planning.edge_clearance import EdgeClearance

__all__ = ["bezier_of", "certify", "prove_path"]

MAX_DEPTH = 14
MAX_FAILURES = 64


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
    clearance: EdgeClearance,
    trajectory: JointTrajectory,
    *,
    max_depth: int = MAX_DEPTH,
    max_failures: int = MAX_FAILURES,
) -> Certificate:
    """Prove that every pair stays farther apart than the clearance's tracking error.

    Adaptive bisection on the curve that `trajectory.sample` gives (see `planning.kernels.proof`
    for the bound). Distances are lower bounds by separating planes, so neither an unfinished
    iteration nor an engine's error can pass as proof. A pair exempted by a departure line must
    keep its distance wherever the tip is not proven to lie in the line's tube. A failure names
    the first place found for a pair in an interval: contact, or no proof after `max_depth`
    bisections. `min_clearance_m` is the smallest distance (capped) at the knots and three points
    between neighbouring ones, departure exemptions applied.
    """
    scene = clearance.world.scene
    bezier = bezier_of(trajectory)
    where = np.empty((max_failures, 2), dtype=np.int64)
    place = np.empty((max_failures, 2))
    found, evaluations, _ = prove(
        scene.chain, scene.solids, clearance.scope.pairs, scene.pose, scene.moving, bezier,
        clearance.tracking_error_m, scene.tip, clearance.scope.lines, clearance.scope.exempt,
        max_depth, max_failures, where, place,
    )  # fmt: skip
    samples = sub_points(bezier, 4)
    lowest = float(clearance.phi(samples).min())
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
    return Certificate(not failures, tuple(failures), lowest, int(evaluations) + len(samples))


def prove_path(clearance: EdgeClearance, q_rad: Array, *, max_depth: int = 11) -> bool:
    """Whether the piecewise linear path through `q_rad` (K, n) is proven free, as `certify`."""
    t = (np.arange(4) / 3.0)[None, :, None]
    q = np.asarray(q_rad, dtype=float)
    bezier = np.ascontiguousarray(q[:-1, None] + t * (q[1:] - q[:-1])[:, None])
    where, place = np.empty((1, 2), dtype=np.int64), np.empty((1, 2))
    scene = clearance.world.scene
    failures, _, _ = prove(
        scene.chain, scene.solids, clearance.scope.pairs, scene.pose, scene.moving, bezier,
        clearance.tracking_error_m, scene.tip, clearance.scope.lines, clearance.scope.exempt,
        max_depth, 1, where, place,
    )  # fmt: skip
    return failures == 0


def sub_points(bezier: Array, parts: int) -> Array:
    """Configurations at λ = 0, 1/parts, … of every interval and at the end, (N parts + 1, n)."""
    s = (np.arange(parts) / parts)[None, :, None]
    b0, b1, b2, b3 = (bezier[:, i, None, :] for i in range(4))
    r = 1.0 - s
    points = r**3 * b0 + 3 * r * r * s * b1 + 3 * r * s * s * b2 + s**3 * b3
    return np.ascontiguousarray(
        np.vstack([points.reshape(-1, bezier.shape[2]), bezier[-1, 3][None]])
    )


def _depth(clearance: EdgeClearance, control: Array, fraction: float, pair: int) -> float:
    """Signed distance of one failing piece pair as the world's engine measures it [m]."""
    s, r = fraction, 1.0 - fraction
    weights = np.array([r**3, 3 * r * r * s, 3 * r * s * s, s**3])
    return clearance.world.scene.pair_distance(weights @ control, pair).distance_m
