"""Coarse grid first: a cheap solve tells the duration, the shape and which limits matter."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory
from dmoc.programme.builder import motion_programme
from dmoc.programme.curve_limits import Lag
from dmoc.programme.types import Guess, NlpSolution
from dmoc.solving.nlp import Multipliers


def prolonged(problem: MotionProblem, coarse: MotionProblem, solution: NlpSolution) -> Guess:
    """The solution of `coarse` on the grid of `problem`, multipliers included.

    Knots by the cubic through (q_k, q̇_k), torques linearly. The multipliers of the momentum rows
    tend to a function of time as h → 0, those of bounds and limits to a density times h.
    """
    few, many = coarse.num_intervals, problem.num_intervals
    at, to = np.linspace(0, 1, few + 1), np.linspace(0, 1, many + 1)
    at_middle, to_middle = (at[1:] + at[:-1]) / 2, (to[1:] + to[:-1]) / 2
    duration = solution.step_s * few
    curve = JointTrajectory(
        at * duration, solution.q_rad, solution.velocity_rad_s, solution.torque_nm
    )
    q = np.clip(
        curve.sample(to * duration).q_rad, problem.robot.q_lower_rad, problem.robot.q_upper_rad
    )
    torque = _between(solution.torque_nm, at_middle, to_middle)
    step = duration / many
    if not isinstance(solution.multipliers, Multipliers):
        return Guess(q, torque, step)
    families = solution.multipliers.families
    source, target = motion_programme(coarse, families), motion_programme(problem, families)
    bounds = np.zeros(target.programme.num_variables)
    rows = np.zeros(target.programme.num_rows)
    given, share = solution.multipliers, few / many
    old, new = source.layout, target.layout
    knots = share * _between(given.bounds[old.knots()], at, to)
    knots[[0, -1]] = 0.0
    bounds[new.knots()] = knots
    bounds[new.torques()] = share * _between(given.bounds[old.torques()], at_middle, to_middle)
    bounds[new.last_velocity()] = given.bounds[old.last_velocity()]
    for name, place in target.rows.items():
        values = given.rows[source.rows[name]]
        if place.shape == values.shape:  # of the whole motion or its end, not of a knot
            rows[place] = values
            continue
        values = _at_places(values, few, many)
        rows[place] = values if name == "momentum" else share * values
    lag = None
    if given.lag is not None:  # of first order in the step
        lag = Lag(
            share * _at_places(given.lag.slope, few, many),
            share * _at_places(given.lag.acceleration, few, many),
            share * _at_places(given.lag.velocity, few, many),
            share * _at_places(given.lag.jerk, few, many),
        )
    return Guess(q, torque, step, Multipliers(bounds, rows, families, lag))


def _at_places(values: Array, few: int, many: int) -> Array:
    """Values at all knots, all intervals or the inner knots of N = `few`, on N = `many`."""
    if len(values) == few:
        at, to = (np.arange(n) / n + 0.5 / n for n in (few, many))
        return _between(values, at, to)
    at, to = np.linspace(0, 1, few + 1), np.linspace(0, 1, many + 1)
    if len(values) == few - 1:
        at, to = at[1:-1], to[1:-1]
    return _between(values, at, to)


def _between(values: Array, at: Array, to: Array) -> Array:
    return np.stack([np.interp(to, at, column) for column in values.T], axis=1)
