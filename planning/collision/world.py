"""The collision world of a station: what touches, and how far apart things are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.motion.clearance import Certificate, Rows
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot
from planning.collision.certificate import certify
from planning.collision.departure_line import DepartureLine
from planning.collision.kernels.queries import reach_batch
from planning.collision.robot_bodies import link_bodies
from planning.collision.scene import Scene, Scope
from planning.geometry.shapes import Body
from planning.station.srdf import read_srdf

if TYPE_CHECKING:
    from planning.station.station import Station


class EdgeClearance:
    """Implements `dmoc.motion.clearance.Clearance` for one motion in one world.

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
            knot=near.which[:, 0].copy(),
            distance_m=near.values[:, 0].copy(),
            gradient=near.values[:, 10:].copy(),
            pair=tuple(self.world.pair_of(m) for m in near.which[:, 1]),
        )

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
        reach_batch(scene.view(scene.everything), q, reach, weight)
        return reach, weight


DEFAULT_CAP_M = 0.3


class Standing(NamedTuple):
    """What a world takes of a station, where there is no station."""

    robot: Robot
    tool_bodies: tuple[Body, ...]
    obstacles: tuple[Body, ...]
    allowed_collisions: Sequence[tuple[str, str]]
    clearance_m: float
    engine: str


class CollisionWorld:
    """Robot links, tool and obstacles of a station, and the pairs that are checked.

    Bodies are convex pieces that cover the real surface, so a body inside another one overlaps
    it. `engine` is "native" (compiled GJK whose distances carry a separating plane as proof; coal
    measures the depth of overlaps), "coal" or "fcl" (every near pair by that engine: the second
    opinions); None takes the station's. `pair_clearance_m` is subtracted from the distances of the
    named body pairs: what is nearer counts as touching. Holds workspace: use one world per thread
    or process.

    `q_rad` is (n,) for one configuration and (K, n) for many; angles in rad, distances in m.
    """

    def __init__(
        self,
        station: Station | Standing,
        engine: str | None = None,
        *,
        pair_clearance_m: Mapping[tuple[str, str], float] = MappingProxyType({}),
    ) -> None:
        self.robot = station.robot
        self.clearance_m = float(station.clearance_m)
        self.scene = Scene(
            station.robot,
            station.tool_bodies,
            station.obstacles,
            station.allowed_collisions,
            pair_clearance_m,
            station.engine if engine is None else engine,
        )

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self.scene.engine_name

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the body pairs that are checked."""
        return self.scene.body_pairs

    @property
    def never_touching(self) -> tuple[tuple[str, str], ...]:
        """Pairs of the robot's own bodies that are proven apart in every configuration within the
        joint limits, and therefore not checked.
        """
        return self.scene.never

    def pair_of(self, piece_pair: int) -> tuple[str, str]:
        """Body names of a piece pair."""
        return self.scene.body_pairs[int(self.scene.pairs.body[piece_pair])]

    def collide(
        self, q_rad: Array, inflation_m: float = 0.0, lines: Sequence[DepartureLine] = ()
    ) -> tuple[str, str] | None:
        """A pair of bodies nearer than `inflation_m` (touching counts), or None."""
        q = self.scene.rows_of(q_rad)
        hit = self.scene.first_contacts(q[:1], inflation_m, self._scope(lines))[0]
        return None if hit < 0 else self.pair_of(hit)

    def collide_batch(
        self, q_rad: Array, inflation_m: float = 0.0, lines: Sequence[DepartureLine] = ()
    ) -> npt.NDArray[np.bool_]:
        """Whether each of K configurations collides (K,)."""
        q = self.scene.rows_of(q_rad)
        return self.scene.first_contacts(q, inflation_m, self._scope(lines)) >= 0

    def collisions(self, q_rad: Array, inflation_m: float = 0.0) -> list[tuple[str, str]]:
        """All body pairs nearer than `inflation_m` at one configuration."""
        return [pair for pair, _ in self.distances(q_rad, inflation_m)]

    def distances(
        self, q_rad: Array, cap_m: float = DEFAULT_CAP_M, lines: Sequence[DepartureLine] = ()
    ) -> list[tuple[tuple[str, str], float]]:
        """Body pairs not farther than `cap_m` at one q with their distances, nearest first."""
        q = self.scene.rows_of(q_rad)[:1]
        near = self.scene.near(q, np.nextafter(cap_m, np.inf), self._scope(lines))
        best: dict[tuple[str, str], float] = {}
        for (_, m), value in zip(near.which, near.values[:, 0]):
            pair = self.pair_of(m)
            best[pair] = min(best.get(pair, np.inf), float(value))
        return sorted(best.items(), key=lambda item: item[1])

    def distance(
        self, q_rad: Array, cap_m: float = DEFAULT_CAP_M, lines: Sequence[DepartureLine] = ()
    ) -> tuple[float, tuple[str, str] | None]:
        """Smallest signed distance at one q, at most `cap_m`, and its pair (None at the cap)."""
        q = self.scene.rows_of(q_rad)[:1]
        phi, pair = self.scene.smallest(q, cap_m, self._scope(lines))
        return float(phi[0]), None if pair[0] < 0 else self.pair_of(pair[0])

    def tip_positions(self, q_rad: Array) -> Array:
        """Tool tip (K, 3) [m] in the world."""
        return self.scene.tips(self.scene.rows_of(q_rad))

    def clearance(
        self,
        start_line: DepartureLine | None = None,
        goal_line: DepartureLine | None = None,
        tracking_error_m: float = 0.002,
        cap_m: float = DEFAULT_CAP_M,
    ) -> EdgeClearance:
        """The `dmoc.motion.clearance.Clearance` of a motion with these departure lines."""
        lines = tuple(line for line in (start_line, goal_line) if line is not None)
        return EdgeClearance(self, lines, tracking_error_m, cap_m)

    def _scope(self, lines: Sequence[DepartureLine]) -> Scope:
        return self.scene.scope(lines) if lines else self.scene.everything


def world_for(
    robot: Robot,
    tool_bodies: tuple[Body, ...] = (),
    obstacles: tuple[Body, ...] = (),
    allowed_collisions: Sequence[tuple[str, str]] = (),
    clearance_m: float = 0.02,
    *,
    srdf: str | Path | None = None,
    pair_clearance_m: Mapping[tuple[str, str], float] = MappingProxyType({}),
    engine: str = "native",
) -> CollisionWorld:
    """A collision world without a station file.

    `srdf` is a file whose `disable_collisions` add to `allowed_collisions` (`station.srdf`).
    `pair_clearance_m` is as of `CollisionWorld`.
    """
    allowed = [*allowed_collisions]
    if srdf is not None:
        own = {f.name for f in robot.model.frames if f.type == pin.FrameType.BODY}
        own.update(body.name for body in tool_bodies)
        named = read_srdf(srdf, own.union(body.name for body in obstacles), own)
        shaped = {body.name for body in (*tool_bodies, *obstacles)}
        shaped.update(mounted.body.name for mounted in link_bodies(robot))
        allowed += [pair for pair in named if shaped.issuperset(pair)]
    parts = Standing(robot, tool_bodies, obstacles, allowed, clearance_m, engine)
    return CollisionWorld(parts, pair_clearance_m=pair_clearance_m)
