"""All joint vectors that bring the tool tip to a pose: branches and wrap-arounds within limits."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from planning.arm.closed_forms import NUM_BRANCHES, STRAIGHT, closed_form
from planning.arm.numeric import converge, multi_start
from planning.arm.screws import ScrewAxes, chain_of, pose_error

#: Largest error of a returned solution [m, rad].
TOLERANCE = 1e-9
_STARTS = 48
#: A track is sampled at so many places at least, at both ends and no farther apart than that [m].
TRACK_PLACES = 5
TRACK_STEP_M = 0.5


@dataclass(frozen=True)
class Solutions:
    """`q_rad` (S, n) within limits, sorted by pose; `pose` (S,) indexes the poses asked for.

    Per pose (K,): `num_branches` found before limits, `num_outside`: branches of which no
    wrap-around lies within the limits.
    """

    q_rad: Array
    pose: npt.NDArray[np.int64]
    num_branches: npt.NDArray[np.int64]
    num_outside: npt.NDArray[np.int64]


def inverse(robot: Robot, poses: Array, seed: int = 0) -> Solutions:
    """Every joint vector within limits whose tool tip is at one of `poses` (K, 4, 4).

    Closed form for spherical wrists and for three parallel axes; other arms (7 joints, offset
    wrists) by seeded multi-start, which for 7 joints samples the free motion. Errors against
    forward kinematics are at most 1e-9 m and rad. At a straight wrist one joint is free and is
    sampled; of more than eight solutions, as samples are, each is given once, with the turns
    nearest to the middle of the ranges: all turns of them were up to 2,300. A pose that is off that
    by the digits of a file (a sine below 1e-6) may leave the exact branches out of reach or limits:
    then come the samples, off by no more than that sine.
    A track under the arm is sampled: at every place the arm on it is solved.
    """
    return _inverse(chain_of(robot), np.asarray(poses, dtype=float).reshape(-1, 4, 4), seed)


def _inverse(chain: ScrewAxes, poses: Array, seed: int) -> Solutions:
    if chain.slides[0]:
        return _along_track(chain, poses, seed)
    branches = _branches(chain, poses, seed)
    rows: list[Array] = []
    owner: list[int] = []
    counts, outside = np.zeros((2, len(poses)), dtype=np.int64)
    for k, (exact, sampled) in enumerate(branches):
        for found in (exact, sampled):
            counts[k] += len(found)
            turns = [wraps(q, chain.lower_rad, chain.upper_rad) for q in found]
            if len(found) > NUM_BRANCHES:
                turns = [_most_central(inside, chain) for inside in turns]
            outside[k] += sum(len(inside) == 0 for inside in turns)
            legal = [row for inside in turns for row in inside]
            rows += legal
            owner += [k] * len(legal)
            if legal:
                break
    return Solutions(
        np.array(rows).reshape(-1, chain.num_joints),
        np.array(owner, dtype=np.int64),
        counts,
        outside,
    )


def _along_track(chain: ScrewAxes, poses: Array, seed: int) -> Solutions:
    low, high = float(chain.lower_rad[0]), float(chain.upper_rad[0])
    count = max(TRACK_PLACES, int(np.ceil((high - low) / TRACK_STEP_M)) + 1)
    places = np.linspace(low, high, count)
    parts = ("axis", "point", "lower_rad", "upper_rad", "slides")
    arm = replace(chain, **{name: getattr(chain, name)[1:] for name in parts})
    found = []
    for k, place in enumerate(places):
        moved = poses.copy()  # seen from an arm that stands at the track's zero
        moved[:, :3, 3] -= place * chain.axis[0]
        found.append(_inverse(arm, moved, seed + 104_729 * k))
    pose = np.concatenate([each.pose for each in found])
    rows = [np.insert(each.q_rad, 0, place, axis=1) for each, place in zip(found, places)]
    order = np.argsort(pose, kind="stable")
    counts, outside = (
        np.sum([getattr(each, name) for each in found], axis=0)
        for name in ("num_branches", "num_outside")
    )
    return Solutions(np.concatenate(rows)[order], pose[order], counts, outside)


def _most_central(turns: Array, chain: ScrewAxes) -> Array:
    """The one of the rows (W, n) that is nearest to the middle of the ranges; none of none."""
    away = np.abs(turns - (chain.lower_rad + chain.upper_rad) / 2).sum(axis=1)
    return turns[np.argsort(away, kind="stable")[:1]]


def _branches(chain: ScrewAxes, poses: Array, seed: int) -> list[tuple[Array, Array]]:
    """Distinct solutions of each pose, modulo full turns: exact ones, and of a nearly straight
    wrist the samples."""
    solve = closed_form(chain)
    if solve is None:
        none = np.empty((0, chain.num_joints))
        return [
            (multi_start(chain, pose, _STARTS, seed + 7919 * k), none)
            for k, pose in enumerate(poses)
        ]
    q, found = solve(poses)
    pose_index, branch_index = np.nonzero(found)
    candidates = q[pose_index, branch_index]
    # Near the edge of reach the cosines lose half their digits: a few Newton steps restore them.
    error = np.max(np.abs(pose_error(poses[pose_index], chain.forward(candidates))), axis=1)
    exact = error <= TOLERANCE
    rough = (error > 1e-11) & ((branch_index < NUM_BRANCHES) | exact)
    if np.any(rough):
        polished, arrived = converge(
            chain, poses[pose_index[rough]], candidates[rough], iterations=12
        )
        candidates[rough] = np.where(arrived[:, None], polished, candidates[rough])
        exact[rough] |= arrived
    near = (branch_index >= NUM_BRANCHES) & ~exact & (error <= 4.0 * STRAIGHT)
    result = []
    for k in range(len(poses)):
        mine = pose_index == k
        result.append((_distinct(candidates[mine & exact]), _distinct(candidates[mine & near])))
    return result


def _distinct(q: Array) -> Array:
    kept: list[Array] = []
    for row in q:
        row = (row + np.pi) % (2 * np.pi) - np.pi
        gaps = [np.max(np.abs((row - other + np.pi) % (2 * np.pi) - np.pi)) for other in kept]
        if not gaps or min(gaps) > 1e-6:
            kept.append(row)
    return np.array(kept).reshape(-1, q.shape[1])


def wraps(q_rad: Array, lower_rad: Array, upper_rad: Array) -> Array:
    """All q + 2πk (W, n) within [lower, upper]; a limit is met up to 1e-9 rad."""
    options = []
    for angle, low, high in zip(q_rad, lower_rad, upper_rad, strict=True):
        least = int(np.ceil((low - angle - 1e-9) / (2 * np.pi)))
        most = int(np.floor((high - angle + 1e-9) / (2 * np.pi)))
        options.append([min(max(angle + 2 * np.pi * k, low), high) for k in range(least, most + 1)])
    return np.array(list(itertools.product(*options))).reshape(-1, len(q_rad))


#: How far the tip may advance between two points of one branch [m].
_STEP_M = 0.004


def follow_line(
    chain: ScrewAxes, q_rad: Array, offset_m: Array
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Joint vectors along tip lines of constant orientation, by continuation.

    `q_rad` (A, n) starts; `offset_m` (A, m, 3) displacements of the tip from its start, in the
    order in which they are reached. Returns (A, m, n) and whether each line stayed on one branch
    within limits and 1e-9 (A,). Between given points the tip advances by at most `_STEP_M`.
    """
    q = np.array(q_rad, dtype=float)
    start = chain.forward(q)
    count, points = offset_m.shape[:2]
    result = np.empty((count, points, chain.num_joints))
    good = np.ones(count, dtype=bool)
    reached = np.zeros((count, 3))
    for m in range(points):
        move = offset_m[:, m] - reached
        steps = max(1, int(np.ceil(np.max(np.linalg.norm(move, axis=1), initial=0.0) / _STEP_M)))
        for s in range(1, steps + 1):
            if not good.any():
                break
            goal = start.copy()
            goal[:, :3, 3] += reached + move * (s / steps)
            following, arrived = converge(chain, goal, q, iterations=15)
            # A jump of more than 0.2 rad in 4 mm is another branch, not the same motion.
            good &= arrived & (np.max(np.abs(following - q), axis=1, initial=0.0) < 0.2)
            q = np.where(good[:, None], following, q)
        reached = offset_m[:, m].copy()
        result[:, m] = q
        good &= np.all((q >= chain.lower_rad - 1e-9) & (q <= chain.upper_rad + 1e-9), axis=1)
    return result, good
