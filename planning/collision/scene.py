"""The packed scene: bodies, pieces, pairs and workspace, and the raw queries on them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from dmoc.arrays import Array
from dmoc.errors import InputError, ProblemError
from dmoc.robot.robot import Robot
from planning.collision.coal_engine import CoalEngine, Engine, PairDistance
from planning.collision.departure_line import DepartureLine
from planning.collision.fcl_engine import FclEngine
from planning.collision.kernels import queries as kernels
from planning.collision.kernels.contact import first_contacts
from planning.collision.kernels.depth import grown_workspace
from planning.collision.kernels.layout import Pairs, Query
from planning.collision.kernels.segment import Scan, known_workspace, segment_contact
from planning.collision.packed import pack_chain, pack_pairs, pack_solids, workspace
from planning.collision.pairs import checked_pairs, pairs_that_never_touch
from planning.collision.pieces import Mounted, pieces_of
from planning.collision.robot_bodies import link_bodies, tool_mounts
from planning.geometry.shapes import Body

ENGINES = ("native", "coal", "fcl")
#: A cap that no distance in a station reaches [m].
FARTHEST_M = 1e6


class Scope(NamedTuple):
    """What a query looks at: piece pairs with the clearance that is subtracted from their
    distance, departure lines (L, 8), the piece pairs (L, M) that each line exempts, and workspace
    (L,) for whether the tip is in the tube of each.
    """

    pairs: Pairs
    lines: Array
    exempt: npt.NDArray[np.bool_]
    inside: npt.NDArray[np.bool_]

    def grown(self, extra_m: Array) -> Scope:
        """The same with `extra_m` (M,) more clearance on every pair."""
        return self._replace(pairs=self.pairs._replace(extra=self.pairs.extra + extra_m))


class NearRows(NamedTuple):
    """Pairs nearer than a cap: `which` (R, 2) configuration, pair; `values` (R, 10 + n)
    distance, nearest points (3 + 3), normal (3), gradient (n).
    """

    which: npt.NDArray[np.int64]
    values: Array


class Scene:
    """Robot, tool and obstacles packed for the kernels. Holds workspace: one scene per thread."""

    def __init__(
        self,
        robot: Robot,
        tool_bodies: tuple[Body, ...],
        obstacles: tuple[Body, ...],
        allowed_collisions: Sequence[tuple[str, str]],
        pair_clearance_m: Mapping[tuple[str, str], float],
        engine: str,
    ) -> None:
        if engine not in ENGINES:
            raise InputError.of(
                "engine",
                field="engine",
                value=engine,
                legal=", ".join(ENGINES),
                fix="choose one of them",
            )
        links, tools = link_bodies(robot), tool_mounts(robot, tool_bodies)
        standing = tuple(Mounted(body, 0, np.array(body.pose)) for body in obstacles)
        allowed = [*robot.allowed_collisions, *allowed_collisions]
        body_pairs = checked_pairs(robot.model, links, tools, standing, allowed)
        mounts = [*links, *tools, *standing]
        self.bodies = {m.body.name: m for m in mounts}
        pieces = [piece for m in mounts for piece in pieces_of(m)]
        pieces.sort(key=lambda piece: piece.joint == 0)  # stable: moving ones first
        self.pieces = tuple(pieces)
        self.moving = sum(piece.joint > 0 for piece in pieces)
        self.chain, self.solids = pack_chain(robot.model), pack_solids(pieces)
        own = {m.body.name for m in (*links, *tools)}
        self.never = pairs_that_never_touch(
            pieces,
            [p for p in body_pairs if own.issuperset(p)],
            self.chain,
            self.solids,
            (np.array(robot.q_lower_rad), np.array(robot.q_upper_rad)),
            pair_clearance_m,
        )
        self.body_pairs = tuple(pair for pair in body_pairs if pair not in self.never)
        self.pairs = pack_pairs(pieces, self.body_pairs, pair_clearance_m)
        self.work = workspace(len(self.chain.info), len(pieces), len(self.pairs.body))
        self.grown = grown_workspace()
        self.known = known_workspace(len(self.pairs.body))
        self.engine_name = engine
        self.engine: Engine = FclEngine(pieces) if engine == "fcl" else CoalEngine(pieces)
        self.touching = tuple(m.body.name for m in tools if m.body.touches)
        frame = robot.model.frames[robot.flange_id]
        tip = (frame.placement * robot.tool.tip).translation
        self.tip = np.array([float(frame.parentJoint), *tip])
        self.num_joints = robot.num_joints
        self.pose = np.zeros((len(pieces), 15))
        self.pose[:, :12] = self.solids.frame
        centres = np.einsum(
            "pij,pj->pi", self.solids.frame[:, :9].reshape(-1, 3, 3), self.solids.size[:, 6:9]
        )
        self.pose[:, 12:] = self.solids.frame[:, 9:12] + centres
        self.thread = threading.get_ident()
        self.everything = self.scope(())
        self.lever_m = self._levers(robot)

    def _levers(self, robot: Robot) -> Array:
        """Mean reach of every joint [m]: how far a turn of it moves the arm, for step sizes."""
        rng = np.random.default_rng(0)
        q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (64, robot.num_joints))
        reach, weight = np.empty(q.shape), np.empty(q.shape)
        kernels.reach_batch(self.view(self.everything), q, reach, weight)
        return np.maximum(reach.mean(axis=0), 1e-3)

    def scope(self, lines: Sequence[DepartureLine]) -> Scope:
        """What the given departure lines exempt. Errors: `InputError` for an unknown part."""
        exempt = np.zeros((len(lines), len(self.pairs.body)), dtype=bool)
        rows = np.zeros((len(lines), 8))
        for k, line in enumerate(lines):
            if line.part not in self.bodies:
                raise InputError.of(
                    "departure-part",
                    field="part",
                    value=line.part,
                    legal=", ".join(self.bodies),
                    fix="name the body that carries the stud",
                )
            rows[k] = line.row
            wanted = [
                i
                for i, pair in enumerate(self.body_pairs)
                if line.part in pair and any(name in pair for name in self.touching)
            ]
            exempt[k] = np.isin(self.pairs.body, wanted)
        return Scope(self.pairs, rows, exempt, np.zeros(len(lines), dtype=bool))

    def view(self, scope: Scope) -> Query:
        """What the kernels are handed for a question of that scope."""
        return Query(self.chain, self.solids, self.pose, self.moving, self.tip, self.work, *scope)

    def rows_of(self, q_rad: Array) -> Array:
        """q as finite (K, n). Errors: `ProblemError`, also in a thread that did not make this."""
        if threading.get_ident() != self.thread:
            raise ProblemError.of(
                "world-thread",
                field="world",
                value="asked by another thread than made it",
                legal="one world a thread: it holds workspace",
                fix="make a CollisionWorld in each thread, or use processes",
            )
        # A copy: a read-only array would be another type to the compiler.
        q = np.array(np.atleast_2d(q_rad), dtype=float, order="C")
        if q.ndim != 2 or q.shape[1] != self.num_joints or not np.isfinite(q).all():
            raise ProblemError.of(
                "configuration",
                field="q_rad",
                value=f"shape {q.shape}, or not finite",
                legal=f"(K, {self.num_joints}) finite angles",
                fix="check the caller",
            )
        return q

    def first_contacts(self, q: Array, inflation_m: float, scope: Scope) -> npt.NDArray[np.int64]:
        """Index of a piece pair that touches at each row of q (K, n), or −1."""
        if self.engine_name != "native":
            return self._engine_contacts(q, inflation_m, scope)
        first = np.empty(len(q), dtype=np.int64)
        first_contacts(self.view(scope), q, inflation_m, first)
        return first

    def segment_contact(
        self, q0: Array, q1: Array, step_m: float, inflation_m: float, scope: Scope
    ) -> int:
        """Index of a piece pair that touches on the segment q0 → q1, or −1.

        The points are so close that a typical robot point moves `step_m` between two of them:
        a planner's check, not a proof.
        """
        if self.engine_name == "native":
            return int(self.segment_check(step_m, inflation_m, scope)(q0, q1))
        parts = max(1, int(np.ceil(float(np.abs(q1 - q0) @ self.lever_m) / step_m)))
        t = np.linspace(0.0, 1.0, parts + 1)[1:, None]
        for q in q0 + t * (q1 - q0):
            hit = int(self.first_contacts(q[None], inflation_m, scope)[0])
            if hit >= 0:
                return hit
        return -1

    def segment_check(
        self, step_m: float, inflation_m: float, scope: Scope
    ) -> Callable[[ArrayLike, ArrayLike], int]:
        """`segment_contact` of two configurations, made ready for many calls."""
        if self.engine_name != "native":
            return lambda q0, q1: self.segment_contact(
                np.asarray(q0, dtype=float), np.asarray(q1, dtype=float), step_m, inflation_m, scope
            )
        scan = self.scan(step_m, inflation_m, scope)
        first, last = np.empty(self.num_joints), np.empty(self.num_joints)

        def check(q0: ArrayLike, q1: ArrayLike) -> int:
            first[:], last[:] = q0, q1
            hit: int = segment_contact(scan, first, last, False)
            return hit

        return check

    def scan(self, step_m: float, inflation_m: float, scope: Scope) -> Scan:
        """What the kernels ask of a segment; forgets which pairs touched lately."""
        self.known.recent[:] = -1
        return Scan(self.view(scope), float(inflation_m), self.lever_m / step_m, self.known)

    def smallest(self, q: Array, cap_m: float, scope: Scope) -> tuple[Array, npt.NDArray[np.int64]]:
        """Smallest distance (K,) capped at `cap_m` and its piece pair (K,), −1 for none."""
        phi, pair = np.full(len(q), cap_m), np.full(len(q), -1)
        deep = np.ones(len(q), dtype=bool)
        if self.engine_name == "native":
            kernels.smallest_distances(self.view(scope), q, cap_m, phi, pair, deep)
        if np.any(deep):
            where = np.flatnonzero(deep)
            near = self.near(q[where], cap_m, scope)
            for (k, m), value in zip(near.which, near.values[:, 0]):
                if pair[where[k]] < 0 or value < phi[where[k]]:
                    phi[where[k]], pair[where[k]] = value, m
        return phi, pair

    def near(self, q: Array, cap_m: float, scope: Scope) -> NearRows:
        """All piece pairs nearer than `cap_m`, with points, normals and gradients."""
        if self.engine_name != "native":
            return self._engine_near(q, cap_m, scope)
        room = 64 * len(q) + 256
        while True:
            index = np.empty((room, 2), dtype=np.int64)
            values = np.empty((room, 10 + self.num_joints))
            count = kernels.near_pairs(self.view(scope), q, cap_m, self.grown, index, values)
            if count <= room:
                break
            room = count
        return NearRows(index[:count], values[:count])

    def place(self, q: Array) -> None:
        """Poses of all pieces at one q (n,) into `pose`."""
        kernels.place(self.view(self.everything), np.array(q, dtype=float))

    def _measure(self, q: Array, index: npt.NDArray[np.int64], values: Array, scope: Scope) -> None:
        """Fill rows by the engine; rows of one configuration stand together."""
        at = -1
        for r, (k, m) in enumerate(index):
            if k != at:
                self.place(q[k])
                at = k
            a, b = self.pairs.piece[m]
            found = self.engine.distance(int(a), int(b), self.pose[a], self.pose[b])
            values[r, 0] = found.distance_m - scope.pairs.extra[m]
            values[r, 1:4], values[r, 4:7], values[r, 7:10] = found[1:]
        kernels.engine_rows(self.view(scope), q, index, values)

    def pair_distance(self, q: Array, piece_pair: int) -> PairDistance:
        """One piece pair at one q (n,), measured by the engine that the scene was built with."""
        if self.engine_name == "native":
            return self._native_distance(q, piece_pair)
        self.place(q)
        a, b = self.pairs.piece[piece_pair]
        return self.engine.distance(int(a), int(b), self.pose[a], self.pose[b])

    def _native_distance(self, q: Array, piece_pair: int) -> PairDistance:
        """A scope that looks at nothing but the pair, without surplus and departure lines."""
        one = slice(piece_pair, piece_pair + 1)
        pairs = Pairs(self.pairs.piece[one], self.pairs.body[one], np.zeros(1))
        scope = self.everything._replace(pairs=pairs, exempt=np.zeros((0, 1), dtype=bool))
        (row,) = self.near(self.rows_of(q), FARTHEST_M, scope).values
        return PairDistance(float(row[0]), row[1:4].copy(), row[4:7].copy(), row[7:10].copy())

    def _candidates(self, q: Array, cap_m: float, scope: Scope) -> npt.NDArray[np.int64]:
        chosen = np.empty(len(self.pairs.body), dtype=np.int64)
        count = kernels.candidate_pairs(self.view(scope), q, cap_m, chosen)
        return chosen[:count]

    def _engine_near(self, q: Array, cap_m: float, scope: Scope) -> NearRows:
        found = [(k, m) for k in range(len(q)) for m in self._candidates(q[k], cap_m, scope)]
        index = np.array(found, dtype=np.int64).reshape(-1, 2)
        values = np.empty((len(index), 10 + self.num_joints))
        self._measure(q, index, values, scope)
        keep = values[:, 0] < cap_m
        return NearRows(index[keep], values[keep])

    def _engine_contacts(self, q: Array, inflation_m: float, scope: Scope) -> npt.NDArray[np.int64]:
        first = np.full(len(q), -1)
        for k in range(len(q)):
            for m in self._candidates(q[k], max(inflation_m, 0.0) + 1e-9, scope):
                a, b = self.pairs.piece[m]
                limit = inflation_m + scope.pairs.extra[m]
                if limit == 0.0:
                    touches = self.engine.touches(int(a), int(b), self.pose[a], self.pose[b])
                else:
                    found = self.engine.distance(int(a), int(b), self.pose[a], self.pose[b])
                    touches = found.distance_m <= limit
                if touches:
                    first[k] = m
                    break
        return first

    def tips(self, q: Array) -> Array:
        """Tool tip (K, 3) in the world."""
        out = np.empty((len(q), 3))
        kernels.tips_at(self.view(self.everything), q, out)
        return out
