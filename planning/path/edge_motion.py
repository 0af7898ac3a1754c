"""The motion of one edge: obstacle-free optimum first, then seed path, refinement, fallback."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from dmoc.motion.motion import Motion, MotionProblem
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointPath, JointTrajectory
from dmoc.programme.types import Guess
from dmoc.refinement import RefineParams, refine
from dmoc.refinement.fallback import fallback_motion
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.collision.certificate import LEVEL_TOLERANCE
from planning.collision.world import CollisionWorld, EdgeClearance
from planning.path.rrt_connect import PathResult, plan_path

#: Half-spaces aim at least so much higher than what is asked, so that it can be proven [m].
LEAST_SPARE_M = 0.001

#: A further seed must promise to save this share of the cost to be finished.
WORTH = 1e-3

Quality = Literal["screen", "final"]


@dataclass(frozen=True)
class EdgeParams:
    """Budgets of `plan_motion`.

    The obstacle-free optimum itself is the first seed while it penetrates by less than
    `shallow_m`; after that up to `num_paths` planned paths are tried until one is certified.
    `inflation_m` is by how much bodies grow while planning. `refine` overrides the settings that
    belong to the quality.
    """

    shallow_m: float = 0.08
    num_paths: int = 2
    inflation_m: float = 0.02
    max_iterations: int = 4000
    refine: RefineParams | None = field(default=None)


def plan_motion(
    problem: MotionProblem,
    clearance: EdgeClearance,
    world: CollisionWorld,
    *,
    seed: int,
    quality: Quality = "screen",
    method: Method = "halfspaces",
    params: EdgeParams = EdgeParams(),
    guess: JointTrajectory | None = None,
    guess_planner: str = "none",
    free_guess: Guess | None = None,
    solver: str = DEFAULT_SOLVER,
) -> Motion:
    """The certified motion of `problem` in a station, or the reason why there is none.

    The obstacle-free optimum (solved from `free_guess`, else from the straight line), if it is
    certified. Else `refine` from, in this order, `guess` (a
    motion of the same edge on another grid), the obstacle-free optimum where that penetrates
    little, and planned paths between the ends of the departure lines (`problem.depart_rad[-1]`,
    `problem.arrive_rad[0]`); `method="boxes"` needs collision-free seeds and leaves out the second.
    `quality="screen"` stops at 1 % and takes the first certified motion; `"final"` stops at 0.3 %
    and takes the cheapest of all seeds that is proven to keep the clearance of `world`, or, where
    none is, the cheapest certified one (boxes stop at 0.1 % in both). What falls short says so in
    `note`. If no refined motion is
    certified, the time-scaled path is (`source="fallback"`). `seed` makes it repeatable; `world` is
    the one of `clearance`, and its `clearance_m` is the demanded d_c. `planner` of the motion is
    who planned the path that its start came from; of `guess` that is `guess_planner`.

    Failures are statuses: `in_collision` (an end, with the pair in `note`), `no_path`,
    `uncertified` (interval and pair in `note`), and what the solver reports.
    """
    settings = params.refine
    if settings is None:
        settings = RefineParams.screening() if quality == "screen" else RefineParams()
        settings = settings.by(solver)
        asked = max(world.clearance_m, clearance.tracking_error_m)
        spare = max(LEAST_SPARE_M, 2.5 * LEVEL_TOLERANCE * asked)
        settings = settings.replace(clearance_m=asked, spare_m=spare)
        if method == "boxes":
            # They creep: at 1 % they would stop far from where they lead.
            settings = settings.replace(stop_fraction=1e-3, max_outer=200)
    blocked = _ends_in_collision(problem, clearance)
    if blocked is not None:
        return blocked
    free = refine(problem, free_guess, clearance, method="none", params=settings)
    free = free.replace(planner="none")
    keeps = _keeps(free, world.clearance_m)
    if method == "none" or (free.certified and (keeps or quality == "screen")):
        return free if keeps or not free.certified else _named_shortfall(free, clearance)
    used = free.iterations
    best, last, paths = free if free.certified else None, free, list[PathResult]()
    for start in _starts(problem, clearance, method, seed, params, free, guess):
        path: JointPath | JointTrajectory
        if isinstance(start, JointTrajectory):
            path, planner = start, guess_planner if start is guess else "none"
        elif start.path is None:
            if best is None and not paths:
                last = _without_path(start)
            break
        else:
            paths.append(start)
            path, planner = start.path, start.planner
        last = refine(
            problem,
            path,
            clearance,
            method=method,
            params=settings,
            fallback=False,
            worth=_to_beat(best, world),
        ).replace(planner=planner)
        used += last.iterations
        if last.certified and (best is None or _rank(last, world) < _rank(best, world)):
            best = last
        if best is not None and quality == "screen":
            break
    for found in () if best is not None else paths:
        assert found.path is not None
        best = fallback_motion(problem, found.path, clearance, note=last.note)
        if best is not None:
            best = best.replace(planner=found.planner)
            break
    if best is None:
        return last.replace(iterations=used)
    keeps = _keeps(best, world.clearance_m)
    return (best if keeps else _named_shortfall(best, clearance)).replace(iterations=used)


def _keeps(motion: Motion, asked_m: float) -> bool:
    """Whether a certified motion is proven to keep the clearance that was asked for."""
    proven = motion.proven_clearance_m
    return bool(motion.certified) and proven is not None and proven >= asked_m * (1.0 - 1e-9)


def _rank(motion: Motion, world: CollisionWorld) -> tuple[bool, float]:
    """What makes one certified motion better than another: the clearance, then the cost."""
    return not _keeps(motion, world.clearance_m), motion.cost


def _to_beat(best: Motion | None, world: CollisionWorld) -> float:
    """What another motion may cost to be worth its last solve."""
    if best is None or not _keeps(best, world.clearance_m):
        return float("inf")
    return (1.0 - WORTH) * best.cost


def _named_shortfall(motion: Motion, clearance: EdgeClearance) -> Motion:
    """`motion` with a note on how much of the asked clearance is proven, and what is nearest."""
    trajectory, proven = motion.trajectory, motion.proven_clearance_m
    assert trajectory is not None
    assert proven is not None
    times = np.linspace(trajectory.t_s[0], trajectory.t_s[-1], 32 * trajectory.num_intervals)
    q = trajectory.sample(times).q_rad
    phi = clearance.phi(q)
    nearest = int(phi.argmin())
    pair = clearance.collide(q[nearest], float(phi[nearest]) + 1e-6)
    note = (
        f"proven to keep {1e3 * proven:.1f} mm of the {1e3 * clearance.world.clearance_m:g} mm "
        f"asked for"
    )
    if pair is not None:
        note += f": {pair[0]} - {pair[1]} at {times[nearest]:.2f} s"
    return motion.replace(note="; ".join(part for part in (motion.note, note) if part))


def _starts(
    problem: MotionProblem,
    clearance: EdgeClearance,
    method: Method,
    seed: int,
    params: EdgeParams,
    free: Motion,
    guess: JointTrajectory | None,
) -> Iterator[JointTrajectory | PathResult]:
    """Where refinement may start; a `PathResult` without path is the last one."""
    if guess is not None:
        yield guess
    if method == "halfspaces" and _is_shallow(free, params.shallow_m):
        assert free.trajectory is not None
        yield free.trajectory
    yield from seed_paths(problem, clearance, seed, params)


def _is_shallow(free: Motion, shallow_m: float) -> bool:
    """Whether the obstacle-free optimum exists and penetrates by less than `shallow_m`."""
    if free.trajectory is None or free.min_clearance_m is None:
        return False
    return free.min_clearance_m > -shallow_m


def _ends_in_collision(problem: MotionProblem, clearance: EdgeClearance) -> Motion | None:
    for name, q in (("start", problem.start_rad), ("goal", problem.goal_rad)):
        pair = clearance.collide(q, clearance.tracking_error_m)
        if pair is not None:
            note = f"{name}: {pair[0]} - {pair[1]}"
            return Motion(Status.IN_COLLISION, "refined", None, float("inf"), note=note)
    return None


def seed_paths(
    problem: MotionProblem, clearance: EdgeClearance, seed: int, params: EdgeParams
) -> Iterator[PathResult]:
    """Planned paths between the inner ends of the departure lines, with the lines added."""
    start = problem.start_rad if problem.depart_rad is None else problem.depart_rad[-1]
    goal = problem.goal_rad if problem.arrive_rad is None else problem.arrive_rad[0]
    for attempt in range(params.num_paths):
        result = plan_path(
            clearance,
            start,
            goal,
            seed=seed + 1000 * attempt,
            inflation_m=params.inflation_m,
            max_iterations=params.max_iterations,
            attempts=6,
        )
        if result.path is None:
            yield result
            return
        parts = [result.path.q_rad]
        if problem.depart_rad is not None:
            parts = [problem.start_rad[None], problem.depart_rad[:-1], *parts]
        if problem.arrive_rad is not None:
            parts = [*parts, problem.arrive_rad[1:], problem.goal_rad[None]]
        yield replace(result, path=JointPath(np.vstack(parts)))


def _without_path(result: PathResult) -> Motion:
    note = result.note
    if result.pair is not None and result.status is Status.IN_COLLISION:
        note = f"{note}: {result.pair[0]} - {result.pair[1]}"
    return Motion(result.status, "refined", None, float("inf"), note=note)
