"""The clearance of one motion: a world, its departure lines and a tracking error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.clearance import Certificate, Rows
from dmoc.trajectory import JointTrajectory
from planning.certificate import certify
from planning.departure_line import DepartureLine
from planning.kernels.scene import reach_batch

if TYPE_CHECKING:
    from planning.world import CollisionWorld

__all__ = ["DepartureLine", "EdgeClearance"]


class EdgeClearance:
    """Implements `dmoc.clearance.Clearance` for one motion in one world.

    Contact of the tool's touching body with a line's part is left out at configurations whose tip
    lies in the line's tube. `tracking_error_m` is what the certificate adds for the controller;
    `cap_m` caps `phi`.
    """

    def __init__(
        self,
        world: CollisionWorld,
        lines: tuple[DepartureLine, ...],
        tracking_error_m: float,
        cap_m: float,
    ) -> None:
        self.world, self.lines = world, lines
        self.tracking_error_m, self.cap_m = float(tracking_error_m), float(cap_m)
        self.scope = world.scene.scope(lines)

    def phi(self, q_rad: Array) -> Array:
        """Smallest signed distance (K,) [m], at most the cap."""
        scene = self.world.scene
        return scene.smallest(scene.rows_of(q_rad), self.cap_m, self.scope)[0]

    def weights(self, q_rad: Array) -> Array:
        """w_j(q) = max_p ‖∂p/∂q_j‖₁ (K, n) over boxes around the pieces: never too small."""
        return self._motion_bounds(q_rad)[1]

    def reach(self, q_rad: Array) -> Array:
        """R_j(q) (K, n) [m]: no robot point is farther from the axis of joint j."""
        return self._motion_bounds(q_rad)[0]

    def rows(self, q_rad: Array, cap_m: float) -> Rows:
        """All piece pairs nearer than `cap_m`, linearised: gradient n·(∂p_b/∂q − ∂p_a/∂q)."""
        scene = self.world.scene
        near = scene.near(scene.rows_of(q_rad), cap_m, self.scope)
        return Rows(
            knot=near.which[:, 0].copy(), distance_m=near.values[:, 0].copy(),
            gradient=near.values[:, 10:].copy(),
            pair=tuple(self.world.pair_of(m) for m in near.which[:, 1]),
        )  # fmt: skip

    def certify(self, trajectory: JointTrajectory) -> Certificate:
        """Proof that nothing touches between the knots, or where there is none."""
        return certify(self, trajectory)

    def collide(self, q_rad: Array, inflation_m: float = 0.0) -> tuple[str, str] | None:
        """A pair nearer than `inflation_m` at one q, or None."""
        scene = self.world.scene
        hit = scene.first_contacts(scene.rows_of(q_rad)[:1], inflation_m, self.scope)[0]
        return None if hit < 0 else self.world.pair_of(hit)

    def collide_batch(self, q_rad: Array, inflation_m: float = 0.0) -> npt.NDArray[np.bool_]:
        """Whether each of K configurations collides."""
        scene = self.world.scene
        return scene.first_contacts(scene.rows_of(q_rad), inflation_m, self.scope) >= 0

    def _motion_bounds(self, q_rad: Array) -> tuple[Array, Array]:
        scene = self.world.scene
        q = scene.rows_of(q_rad)
        reach, weight = np.empty(q.shape), np.empty(q.shape)
        reach_batch(
            scene.chain, scene.solids, scene.pose, scene.moving, q, scene.work, reach, weight
        )
        return reach, weight
