"""Edges under other cost weights: the nominal motion stays where it is cheaper.

Every solved motion is a local optimum, and which one is found changes with the weights. Poses,
robot and obstacles are the same, so the nominal motion may be driven under the new weights too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.cost import Cost
from dmoc.motion.motion import Motion
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.drive import DriveParams, drive_from_mapping
from studies.stud_welding.model import Edges, Model


def friction_cost(
    trajectory: JointTrajectory, cost: Cost, drive: DriveParams, factor: float
) -> float:
    r"""What friction adds to J: c_e Σ h (2 uᵀf + fᵀf), f = factor (f_c sgn q̇ + f_v q̇)."""
    step = np.diff(trajectory.t_s)
    speed = np.diff(trajectory.q_rad, axis=0) / step[:, None]
    torque = factor * (drive.coulomb_nm * np.sign(speed) + drive.viscous_nm_s * speed)
    return float(
        cost.effort * (step @ np.sum(2.0 * trajectory.torque_nm * torque + torque**2, axis=1))
    )


class FrictionEdges:
    """The edges of a model with friction in their price; both directions differ."""

    symmetric = False

    def __init__(self, model: Model, factor: float) -> None:
        robot = model.station.robot
        self.inner: Edges = model.edges
        self.seed, self.factor, self.cost = model.edges.seed, factor, model.station.cost
        self.drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
        self.costs: dict[tuple[int, int], float] = {}
        known = np.array(sorted(self.inner.costs), dtype=np.int64).reshape(-1, 2)
        self.evaluate(np.vstack([known, known[:, ::-1]]))

    def evaluate(self, pairs: np.ndarray) -> Array:
        """Cost of the nominal motions with friction (K,)."""
        wanted = [(int(i), int(j)) for i, j in pairs]
        new = sorted(set(wanted) - set(self.costs))
        if new:
            asked = np.array(new, dtype=np.int64)
            base = self.inner.evaluate(asked)
            for pair, value, motion in zip(new, base, self.inner.motions(asked)):
                extra = 0.0
                if np.isfinite(value) and motion.trajectory is not None:
                    extra = friction_cost(motion.trajectory, self.cost, self.drive, self.factor)
                self.costs[pair] = float(value) + extra
        return np.array([self.costs[pair] for pair in wanted])

    def motions(self, pairs: np.ndarray) -> list[Motion]:
        """The nominal motions."""
        return self.inner.motions(pairs)


def with_friction(model: Model, factor: float) -> Model:
    """`model` with `factor` times the friction of its drives in every travel's price."""
    return replace(
        model, name=f"{model.name}, friction × {factor:g}", edges=FrictionEdges(model, factor)
    )


class WeightEdges:
    """The edges of `model`, or those of `nominal` where they cost less under the model's weights.

    Only travels that `nominal` had solved when this was made are compared.
    """

    symmetric = True

    def __init__(self, model: Model, nominal: Model) -> None:
        self.inner: Edges = model.edges
        self.nominal: Edges = nominal.edges
        self.seed = model.edges.seed
        self.before, self.after = _weights(nominal), _weights(model)
        self.costs: dict[tuple[int, int], float] = {}
        self.kept: set[tuple[int, int]] = set()
        self.known = {pair for pair, cost in nominal.edges.costs.items() if np.isfinite(cost)}

    def evaluate(self, pairs: np.ndarray) -> Array:
        """The cheaper of both costs (K,)."""
        wanted = [(min(i, j), max(i, j)) for i, j in pairs.tolist()]
        new = sorted(set(wanted) - set(self.costs))
        if new:
            for pair, value in zip(new, self.inner.evaluate(np.array(new))):
                self.costs[pair] = float(value)
        both = [pair for pair in new if pair in self.known]
        if both:
            for pair, motion in zip(both, self.nominal.motions(np.array(both))):
                price = self.price(motion)
                if price < self.costs[pair]:
                    self.costs[pair] = price
                    self.kept.add(pair)
        return np.array([self.costs[pair] for pair in wanted])

    def price(self, motion: Motion) -> float:
        """The discrete cost of a nominal motion under the new weights."""
        curve = motion.trajectory
        if curve is None:
            return np.inf
        step = np.diff(curve.t_s)
        turned = float(np.sum(np.diff(curve.q_rad, axis=0) ** 2 / step[:, None]))
        more_time = (self.after.time - self.before.time) * curve.duration_s
        return motion.cost + more_time + (self.after.velocity - self.before.velocity) * turned

    def motions(self, pairs: np.ndarray) -> list[Motion]:
        """The motions whose costs `evaluate` says."""
        self.evaluate(pairs)
        own, given = self.inner.motions(pairs), list[Motion]()
        for (i, j), motion in zip(pairs.tolist(), own):
            if (min(i, j), max(i, j)) in self.kept:
                motion = self.nominal.motions(np.array([(i, j)]))[0]
            given.append(motion)
        return given


def _weights(model: Model) -> Cost:
    cost = model.station.cost
    assert isinstance(cost, Cost)
    return cost


def with_nominal_motions(model: Model, nominal: Model) -> Model:
    """`model`, which differs from `nominal` in the weights of time and speed only."""
    return replace(model, edges=WeightEdges(model, nominal))
