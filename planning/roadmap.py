"""One collision-free path, by RRTConnect and shortcuts: compiled, or OMPL's.

The only importer of ompl.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from dmoc.arrays import Array
from dmoc.status import Status
from dmoc.trajectory import JointPath
from planning.certificate import prove_path
from planning.edge_clearance import EdgeClearance
from planning.kernels.segment import segment_contact
from planning.scene import Scope
from planning.shortcut import shortcut
from planning.tree_search import shortened, tree_path

if TYPE_CHECKING:
    from planning.world import CollisionWorld

__all__ = ["PathResult", "plan_path"]

ou.setLogLevel(ou.LOG_NONE)

RANGE_M = 0.3

#: Pairs are grown by at least this multiple of the tracking error.
LEAST_GROWTH = 1.2

Planner = Literal["native", "ompl"]

#: Who found a path; `none` where the straight segment is free.
Finder = Literal["ompl", "compiled", "none"]


@dataclass(frozen=True)
class PathResult:
    """A path or the reason why there is none.

    `status` is converged, in_collision (`pair` touches at the end that `note` names) or no_path
    (budget used up: `pair` was in the way most often; also with a limit violated, see `note`).
    `checks` counts segment checks and `iterations` the planner's own; `planner` says who found it.
    """

    status: Status
    path: JointPath | None
    pair: tuple[str, str] | None = None
    note: str = ""
    iterations: int = 0
    checks: int = 0
    planner: Finder = "none"


def plan_path(
    clearance: EdgeClearance | CollisionWorld,
    start_rad: Array,
    goal_rad: Array,
    *,
    seed: int,
    inflation_m: float = 0.02,
    max_iterations: int = 2000,
    attempts: int = 16,
    shortcut_tries: int = 80,
    step_m: float = 0.07,
    planner: Planner = "native",
) -> PathResult:
    """A path from start to goal (n,) on which all bodies stay farther apart than proven.

    The straight segment first; then RRTConnect (Kuffner and LaValle 2000) on bodies grown by
    `inflation_m` (a quarter of it between bodies of the robot itself, whose neighbours are always
    near), then shortcuts. A pair that is nearer than that at an end is grown by 0.8 of its
    distance there, so that narrow ends stay reachable. Every segment of the result is proven free
    (by more than the clearance's tracking error, see `planning.certificate`). After a failed proof
    the next attempt checks twice as finely, after a vain search it grows bodies half as much, down
    to just above the tracking error.
    Stops by iterations: each attempt has `max_iterations` of the planner. `step_m` is how far a
    typical robot point may move between two checked points of the first attempt. Joint
    coordinates are scaled by the joints' mean reach, so that the planner's metric is in metres.
    `planner` is the compiled one, or OMPL's, which also serves worlds of another engine than
    "native".
    """
    edge = clearance if isinstance(clearance, EdgeClearance) else clearance.clearance()
    world = edge.world
    start, goal = (world.scene.rows_of(q)[0].copy() for q in (start_rad, goal_rad))
    robot = world.robot
    for name, q in (("start", start), ("goal", goal)):
        outside = (q < robot.q_lower_rad - 1e-9) | (q > robot.q_upper_rad + 1e-9)
        if np.any(outside):
            joint = int(np.flatnonzero(outside)[0])
            return PathResult(
                Status.NO_PATH, None,
                note=f"{name}: joint {joint + 1} at {q[joint]:.4f} rad is outside "
                f"[{robot.q_lower_rad[joint]:.4f}, {robot.q_upper_rad[joint]:.4f}]",
            )  # fmt: skip
        pair = edge.collide(q, edge.tracking_error_m)
        if pair is not None:
            return PathResult(Status.IN_COLLISION, None, pair, f"{name} in collision")
    growth = _growth(edge, np.stack([start, goal]), inflation_m)
    # The proof refuses what comes nearer than its margin: no use in planning there.
    least = np.minimum(growth, LEAST_GROWTH * edge.tracking_error_m)
    iterations = checks = 0
    blocked = np.zeros(len(growth), dtype=np.int64)
    native = planner == "native" and world.engine == "native"
    search: _Search | _Compiled
    for attempt in range(attempts):
        search = (_Compiled if native else _Search)(edge, edge.scope.grown(growth), step_m)
        found = search.run(start, goal, seed + attempt, max_iterations)
        iterations += search.iterations
        if found is not None:
            short = search.shorten(found, seed + attempt, shortcut_tries)
            checks += search.checks
            for path in (short, found):
                if prove_path(edge, path):
                    return PathResult(
                        Status.CONVERGED, JointPath(path), iterations=iterations, checks=checks,
                        planner=search.name if search.iterations else "none",
                    )  # fmt: skip
            step_m *= 0.5
        else:
            checks += search.checks
            growth = np.maximum(0.5 * growth, least)
            blocked += search.blocked
    note = f"no path within {attempts} attempts of {max_iterations} iterations"
    pair = None
    if blocked.any():
        # By bodies: one that consists of many pieces is in the way with any of them.
        bodies = np.bincount(world.scene.pairs.body, weights=blocked)
        pair = world.pairs[int(bodies.argmax())]
        note += f", most often in the way: {pair[0]} - {pair[1]}"
    return PathResult(Status.NO_PATH, None, pair, note, iterations, checks)


def _growth(edge: EdgeClearance, ends: Array, inflation_m: float) -> Array:
    """By how much every piece pair is grown while planning (M,) [m]."""
    scene = edge.world.scene
    joint = scene.solids.info[edge.scope.pairs.piece, 0]
    growth = np.where(joint.min(axis=1) > 0, 0.25 * inflation_m, inflation_m)
    near = scene.near(ends, inflation_m / 0.8, edge.scope)
    for (_, m), distance in zip(near.which, near.values[:, 0]):
        growth[m] = min(growth[m], max(0.8 * distance, 0.5 * (distance + edge.tracking_error_m)))
    return growth


class _Compiled:
    """One run of the compiled trees; counts what it asks."""

    name: Finder = "compiled"

    def __init__(self, edge: EdgeClearance, scope: Scope, step_m: float) -> None:
        self.scene, self.robot = edge.world.scene, edge.world.robot
        self.scan = self.scene.scan(step_m, 0.0, scope)
        self.iterations = self.checks = 0
        self.blocked = np.zeros(len(scope.pairs.body), dtype=np.int64)

    def run(self, start: Array, goal: Array, seed: int, max_iterations: int) -> Array | None:
        """Knots (K, n), or None."""
        self.checks += 1
        hit = segment_contact(self.scan, start, goal, True)
        if hit < 0:
            return np.stack([start, goal])
        self.blocked[hit] += 1
        found = tree_path(
            self.scan, start, goal, limits=(self.robot.q_lower_rad, self.robot.q_upper_rad),
            scale=self.scene.lever_m, reach_m=RANGE_M, seed=seed, max_iterations=max_iterations,
        )  # fmt: skip
        self.iterations, self.checks = found.iterations, self.checks + found.checks
        self.blocked += found.blocked
        return found.q_rad

    def shorten(self, path: Array, seed: int, tries: int) -> Array:
        """`path` made short."""
        if len(path) == 2:
            return path
        short, checks = shortened(self.scan, path, scale=self.scene.lever_m, tries=tries, seed=seed)
        self.checks += checks
        return short


class _Search:
    """One run of OMPL's RRTConnect; counts what it asks."""

    name: Finder = "ompl"

    def __init__(self, edge: EdgeClearance, scope: Scope, step_m: float) -> None:
        self.edge, self.scene = edge, edge.world.scene
        self.check = self.scene.segment_check(step_m, 0.0, scope)
        self.iterations = self.checks = 0
        self.blocked = np.zeros(len(scope.pairs.body), dtype=np.int64)

    def is_free(self, q0: Array, q1: Array) -> bool:
        """Whether the checked points of a segment are free."""
        self.checks += 1
        hit = self.check(q0, q1)
        if hit >= 0:
            self.blocked[hit] += 1
        return hit < 0

    def shorten(self, path: Array, seed: int, tries: int) -> Array:
        """`path` made short."""
        return shortcut(path, self.is_free, scale=self.scene.lever_m, tries=tries, seed=seed)

    def run(self, start: Array, goal: Array, seed: int, max_iterations: int) -> Array | None:
        """Knots (K, n) of an exact solution, or None."""
        if self.is_free(start, goal):
            return np.stack([start, goal])
        robot, scale = self.edge.world.robot, self.scene.lever_m
        n = robot.num_joints
        space = ob.RealVectorStateSpace(n)
        bounds = ob.RealVectorBounds(n)
        for j in range(n):
            # The ends may lie on a limit: leave room for the rounding of the scaling.
            bounds.setLow(j, float(robot.q_lower_rad[j] * scale[j]) - 1e-9)
            bounds.setHigh(j, float(robot.q_upper_rad[j] * scale[j]) + 1e-9)
        space.setBounds(bounds)
        information = ob.SpaceInformation(space)

        def valid(_: ob.State) -> bool:
            return True  # the ends are known to be free; segments check both of theirs

        q0, q1 = np.empty(n), np.empty(n)

        def motion(first: ob.State, second: ob.State) -> bool:
            q0[:], q1[:] = first[0:n], second[0:n]
            return self.is_free(q0 / scale, q1 / scale)

        def enough() -> bool:
            self.iterations += 1
            return self.iterations > max_iterations

        information.setStateValidityChecker(valid)
        information.setMotionValidator(_Motions(information, motion))
        information.setup()
        # OMPL's generators are global: seeding before each query makes it repeatable.
        ou.RNG.setSeed(seed % (2**31 - 1) + 1)
        problem = ob.ProblemDefinition(information)
        ends = [information.allocState(), information.allocState()]
        for state, q in zip(ends, (start, goal)):
            for j in range(n):
                state[j] = float(q[j] * scale[j])
        problem.setStartAndGoalStates(ends[0], ends[1], 1e-9)
        planner = og.RRTConnect(information)
        planner.setRange(RANGE_M)
        planner.setProblemDefinition(problem)
        planner.setup()
        status = planner.solve(ob.PlannerTerminationCondition(enough))
        # The status is also truthy for an approximate solution.
        if status.getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
            return None
        states = problem.getSolutionPath().getStates()
        path = np.array([state[0:n] for state in states]) / scale
        path[0], path[-1] = start, goal
        return np.clip(path, robot.q_lower_rad, robot.q_upper_rad)


class _Motions(ob.MotionValidator):
    """Segment checks in one compiled call each."""

    def __init__(self, information: ob.SpaceInformation, check: object) -> None:
        super().__init__(information)
        self._check = check

    def checkMotion(self, first: ob.State, second: ob.State, *_: object) -> bool:
        """Whether the segment is free."""
        return self._check(first, second)  # type: ignore[operator]
