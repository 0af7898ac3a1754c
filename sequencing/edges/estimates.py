"""Cheap estimates of the cost of a motion that rank well; none of them is a bound.

The straight-line estimate is usually above the optimum, the learned one scatters around it; neither
may enter a statement that is called proven. Bounds are in `sequencing.bounds`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.cost import Cost
from dmoc.robot.robot import Robot
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from sequencing.edges.learned import LearnedEstimate, edge_features, fit_estimate
from sequencing.edges.line_torques import line_sums
from sequencing.edges.nodes import StationNodes

# Configurations of a straight line that are asked yes or no for the estimate's obstacle share.
LINE_SAMPLES = 6


def travel_time(robot: Robot, start: Array, goal: Array) -> Array:
    """Approximate travel time max_j |Δq_j| / v_j (K,) [s] of rows start, goal (K, n)."""
    return np.max(np.abs(goal - start) / robot.velocity_limit_rad_s, axis=-1)


def least_time(robot: Robot, start: Array, goal: Array) -> Array:
    """Least time (K,) [s] from rest to rest of rows start, goal (K, n) that speed and acceleration
    limits leave, the slowest joint alone: Δ/v + v/a, and 2 √(Δ/a) where v is never reached."""
    distance = np.abs(goal - start)
    speed, rate = robot.velocity_limit_rad_s, robot.acceleration_limit_rad_s2
    cruising = distance / speed + speed / rate
    short = 2.0 * np.sqrt(distance / rate)
    return np.max(np.where(distance < speed**2 / rate, short, cruising), axis=-1)


def quintic_quadrature() -> tuple[Array, Array, Array, Array]:
    """Weights, s, s', s'' of the quintic rest-to-rest profile at 7 Gauss–Legendre points."""
    nodes, weights = np.polynomial.legendre.leggauss(7)
    x = 0.5 * (nodes + 1.0)
    s = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    first = 30.0 * x**2 * (1.0 - x) ** 2
    second = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
    return 0.5 * weights, s, first, second


@dataclass(frozen=True)
class StraightLine:
    """J(T) = alpha T + beta/T + gamma/T³ of straight joint-space quintics, at its best duration."""

    cost: Array
    duration_s: Array
    alpha: Array
    beta: Array
    gamma: Array


def straight_line(robot: Robot, cost: Cost, start: Array, goal: Array) -> StraightLine:
    """Cost of the straight quintic motion between rows of start and goal (K, n), closed form in T.

    Along q(s) = q₀ + sΔq the torque is u = (M Δq s'' + C(q, Δq)Δq s'²)/T² + g, so the three
    integrals of |g|², of the cross term and of the inertia term are evaluated once, at
    Gauss–Legendre points. Torque limits are ignored, speed limits are kept.
    """
    weights, s, first, second = quintic_quadrature()
    delta = goal - start
    rule = np.column_stack([weights, s, first, second])
    held, mixed, inertial = line_sums(robot.model, start, goal, rule).T
    alpha = cost.time + cost.effort * held
    beta = cost.velocity * np.sum(delta * delta, axis=1) * float(weights @ first**2)
    beta += cost.effort * mixed
    gamma = cost.effort * inertial
    squared = (beta + np.sqrt(beta**2 + 12.0 * alpha * gamma)) / (2.0 * alpha)
    least = np.max(np.abs(delta) / robot.velocity_limit_rad_s, axis=1) * 1.875
    duration = np.maximum(np.maximum(np.sqrt(np.maximum(squared, 0.0)), least), 1e-3)
    value = alpha * duration + beta / duration + gamma / duration**3
    return StraightLine(value, duration, alpha, beta, gamma)


class StationEstimates:
    """Estimates of the travels `pairs` (P, 2) of a station, a row each.

    `cost` (P,) is the straight line's (`rough`) until `fit` has run, the learned one afterwards.
    """

    def __init__(
        self, station: Station, world: CollisionWorld, nodes: StationNodes, pairs: np.ndarray
    ) -> None:
        assert isinstance(station.cost, Cost)
        q = nodes.q_rad
        self.rough = straight_line(station.robot, station.cost, q[pairs[:, 0]], q[pairs[:, 1]])
        self.learned: LearnedEstimate | None = None
        self.cost = self.rough.cost
        waypoints = nodes.waypoints(pairs)
        inner0, inner1 = waypoints[:, 1], waypoints[:, 2]
        hits = np.zeros(len(pairs))
        for fraction in np.linspace(0.0, 1.0, LINE_SAMPLES + 2)[1:-1]:
            hits += world.collide_batch(inner0 + fraction * (inner1 - inner0))
        rough = self.rough
        parts = np.column_stack(
            [
                rough.cost,
                rough.duration_s,
                rough.alpha * rough.duration_s,
                rough.gamma / rough.duration_s**3,
            ]
        )
        gravity = station.robot.gravity_torque_nm(q)
        self.features = edge_features(waypoints, gravity, pairs, parts, hits / LINE_SAMPLES)

    def fit(
        self, rows: np.ndarray, cost: Array, held_rows: np.ndarray, held_cost: Array
    ) -> LearnedEstimate:
        """Learn from the solved costs of `rows`, judged by those of `held_rows`."""
        rough = self.rough.cost
        judged = self.features[held_rows], rough[held_rows], held_cost
        self.learned = fit_estimate(self.features[rows], rough[rows], cost, judged)
        self.cost = self.learned.predict(self.features, rough)
        return self.learned
