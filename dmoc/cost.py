"""What a motion costs: the paper's quadratic cost, and electrical energy."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from dmoc.errors import Fault, ProblemError

__all__ = ["Cost", "ElectricalCost"]


def _require_weights(cost: Cost | ElectricalCost) -> None:
    faults = []
    for item in fields(cost):
        value = getattr(cost, item.name)
        if isinstance(value, (int, float)) and not (math.isfinite(value) and value >= 0):
            faults.append(
                Fault(
                    "cost-weight", field=f"cost.{item.name}", value=repr(value),
                    legal="a finite number >= 0", fix="give a non-negative weight",
                )
            )  # fmt: skip
    if faults:
        raise ProblemError(faults)


@dataclass(frozen=True)
class Cost:
    r"""The paper's composite cost

    .. math:: J = \int_0^T c_t + c_e\, u^T u + c_v\, \dot q^T \dot q \; dt .

    `time` is c_t [1/s], `effort` c_e [1/(N²m²s)], `velocity` c_v [s/rad²]. `torque_smoothing`
    weighs Σ‖(u_k − u_{k−1})/u_max‖², which removes the alternating torque that the discrete
    equations cannot see; it is never part of the reported cost, and 0 gives the paper's form.

    Source: Björkenstam et al., section 3 (weights 1, 1e-6, 1).
    """

    time: float = 1.0
    effort: float = 1e-6
    velocity: float = 1.0
    torque_smoothing: float = 1e-2

    def __post_init__(self) -> None:
        _require_weights(self)

    def holding_rate(self, torque_nm: np.ndarray) -> np.ndarray:
        """Cost per second of standing still with joint torques `torque_nm` (..., n)."""
        torque = np.asarray(torque_nm, dtype=float)
        return self.time + self.effort * np.sum(torque * torque, axis=-1)


@dataclass(frozen=True)
class ElectricalCost:
    r"""Electrical energy of the drives [J] plus a price of time.

    .. math:: J = \int_0^T c_t + c_v\,\dot q^T\dot q + c_j\,P_{el}(\dot q, \ddot q, u) \; dt

    with P_el [W] the loss model of `dmoc.drive` and the robot's drive parameters. `energy` is the
    price of a joule; `time` the price of a second.
    """

    time: float = 1.0
    energy: float = 1.0
    velocity: float = 0.0
    torque_smoothing: float = 1e-2

    def __post_init__(self) -> None:
        _require_weights(self)
