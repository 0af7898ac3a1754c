"""One collision-free path: trees of one of two planners, shortcuts, and the proof of the result.

The only importer of ompl, which has no wheel for some versions of Python; there the compiled trees
take its place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointPath
from planning.collision.certificate import prove_path
from planning.collision.scene import Scope
from planning.collision.world import EdgeClearance
from planning.path.tree_search import tree_path

if TYPE_CHECKING:
    from planning.collision.world import CollisionWorld

#: Draws in a row without gain after which a path counts as short.
PATIENCE = 25


def shortcut(
    q_rad: Array,
    is_free: Callable[[Array, Array], bool],
    *,
    scale: Array,
    tries: int,
    seed: int,
) -> Array:
    """A path (K', n) from the first to the last row of `q_rad` (K, n), not longer than it.

    Each try draws two points on the path, uniformly by length in the metric Σ (scale_j Δq_j)²,
    and replaces what lies between them by a straight segment if `is_free(q0, q1)`. The straight
    line from end to end is tried first, then the removal of single knots. Stops after `tries`
    draws or `PATIENCE` draws without gain. Same seed, same path.
    """
    path = np.array(q_rad, dtype=float)
    if len(path) <= 2 or is_free(path[0], path[-1]):
        return path[[0, -1]]
    rng = np.random.default_rng(seed)
    path = _drop_knots(path, is_free)
    since = 0
    for _ in range(tries):
        if len(path) <= 2 or since >= PATIENCE:
            break
        since += 1
        steps = np.linalg.norm(np.diff(path, axis=0) * scale, axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        lo, hi = np.sort(rng.uniform(0.0, along[-1], 2))
        i = int(np.clip(np.searchsorted(along, lo, side="right") - 1, 0, len(steps) - 1))
        k = int(np.clip(np.searchsorted(along, hi, side="right") - 1, 0, len(steps) - 1))
        if i == k:
            continue
        first = path[i] + (lo - along[i]) / max(steps[i], 1e-12) * (path[i + 1] - path[i])
        last = path[k] + (hi - along[k]) / max(steps[k], 1e-12) * (path[k + 1] - path[k])
        gain = (hi - lo) - float(np.linalg.norm((last - first) * scale))
        if gain <= 1e-3 * along[-1] or not is_free(first, last):
            continue
        path = np.vstack([path[: i + 1], first, last, path[k + 1 :]])
        since = 0
    return _drop_knots(path, is_free)


def _drop_knots(path: Array, is_free: Callable[[Array, Array], bool]) -> Array:
    """Remove interior knots whose neighbours see each other, from the start on."""
    kept = [path[0]]
    for here, after in pairwise(path[1:]):
        if not is_free(kept[-1], after):
            kept.append(here)
    return np.vstack([*kept, path[-1]])


try:
    from ompl import base as ob
    from ompl import geometric as og
    from ompl import util as ou
except ImportError:
    ob = None
else:
    ou.setLogLevel(ou.LOG_NONE)


RANGE_M = 0.3

#: Pairs are grown by at least this multiple of the tracking error.
LEAST_GROWTH = 1.2


@dataclass(frozen=True)
class PathResult:
    """A path or the reason why there is none.

    `status` is converged, in_collision (`pair` touches at the end that `note` names) or no_path
    (budget used up: `pair` was in the way most often; also with a limit violated, see `note`).
    `checks` counts segment checks and `iterations` the planner's own. `planner` is the one that
    found it (`none` where the straight segment is free); `note` says so where another one had been
    asked for.
    """

    status: Status
    path: JointPath | None
    pair: tuple[str, str] | None = None
    note: str = ""
    iterations: int = 0
    checks: int = 0
    planner: str = "none"


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
    planner: str = "ompl",
) -> PathResult:
    """A path from start to goal (n,) on which all bodies stay farther apart than proven.

    The straight segment first; then RRTConnect (Kuffner and LaValle 2000) on bodies grown by
    `inflation_m` (a quarter of it between bodies of the robot itself, whose neighbours are always
    near), then shortcuts. A pair that is nearer than that at an end is grown by 0.8 of its
    distance there, so that narrow ends stay reachable. Every segment of the result is proven free
    (by more than the clearance's tracking error, see `collision.certificate`). After a failed proof
    the next attempt checks twice as finely, after a vain search it grows bodies half as much, down
    to just above the tracking error.
    Stops by iterations: each attempt has `max_iterations` of the planner. `step_m` is how far a
    typical robot point may move between two checked points of the first attempt. Joint
    coordinates are scaled by the joints' mean reach, so that the planner's metric is in metres.
    `planner` is one of `PLANNERS`: `ompl`, OMPL's RRTConnect, or `compiled`, our own in compiled
    code, which asks the kernels whatever the engine of the world (the proof does not) and takes the
    place of OMPL where that is not installed.

    Errors: `ProblemError` for an unknown planner.
    """
    if planner not in PLANNERS:
        raise ProblemError.of(
            "planner",
            field="planner",
            value=planner,
            legal=", ".join(PLANNERS),
            fix="leave it out",
        )
    asked, planner = planner, available_planner(planner)
    instead = "" if planner == asked else f"{asked} is not installed: {planner} trees"
    edge = clearance if isinstance(clearance, EdgeClearance) else clearance.clearance()
    world = edge.world
    start, goal = (world.scene.rows_of(q)[0].copy() for q in (start_rad, goal_rad))
    robot = world.robot
    for name, q in (("start", start), ("goal", goal)):
        outside = (q < robot.q_lower_rad - 1e-9) | (q > robot.q_upper_rad + 1e-9)
        if np.any(outside):
            joint = int(np.flatnonzero(outside)[0])
            return PathResult(
                Status.NO_PATH,
                None,
                note=f"{name}: joint {joint + 1} at {q[joint]:.4f} rad is outside "
                f"[{robot.q_lower_rad[joint]:.4f}, {robot.q_upper_rad[joint]:.4f}]",
            )
        pair = edge.collide(q, edge.tracking_error_m)
        if pair is not None:
            return PathResult(Status.IN_COLLISION, None, pair, f"{name} in collision")
    growth = _growth(edge, np.stack([start, goal]), inflation_m)
    # The proof refuses what comes nearer than its margin: no use in planning there.
    least = np.minimum(growth, LEAST_GROWTH * edge.tracking_error_m)
    iterations = checks = 0
    blocked = np.zeros(len(growth), dtype=np.int64)
    for attempt in range(attempts):
        search = _Search(edge, edge.scope.grown(growth), step_m, seed + attempt, max_iterations)
        if search.is_free(start, goal):
            found = short = np.stack([start, goal])
        elif (way := PLANNERS[planner](search, start, goal)) is not None:
            found, short = way, search.shorten(way, shortcut_tries)
        else:
            found = None
        iterations, checks = iterations + search.iterations, checks + search.checks
        if found is not None:
            for path in (short, found):
                if prove_path(edge, path):
                    return PathResult(
                        Status.CONVERGED,
                        JointPath(path),
                        None,
                        instead,
                        iterations,
                        checks,
                        planner if search.iterations else "none",
                    )
            step_m *= 0.5
        else:
            growth = np.maximum(0.5 * growth, least)
            blocked += search.blocked
    note = f"no path within {attempts} attempts of {max_iterations} iterations"
    pair = None
    if blocked.any():
        # By bodies: one that consists of many pieces is in the way with any of them.
        bodies = np.bincount(world.scene.pairs.body, weights=blocked)
        pair = world.pairs[int(bodies.argmax())]
        note += f", most often in the way: {pair[0]} - {pair[1]}"
    note = "; ".join(part for part in (note, instead) if part)
    return PathResult(Status.NO_PATH, None, pair, note, iterations, checks, planner)


def available_planner(name: str = "ompl") -> str:
    """The planner that answers for `name` here: the compiled one where OMPL is not installed."""
    return "compiled" if name == "ompl" and ob is None else name


def _growth(edge: EdgeClearance, ends: Array, inflation_m: float) -> Array:
    """By how much every piece pair is grown while planning (M,) [m]."""
    scene = edge.world.scene
    joint = scene.solids.info[edge.scope.pairs.piece, 0]
    growth = np.where(joint.min(axis=1) > 0, 0.25 * inflation_m, inflation_m)
    near = scene.near(ends, inflation_m / 0.8, edge.scope)
    for (_, m), distance in zip(near.which, near.values[:, 0]):
        growth[m] = min(growth[m], max(0.8 * distance, 0.5 * (distance + edge.tracking_error_m)))
    return growth


class _Search:
    """One attempt: the question, and a count of what was asked to answer it."""

    def __init__(
        self, edge: EdgeClearance, scope: Scope, step_m: float, seed: int, max_iterations: int
    ) -> None:
        self.scene, self.robot = edge.world.scene, edge.world.robot
        self.scope, self.step_m = scope, step_m
        self.seed, self.max_iterations = seed, max_iterations
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

    def shorten(self, path: Array, tries: int) -> Array:
        """`path` made short."""
        return shortcut(path, self.is_free, scale=self.scene.lever_m, tries=tries, seed=self.seed)


def _by_compiled_trees(search: _Search, start: Array, goal: Array) -> Array | None:
    """Knots (K, n), or None."""
    scan = search.scene.scan(search.step_m, 0.0, search.scope)
    limits = (search.robot.q_lower_rad, search.robot.q_upper_rad)
    found = tree_path(
        scan,
        start,
        goal,
        limits=limits,
        scale=search.scene.lever_m,
        reach_m=RANGE_M,
        seed=search.seed,
        max_iterations=search.max_iterations,
    )
    search.iterations, search.checks = found.iterations, search.checks + found.checks
    search.blocked += found.blocked
    return found.q_rad


def _by_ompl(search: _Search, start: Array, goal: Array) -> Array | None:
    """Knots (K, n) of an exact solution, or None."""
    robot, scale = search.robot, search.scene.lever_m
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

    class Motions(ob.MotionValidator):
        """Segment checks in one compiled call each."""

        def checkMotion(self, first: ob.State, second: ob.State, *_: object) -> bool:
            q0[:], q1[:] = first[0:n], second[0:n]
            return search.is_free(q0 / scale, q1 / scale)

    def enough() -> bool:
        search.iterations += 1
        return search.iterations > search.max_iterations

    information.setStateValidityChecker(valid)
    information.setMotionValidator(Motions(information))
    information.setup()
    # OMPL's generators are global: seeding before each query makes it repeatable.
    ou.RNG.setSeed(search.seed % (2**31 - 1) + 1)
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


#: What grows the trees, by name.
PLANNERS: dict[str, Callable[[_Search, Array, Array], Array | None]] = {
    "ompl": _by_ompl,
    "compiled": _by_compiled_trees,
}
