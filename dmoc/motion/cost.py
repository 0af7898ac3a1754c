"""What a motion costs: the paper's quadratic cost, and electrical energy."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from dmoc.errors import Fault, ProblemError

Matrix = tuple[tuple[float, ...], ...]
Transcription = Literal["knots", "curve", "paper"]

#: κ of the discrete cost for every transcription (see `dmoc.cost_stages`).
KAPPA: dict[str, float] = {"knots": 1 / 4, "curve": 1 / 12, "paper": 0.0}


def _semidefinite(values: Any, name: str) -> Matrix:
    """Nested tuples, so that costs stay hashable; the symmetric part is what counts."""
    matrix = np.array(values, dtype=float)
    square = matrix.ndim == 2 and matrix.shape[0] == matrix.shape[1]
    if square and np.all(np.isfinite(matrix)):
        matrix = (matrix + matrix.T) / 2
        if np.linalg.eigvalsh(matrix).min() >= -1e-9 * max(1.0, np.abs(matrix).max()):
            return tuple(tuple(float(x) for x in row) for row in matrix)
    raise ProblemError.of(
        "cost-matrix",
        field=f"cost.{name}",
        value=f"shape {matrix.shape}",
        legal="a square positive semidefinite matrix",
        fix="check signs and size",
    )


def _require_weights(cost: Cost | ElectricalCost) -> None:
    faults = []
    for item in fields(cost):
        value = getattr(cost, item.name)
        if isinstance(value, (int, float)) and not (math.isfinite(value) and value >= 0):
            faults.append(
                Fault(
                    "cost-weight",
                    field=f"cost.{item.name}",
                    value=repr(value),
                    legal="a finite number >= 0",
                    fix="give a non-negative weight",
                )
            )
    if cost.transcription not in KAPPA:
        faults.append(
            Fault(
                "transcription",
                field="cost.transcription",
                value=repr(cost.transcription),
                legal=", ".join(KAPPA),
                fix="leave it out unless you compare with the paper",
            )
        )
    if faults:
        raise ProblemError(faults)


class _Discrete:
    """How a running cost becomes a sum over intervals.

    `transcription` says how the speed within an interval is priced: "knots" by the mean of both
    ends, which leaves no room for an alternating acceleration; "curve" by the integral over the
    executed curve; "paper" at the midpoint alone, the published form, whose optima on light arms
    alternate and cost more than they state. The reported cost is that of the curve (of the midpoint
    for "paper"), whatever was minimised.

    `torque_smoothing` weighs Σ‖(u_k − u_{k−1})/u_max‖², which removes the alternating torque that
    the discrete equations cannot see; it is never part of the reported cost, and 0 leaves it out.
    None means 1e-3 where the price of speed sees the alternation, else 1e-2.
    """

    torque_smoothing: float | None
    transcription: Transcription

    @property
    def _prices_speed(self) -> bool:
        raise NotImplementedError

    @property
    def kappa(self) -> float:
        """κ of the cost that is minimised; 0 where no speed is priced."""
        return KAPPA[self.transcription] if self._prices_speed else 0.0

    @property
    def reported_kappa(self) -> float:
        """κ of the cost that is reported."""
        return min(self.kappa, KAPPA["curve"])

    @property
    def smoothing(self) -> float:
        """The weight of the smoothing term."""
        if self.torque_smoothing is not None:
            return self.torque_smoothing
        return 1e-3 if self.kappa > 0 else 1e-2


@dataclass(frozen=True)
class Cost(_Discrete):
    r"""The paper's composite cost

    .. math:: J = \int_0^T c_t + c_e\, u^T u + c_v\, \dot q^T \dot q \; dt .

    `time` is c_t [1/s], `effort` c_e [1/(N²m²s)], `velocity` c_v [s/rad²]. `torque_smoothing` and
    `transcription` are those of the discrete form; 0 and "paper" give the paper's.

    `state_matrix` Q (2n, 2n) and `torque_matrix` R (n, n), symmetric positive semidefinite, add
    the paper's general x^T Q x + u^T R u with x = (q, q̇).

    Source: Björkenstam et al., section 3 (weights 1, 1e-6, 1).
    """

    time: float = 1.0
    effort: float = 1e-6
    velocity: float = 1.0
    torque_smoothing: float | None = None
    state_matrix: Matrix | None = None
    torque_matrix: Matrix | None = None
    transcription: Transcription = "knots"

    def __post_init__(self) -> None:
        _require_weights(self)
        for name in ("state_matrix", "torque_matrix"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _semidefinite(getattr(self, name), name))

    @property
    def _prices_speed(self) -> bool:
        return self.velocity > 0 or self.state_matrix is not None

    def weights(self, n: int) -> np.ndarray:
        """θ of the cost stage of `n` joints without u_max and wrench; κ last, where it is not 0."""
        values = [np.array([self.time, self.effort, self.velocity])]
        if self.has_matrices:
            for matrix, size in ((self.state_matrix, 2 * n), (self.torque_matrix, n)):
                values.append(np.zeros(size**2) if matrix is None else np.ravel(matrix))
        return np.concatenate([*values, [self.kappa] if self.kappa else []])

    @property
    def has_matrices(self) -> bool:
        """Whether Q or R is there."""
        return self.state_matrix is not None or self.torque_matrix is not None

    def matrix_rate(self, q_rad: np.ndarray, v: np.ndarray, torque_nm: np.ndarray) -> np.ndarray:
        """xᵀQx + uᵀRu (K,) for rows of q, q̇, u (K, n); zero without matrices."""
        rate = np.zeros(len(q_rad))
        if self.state_matrix is not None:
            x = np.hstack([q_rad, v])
            rate += np.einsum("ki,ij,kj->k", x, np.array(self.state_matrix), x)
        if self.torque_matrix is not None:
            rate += np.einsum("ki,ij,kj->k", torque_nm, np.array(self.torque_matrix), torque_nm)
        return rate

    def holding_rate(self, torque_nm: np.ndarray) -> np.ndarray:
        """Cost per second of standing still with joint torques `torque_nm` (..., n).

        R counts; a state matrix does not, because the joints are not known here.
        """
        torque = np.asarray(torque_nm, dtype=float)
        rate = self.time + self.effort * np.sum(torque * torque, axis=-1)
        if self.torque_matrix is not None:
            rate = rate + np.sum((torque @ np.array(self.torque_matrix)) * torque, axis=-1)
        return rate


@dataclass(frozen=True)
class ElectricalCost(_Discrete):
    r"""Electrical energy of the drives [J] plus a price of time.

    .. math:: J = \int_0^T c_t + c_v\,\dot q^T\dot q + c_j\,P_{el}(\dot q, \ddot q, u) \; dt

    with P_el [W] the loss model of `robot.drive` and the robot's drive parameters. `energy` is the
    price of a joule; `time` the price of a second. Below `friction_smoothing_rad_s` friction
    changes its sign smoothly, so that derivatives exist (the `smoothing` of
    `electrical_power_w`): smaller is truer and harder to solve.
    """

    time: float = 1.0
    energy: float = 1.0
    velocity: float = 0.0
    torque_smoothing: float | None = None
    friction_smoothing_rad_s: float = 0.05
    transcription: Transcription = "knots"

    def __post_init__(self) -> None:
        _require_weights(self)
        if not self.friction_smoothing_rad_s > 0:
            raise ProblemError.of(
                "cost-weight",
                field="cost.friction_smoothing_rad_s",
                value=repr(self.friction_smoothing_rad_s),
                legal="> 0 rad/s",
                fix="0.02 to 0.1 suits",
            )

    @property
    def _prices_speed(self) -> bool:
        return self.energy > 0 or self.velocity > 0

    def weights(self, n: int) -> np.ndarray:
        """As of `Cost`."""
        prices = [self.time, self.energy, self.velocity]
        return np.array([*prices, self.kappa] if self.kappa else prices)
