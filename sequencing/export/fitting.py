r"""Few points whose curve on a controller keeps path and timing of a planned motion.

Two models of what a controller does with joint targets and a time for each stretch:

*zones*: corners are parabolas that begin at share s ≤ ½ of a segment. With s = ½ and equal times T
the motion is a uniform quadratic B-spline in time whose control points are the targets; at rest at
both ends the first and the last stretch take 1.5 T. With a smaller share a corner moves outwards,
by at most |Δ|/4 for each unit of s, Δ the second difference of the targets.

*spline*: the targets are passed at equal times by the C² cubic that rests at both ends. Another
spline through the same points is taken to lie between it and the chords.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import linprog

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot

#: Errors that are tried [rad]: the next one where clearance is short of the one before.
TOLERANCES_RAD = (2e-3, 1e-3, 5e-4, 2.5e-4, 1.2e-4)
MOST_SEGMENTS = 160
_SAMPLES = 6  # an interval of the plan


class Stretch(NamedTuple):
    """A stretch of the curves that a controller may make: `curve` (λ → knots) for λ in
    [0, `most`], no joint of which moves more than `rate` (n,) [rad] for a unit of λ."""

    curve: Callable[[float], JointTrajectory]
    rate: Array
    most: float


class Targets(NamedTuple):
    """Targets (m + 1, n) [rad] from start to goal, the time (m,) [s] of each stretch, the curve
    that they make by the model, and the curves that they might make instead."""

    q_rad: Array
    times_s: Array
    curve: JointTrajectory
    pieces: tuple[Stretch, ...]
    deviation_rad: float
    worst_rad: float


def curve_through(t_s: Array, q_rad: Array, velocity_rad_s: Array) -> JointTrajectory:
    """The Hermite curve of knots, without torques."""
    return JointTrajectory(t_s, q_rad, velocity_rad_s, np.zeros((len(t_s) - 1, q_rad.shape[1])))


def zone_curve(targets: Array, step_s: float, share: float = 0.5) -> JointTrajectory:
    """What zones of that share (> 0) make of targets (m + 1, n) with equal times."""
    before = np.vstack([targets[:1], targets])
    after = np.vstack([targets, targets[-1:]])
    delta = after - before  # (m + 2, n); zero at both ends
    enter = targets - share * delta[:-1]
    leave = targets + share * delta[1:]
    q = np.stack([enter, leave], axis=1).reshape(-1, targets.shape[1])
    v = np.stack([delta[:-1], delta[1:]], axis=1).reshape(q.shape) / step_s
    lengths = np.tile([2 * share, 1 - 2 * share], len(targets))[:-1] * step_s
    keep = np.r_[True, lengths > 1e-12]
    return curve_through(np.r_[0.0, np.cumsum(lengths)][keep], q[keep], v[keep])


def zone_targets(plan: JointTrajectory, robot: Robot, tolerance: float) -> Targets:
    """The fewest targets within the robot's position and speed limits (or the plan's own extremes)
    whose zone curve keeps the plan within `tolerance`."""
    times, wanted = _sampled(plan)
    low = np.minimum(robot.q_lower_rad, plan.q_rad.min(axis=0))
    high = np.maximum(robot.q_upper_rad, plan.q_rad.max(axis=0))
    ends = np.vstack([wanted[:1], wanted[-1:]])
    for m in range(1, MOST_SEGMENTS + 1):
        step = plan.duration_s / (m + 1)
        fastest = np.maximum(robot.velocity_limit_rad_s, _peak_speed(plan)) * step
        basis = _basis(times / step, m)
        rest = wanted - basis[:, [0, -1]] @ ends
        inner = np.linalg.lstsq(basis[:, 1:-1], rest, rcond=None)[0]
        error = np.abs(basis[:, 1:-1] @ inner - rest)
        if np.sqrt(np.mean(error**2, axis=0)).max() > tolerance:
            continue  # the least squares bound the least maximum from below
        targets = np.vstack([ends[:1], inner, ends[1:]])
        over = np.abs(np.diff(targets, axis=0)).max(axis=0) > fastest
        over |= (targets.min(axis=0) < low) | (targets.max(axis=0) > high)
        worst = error.max(axis=0)
        for j in np.argsort(-worst):
            if m > 1 and (worst[j] > tolerance or over[j]):
                bounds = (low[j], high[j], fastest[j])
                targets[:, j] = _least_maximum(basis, wanted[:, j], bounds)
                worst[j] = np.abs(basis @ targets[:, j] - wanted[:, j]).max()
            if worst[j] > tolerance:
                break
        else:
            break
    lengths = np.full(m, step)
    lengths[0] += step / 2
    lengths[-1] += step / 2
    curve = zone_curve(targets, step)
    bend = np.abs(np.diff(targets, 2, axis=0)).max() if m > 1 else 0.0
    deviation = _deviation(plan, curve)
    pieces = tuple(_corners(targets))
    return Targets(targets, lengths, curve, pieces, deviation, deviation + float(bend) / 8)


def spline_curve(targets: Array, step_s: float) -> JointTrajectory:
    """The C² cubic through targets (m + 1, n) at equal times, at rest at both ends."""
    times: Array = np.arange(float(len(targets))) * step_s
    velocity: Array = CubicSpline(times, targets, bc_type="clamped")(times, 1)
    return curve_through(times, targets, velocity)


def spline_targets(plan: JointTrajectory, tolerance: float) -> Targets:
    """The fewest points of the plan, at equal times, whose spline keeps it within `tolerance`."""
    for m in range(2, MOST_SEGMENTS + 1):
        step = plan.duration_s / m
        targets = plan.on(None).sample(plan.t_s[0] + np.arange(m + 1) * step).q_rad
        curve = spline_curve(targets, step)
        deviation = _deviation(plan, curve)
        if deviation <= tolerance:
            break
    pieces = tuple(_chords(curve, step))
    worst = max(float(piece.rate.max()) for piece in pieces)
    return Targets(targets, np.full(m, step), curve, pieces, deviation, deviation + worst)


def _sampled(plan: JointTrajectory) -> tuple[Array, Array]:
    times = np.linspace(0.0, plan.duration_s, _SAMPLES * plan.num_intervals + 1)
    return times, plan.on(None).sample(plan.t_s[0] + times).q_rad


def _deviation(plan: JointTrajectory, curve: JointTrajectory) -> float:
    times, wanted = _sampled(plan)
    return float(np.max(np.abs(curve.sample(times).q_rad - wanted)))


def _basis(u: Array, m: int) -> Array:
    """Shares (K, m + 1) of the targets in the zone curve (s = ½) at time u, in steps."""
    piece = np.clip(u.astype(int), 0, m)
    s = u - piece
    basis = np.zeros((len(u), m + 1))
    rows = np.arange(len(u))
    for shift, share in ((-1, (1 - s) ** 2 / 2), (1, s * s / 2), (0, 0.5 + s - s * s)):
        np.add.at(basis, (rows, np.clip(piece + shift, 0, m)), share)
    return basis


def _peak_speed(plan: JointTrajectory) -> Array:
    peak: Array = np.abs(plan.velocity_rad_s).max(axis=0)
    return peak


def _least_maximum(basis: Array, wanted: Array, bounds: tuple[float, float, float]) -> Array:
    """The targets in [low, high] between the ends, no two farther apart than the third bound, with
    the least max |basis x − wanted|, by a linear programme; a straight line where there are none.
    """
    low, high, apart = bounds
    count = basis.shape[1]
    basis, seen = basis[::2], wanted[::2]
    one, steps = np.ones((len(seen), 1)), np.diff(np.eye(count), axis=0)
    found = linprog(
        np.r_[np.zeros(count), 1.0],
        np.vstack(
            [
                np.hstack([basis, -one]),
                np.hstack([-basis, -one]),
                np.hstack([np.vstack([steps, -steps]), np.zeros((2 * len(steps), 1))]),
            ]
        ),
        np.r_[seen, -seen, np.full(2 * len(steps), apart)],
        bounds=[(wanted[0],) * 2, *[(low, high)] * (count - 2), (wanted[-1],) * 2, (0.0, None)],
    )
    if found.x is None:
        return np.linspace(wanted[0], wanted[-1], count)
    return np.r_[wanted[0], found.x[1 : count - 1], wanted[-1]]


def _corners(targets: Array) -> Iterator[Stretch]:
    """Corner by corner, from the middle of one segment to that of the next (the ends: all)."""
    if len(targets) == 2:
        targets = np.vstack([targets[:1], targets.mean(axis=0), targets[1:]])
    last = len(targets) - 1
    for i in range(1, last):
        near = targets[i - 1 : i + 2]
        shares = (1.0 if i == 1 else 0.5, 1.0 if i == last - 1 else 0.5)
        yield Stretch(_corner(near, *shares), np.abs(np.diff(near, 2, axis=0))[0] / 4, 0.5)


def _corner(near: Array, before: float, after: float) -> Callable[[float], JointTrajectory]:
    """Straight, parabola, straight around near[1], as much of the two segments as is told."""
    first, second = np.diff(near, axis=0)

    def curve(share: float) -> JointTrajectory:
        along = (-before * first, -share * first, share * second, after * second)
        t = np.cumsum([0.0, before - share, 2 * share, after - share])
        keep = np.array([before - share > 1e-9, True, True, after - share > 1e-9])
        velocity = np.array([first, first, second, second])
        return curve_through(t[keep], (near[1] + np.array(along))[keep], velocity[keep])

    return curve


def _chords(curve: JointTrajectory, step_s: float) -> Iterator[Stretch]:
    """Stretch by stretch, from the chord (λ = 0) to the spline (λ = 1)."""
    for k in range(curve.num_intervals):
        ends, speeds = curve.q_rad[k : k + 2], curve.velocity_rad_s[k : k + 2]
        chord = np.repeat((ends[1:] - ends[:1]) / step_s, 2, axis=0)
        # The inner Bézier points of the difference; the curve lies within their hull.
        rate = np.abs(speeds - chord).max(axis=0) * step_s / 3
        yield Stretch(_stretch(ends, speeds, chord, step_s), rate, 1.0)


def _stretch(
    ends: Array, speeds: Array, chord: Array, step_s: float
) -> Callable[[float], JointTrajectory]:
    def curve(share: float) -> JointTrajectory:
        times = np.array([0.0, step_s])
        return curve_through(times, ends, chord + share * (speeds - chord))

    return curve
