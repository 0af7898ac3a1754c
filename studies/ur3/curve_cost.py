"""Cost, limits and gradients of joint curves that are linear in their parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from dmoc.arrays import Array
from dmoc.physics.metrics import Metric, MotionState, metric_of, settled
from dmoc.robot.robot import Robot
from studies.ur3.adjoint_dynamics import LinkChain, chain_of

# A search keeps this share of every limit, because it looks at samples only.
LIMIT_SHARE = 0.99


class CurveEvaluation(NamedTuple):
    """Costs (P,) in the metric and how far samples exceed the limits (P,), 0 where legal."""

    cost: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class CurveCost:
    r"""Curves q(t_k) = Σ_i B_{ki} P_i with parameters P (m, n), judged at K sample times.

    `basis` holds the matrices (K, m) of q, q̇, q̈ and jerk, `ends` those (2, m) of q̇ and q̈ at start
    and end; a sample stands for `weight` seconds. Costs are Σ weight·rate of the metric `name`.
    """

    robot: Robot
    name: str
    basis: tuple[Array, Array, Array, Array]
    ends: tuple[Array, Array]
    weight: float
    metric: Metric = field(init=False)
    chain: LinkChain = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "metric", metric_of(self.name, self.robot))
        object.__setattr__(self, "chain", chain_of(self.robot))

    def evaluate(self, parameters: Array, smoothing: float = 0.0) -> CurveEvaluation:
        """Costs and limit excess of many curves (P, m, n) at once."""
        state, _ = self._state(parameters)
        cost = self.weight * self.metric.rate(state, smoothing).sum(axis=-1)
        excess = np.zeros(len(cost))
        limited = [*self._limited(state), *self._at_ends(parameters)]
        for value, limit in limited:
            over = np.maximum(np.abs(value) / limit - LIMIT_SHARE, 0.0)
            excess += over.max(axis=(1, 2))
        return CurveEvaluation(cost, excess)

    def descend(self, parameters: Array, smoothing: float, price: float) -> tuple[float, Array]:
        """Cost plus `price`·∫Σ excess² of one curve (m, n), and its gradient (m, n)."""
        state, q = self._state(parameters)
        pull = self.metric.pull(state, smoothing)
        value = float(pull.rate.sum())
        by: list[Any] = [pull.velocity, pull.acceleration, pull.jerk, pull.torque]
        for index, (array, limit) in zip((0, 1, 3), self._limited(state)):
            over = np.abs(array) / limit - LIMIT_SHARE
            if over.max() > 0:
                over = np.maximum(over, 0.0)
                value += price * float(np.sum(over * over))
                slope = 2.0 * price * over * np.sign(array) / limit
                by[index] = slope if by[index] is None else by[index] + slope
        gradient = np.zeros_like(parameters)
        for basis, (array, limit) in zip(self.ends, self._at_ends(parameters)):
            over = np.maximum(np.abs(array) / limit - LIMIT_SHARE, 0.0)
            if over.max() > 0:
                value += price * float(np.sum(over * over))
                gradient += basis.T @ (2.0 * price * over * np.sign(array) / limit)
        if by[3] is not None:
            by_q, by_v, by_a = self.chain.pull_back(q, state.velocity, state.acceleration, by[3])
            gradient += self.basis[0].T @ by_q
            by[0] = by_v if by[0] is None else by[0] + by_v
            by[1] = by_a if by[1] is None else by[1] + by_a
        for basis, part in zip(self.basis[1:], by):
            if part is not None:
                gradient += basis.T @ part
        return self.weight * value, self.weight * gradient

    def _state(self, parameters: Array) -> tuple[MotionState, Array]:
        q, v, a = (basis @ parameters for basis in self.basis[:3])
        v = settled(v)
        jerk = a if self.metric.needs_torque else self.basis[3] @ parameters
        return MotionState(v, a, jerk, self.chain.torque_nm(q, v, a)), q

    def _limited(self, state: MotionState) -> tuple[tuple[Array, Array], ...]:
        robot = self.robot
        return (
            (state.velocity, robot.velocity_limit_rad_s),
            (state.acceleration, robot.acceleration_limit_rad_s2),
            (state.torque, robot.torque_limit_nm),
        )

    def _at_ends(self, parameters: Array) -> tuple[tuple[Array, Array], ...]:
        """Velocity and acceleration at both ends, where midpoints do not look."""
        return (
            (self.ends[0] @ parameters, self.robot.velocity_limit_rad_s),
            (self.ends[1] @ parameters, self.robot.acceleration_limit_rad_s2),
        )
