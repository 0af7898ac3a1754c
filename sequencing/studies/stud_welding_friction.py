"""Joint friction added to motions that were optimised without it.

The transcription has no friction, so the motions stay and only their price changes: the motor
gives u + f(q̇), and J is an upper bound of what motions made for friction would cost. Poses and
order are chosen anew under that price. Holding still costs the same: that friction carries part
of the load at rest is not counted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmoc.arrays import Array
from dmoc.cost import Cost
from dmoc.drive import DriveParams, drive_from_mapping
from dmoc.motion import Motion
from dmoc.trajectory import JointTrajectory
from sequencing.studies.stud_welding_model import Edges, Model


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

    def close(self) -> None:
        """Nothing of its own to close."""


def with_friction(model: Model, factor: float) -> Model:
    """`model` with `factor` times the friction of its drives in every travel's price."""
    return replace(
        model, name=f"{model.name}, friction × {factor:g}", edges=FrictionEdges(model, factor)
    )
