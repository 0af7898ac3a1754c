r"""A planar arm of capsules among discs, with exact distances: the smallest station there is.

It implements `motion.clearance.Clearance` in closed form: refinement is drawn in two dimensions,
tested and understood without a collision engine. The arm moves in a vertical plane: joint angles
add up, link i runs along (cos, sin) of their sum, and every link is a capsule of one radius.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dmoc.arrays import Array, readonly
from dmoc.motion.clearance import Certificate, CertificateFailure, Rows
from dmoc.motion.trajectory import JointTrajectory

_FAR_M = 1e9


@dataclass(frozen=True)
class PlanarWorld:
    """`link_lengths_m` (n,), one `link_radius_m`, discs `centres_m` (D, 2) with `radii_m` (D,).

    Distances are capped at `cap_m`. `weight_scale` multiplies the weights w, only to study what a
    wrong weight does. `margin_m` is what the certificate demands between arm and discs, and
    `narrowest` the share of an interval below which it gives up proving.
    """

    link_lengths_m: Array
    centres_m: Array
    radii_m: Array
    link_radius_m: float = 0.05
    cap_m: float = 0.5
    margin_m: float = 1e-3
    weight_scale: float = 1.0
    narrowest: float = field(default=2.0**-12, repr=False)

    def __post_init__(self) -> None:
        for name, ndim in (("link_lengths_m", 1), ("centres_m", 2), ("radii_m", 1)):
            object.__setattr__(self, name, readonly(getattr(self, name), name, ndim))

    def joints_m(self, q: Array) -> Array:
        """Positions of the joints and the tip (K, n+1, 2) for rows of q (K, n)."""
        angle = np.cumsum(np.atleast_2d(q), axis=1)
        step = self.link_lengths_m[None, :, None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
        return np.concatenate([np.zeros_like(step[:, :1]), np.cumsum(step, axis=1)], axis=1)

    def _pairs(self, q: Array) -> tuple[Array, Array, Array]:
        """Distance (K, n, D), nearest point on each link's axis and unit normal (K, n, D, 2)."""
        joints = self.joints_m(q)
        base, along = joints[:, :-1, None], np.diff(joints, axis=1)[:, :, None]
        to_disc = self.centres_m - base
        share = np.sum(to_disc * along, axis=3) / np.sum(along * along, axis=3)
        nearest = base + np.clip(share, 0.0, 1.0)[..., None] * along
        gap = nearest - self.centres_m
        length = np.maximum(np.linalg.norm(gap, axis=3), 1e-12)
        distance = length - self.radii_m - self.link_radius_m
        return distance, nearest, gap / length[..., None]

    def phi(self, q: Array) -> Array:
        """Smallest distance (K,), capped."""
        return np.minimum(self._pairs(q)[0].min(axis=(1, 2)), self.cap_m)

    def weights(self, q: Array) -> Array:
        """w_i = max_p ‖∂p/∂q_i‖₁ (K, n), exact for capsules, times `weight_scale`."""
        joints = self.joints_m(q)
        out = np.zeros((len(joints), joints.shape[1] - 1))
        for i in range(out.shape[1]):
            arms = np.abs(joints[:, i:] - joints[:, i : i + 1]).sum(axis=2)
            out[:, i] = arms.max(axis=1) + np.sqrt(2.0) * self.link_radius_m
        return self.weight_scale * out

    def reach(self, q: Array) -> Array:
        """R_j (K, n): largest distance of a moved point to joint j."""
        joints = self.joints_m(q)
        out = np.zeros((len(joints), joints.shape[1] - 1))
        for i in range(out.shape[1]):
            arms = np.linalg.norm(joints[:, i:] - joints[:, i : i + 1], axis=2)
            out[:, i] = arms.max(axis=1) + self.link_radius_m
        return out

    def rows(self, q: Array, cap_m: float) -> Rows:
        """All link–disc pairs nearer than `cap_m`, linearised."""
        q = np.atleast_2d(q)
        distance, nearest, normal = self._pairs(q)
        knot, link, disc = np.nonzero(distance < cap_m)
        joints = self.joints_m(q)
        gradient = np.zeros((len(knot), q.shape[1]))
        for j in range(q.shape[1]):
            arm = nearest[knot, link, disc] - joints[knot, j]
            turned = np.column_stack([-arm[:, 1], arm[:, 0]])
            slope = np.sum(turned * normal[knot, link, disc], axis=1)
            gradient[:, j] = np.where(link >= j, slope, 0.0)
        pair = tuple((f"link_{a + 1}", f"disc_{b + 1}") for a, b in zip(link, disc))
        return Rows(knot.astype(np.int64), distance[knot, link, disc], gradient, pair)

    def certify(self, trajectory: JointTrajectory) -> Certificate:
        """Bisect every interval until φ at a point exceeds how far the arm strays from it.

        A cubic lies in the hull of its Bézier points, so on a piece no arm point moves further
        from its place at q_m than Σ_j R_j max|b_j − q_m,j|, with R_j the stretched arm's reach.
        """
        reach = np.cumsum(self.link_lengths_m[::-1])[::-1] + self.link_radius_m
        failures, least, count = [], _FAR_M, 0
        for k in range(trajectory.num_intervals):
            h = trajectory.t_s[k + 1] - trajectory.t_s[k]
            q0, q1 = trajectory.q_rad[k], trajectory.q_rad[k + 1]
            third0 = q0 + h / 3 * trajectory.velocity_rad_s[k]
            third1 = q1 - h / 3 * trajectory.velocity_rad_s[k + 1]
            stack = [(0.0, 1.0, np.array([q0, third0, third1, q1]))]
            while stack:
                low, high, bezier = stack.pop()
                left, right = _split(bezier)
                distance = self._pairs(left[-1:])[0][0]
                phi, count = float(distance.min()), count + 1
                least = min(least, phi)
                stray = float(reach @ np.abs(bezier - left[-1]).max(axis=0))
                if phi - stray > self.margin_m:
                    continue
                middle = 0.5 * (low + high)
                if phi <= self.margin_m or high - low < self.narrowest:
                    link, disc = np.unravel_index(int(distance.argmin()), distance.shape)
                    pair = (f"link_{link + 1}", f"disc_{disc + 1}")
                    failures.append(CertificateFailure(k, middle, pair, phi))
                    break
                stack += [(middle, high, right), (low, middle, left)]
        return Certificate(not failures, tuple(failures), min(least, self.cap_m), count)


def _split(bezier: Array) -> tuple[Array, Array]:
    """The two halves of a cubic's Bézier points (4, n), by de Casteljau."""
    a = 0.5 * (bezier[:-1] + bezier[1:])
    b = 0.5 * (a[:-1] + a[1:])
    c = 0.5 * (b[0] + b[1])
    return np.array([bezier[0], a[0], b[0], c]), np.array([c, b[1], a[2], bezier[3]])
