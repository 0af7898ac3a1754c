r"""The relaxed running cost on cells of the bearing angles, for a scaled reference torque.

With the reference torque s_l = α_l ĝ_l(x) on the bearing joints, every motion at rest at both ends
has (docs/bounds.md)

.. math:: J \ge \int c_t + c_e (2 s\cdot g - \|s\|^2) + \dot q^T (c_v I - c_e \mathcal L_s M) \dot q
          \; dt, \qquad \mathcal L_s M = s_l \partial_l M + (Ds)^T M + M Ds .

`FieldCells` holds, for every cell of a grid over the joint limits, numbers that bound the
ingredients from below for all angles of the other joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.cost import Cost
from dmoc.robot.robot import Robot
from sequencing.bounds.series import ArmSeries

STEP_RAD = np.deg2rad(5.0)
MOST_CELLS = 48  # along one axis; wide limits get wider cells
_CHUNK = 8


class CellGrid(NamedTuple):
    """A grid over the limits of the bearing joints: `lower` (2,), `step` (2,), `counts` (2,) cells.

    Where the limits allow a full turn, the grid covers one turn and `around` (2,) is true.
    `points` (P, 2) are its nodes, row-major.
    """

    around: npt.NDArray[np.bool_]
    lower: Array
    step: Array
    counts: tuple[int, int]
    points: Array

    def cells(self, nodal: Array) -> Array:
        """Nodal values (P, ...) as the four corners of every cell (4, A, B, ...)."""
        a, b = self.counts
        table = nodal.reshape(a + 1, b + 1, *nodal.shape[1:])
        return np.stack([table[:-1, :-1], table[1:, :-1], table[:-1, 1:], table[1:, 1:]])

    @property
    def share(self) -> Array:
        """h²/8 (2,): times a bound of the second derivative, what interpolation can miss."""
        return self.step**2 / 8


def cell_grid(robot: Robot, bearing: tuple[int, int]) -> CellGrid:
    """Cells of five degrees, wider where the limits are wide."""
    lower, upper = robot.q_lower_rad[list(bearing)], robot.q_upper_rad[list(bearing)]
    around = upper - lower >= 2.0 * np.pi
    upper = np.where(around, lower + 2.0 * np.pi, upper)
    count = np.clip(np.ceil((upper - lower) / STEP_RAD), 1, MOST_CELLS).astype(int)
    axes = [np.linspace(lower[k], upper[k], count[k] + 1) for k in (0, 1)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    shape = (int(count[0]), int(count[1]))
    return CellGrid(around, lower.copy(), (upper - lower) / count, shape, points)


@dataclass(frozen=True)
class LieTerms:
    """L_s M of the unit fields s = ĝ_l e_l on all cells, l = 1, 2.

    `mean` (2, 4, A, B, n, n): averaged over the other angles, at the corners; `open` (2, A, B, n,
    n): bound of what the other angles add; `slack` (2, n, n): what lies between the corners (of
    the mean). `low`, `high` (A, B, 2): range of ĝ on a cell.
    """

    mean: Array
    open: Array
    slack: Array
    low: Array
    high: Array


def lie_terms(series: ArmSeries, grid: CellGrid) -> LieTerms:
    """All ingredients that do not depend on the scale of the reference torque."""
    x, bearing = grid.points, list(series.bearing)
    n = series.mass.shape[-1]
    g, slope = series.mean_gravity(x), series.mean_gravity_slope(x)
    corners = grid.cells(g)
    order = np.abs(series.gravity_k)
    sizes = np.abs(series.gravity)
    missed = sum(grid.share[m] * (order[:, m] ** 2) @ sizes for m in (0, 1))
    low, high = corners.min(axis=0) - missed, corners.max(axis=0) + missed
    wave = np.exp(1j * x @ series.mass_k.T)
    fields = np.zeros((2, len(x), n, n))
    for field in (0, 1):
        fields[field][:, bearing[field], bearing] = slope[:, field, :]
    mean = np.zeros((2, 4, *grid.counts, n, n))
    opened = np.zeros((2, *grid.counts, n, n))
    slack = np.zeros((2, n, n))
    for begin in range(0, len(series.mass), _CHUNK):
        part = series.mass[begin : begin + _CHUNK]
        value = np.einsum("pk,rkij->rpij", wave, part, optimize=True)
        for field in (0, 1):
            rate = 1j * series.mass_k[:, field]
            change = np.einsum("pk,k,rkij->rpij", wave, rate, part, optimize=True)
            product = value @ fields[field]
            lie = g[:, field, None, None] * change + product + np.swapaxes(product, -1, -2)
            between = _between(series, grid, part, field)
            for r in range(len(part)):
                at = grid.cells(lie[r])
                if begin + r == 0:
                    mean[field], slack[field] = at.real, between[r]
                else:
                    opened[field] += np.abs(at).max(axis=0) + between[r]
    return LieTerms(mean, opened, slack, low, high)


def _between(series: ArmSeries, grid: CellGrid, part: np.ndarray, field: int) -> Array:
    """(R, n, n): by how much bilinear interpolation may miss an entry of L_s M inside a cell.

    Σ_m h_m²/8 · sup|∂_m²|, with the sup of a product ab bounded by A₂B₀ + 2A₁B₁ + A₀B₂, where
    A_p = Σ|k_m|^p |a_k| over the harmonics.
    """
    bearing = list(series.bearing)
    sizes = np.abs(part)
    torque = np.abs(series.gravity[:, field])
    total = np.zeros(part.shape[:1] + part.shape[2:])
    for m in (0, 1):
        km, kg = np.abs(series.mass_k[:, m]), np.abs(series.gravity_k[:, m])

        def second(a: list[Array], b: list[Array]) -> Array:
            return a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2]

        value = [np.einsum("k,rkij->rij", km**p, sizes) for p in (0, 1, 2)]
        along = np.abs(series.mass_k[:, field])
        change = [np.einsum("k,rkij->rij", along * km**p, sizes) for p in (0, 1, 2)]
        s = [np.asarray((kg**p) @ torque) for p in (0, 1, 2)]
        here = second(s, change)
        for column, joint in enumerate(bearing):
            slope = [
                np.asarray((np.abs(series.gravity_k[:, column]) * kg**p) @ torque)
                for p in (0, 1, 2)
            ]
            # (M Ds)_{i, joint} = M_{i, l} ∂s_l/∂x_joint, and its transpose.
            extra = second(slope, [v[:, :, bearing[field]] for v in value])
            here[:, :, joint] += extra
            here[:, joint, :] += extra
        total += grid.share[m] * here
    return total


class FieldCells(NamedTuple):
    """The relaxed running cost of one reference torque on all cells.

    rate ≥ c_t + c_e Σ_l [(2α_l − α_l²) ĝ_l² + 2 α_l ĝ_l (g_l − ĝ_l)] + Σ_i d_i q̇_i² + 2 b q̇_a q̇_b
    with `alpha` (2,), `low`, `high` (A, B, 2) the range of ĝ, `diagonal` (A, B, n) lower bounds
    of d, `cross` (A, B) an upper bound of |b| between the bearing joints (a, b).
    """

    alpha: Array
    low: Array
    high: Array
    diagonal: Array
    cross: Array


def field_cells(
    terms: LieTerms,
    cost: Cost,
    alpha: tuple[float, float],
    bearing: tuple[int, int],
    spend: bool = True,
) -> FieldCells:
    """Scale the unit fields by `alpha` and reduce the quadratic form to its diagonal and b.

    2 |a_ij| |v_i| |v_j| ≤ |a_ij| (ρ v_i² + v_j²/ρ) moves couplings to the diagonal, with a ρ that
    asks of each joint in proportion to what it has.
    """
    scale = np.asarray(alpha)
    n = terms.mean.shape[-1]
    mean = cost.velocity * np.eye(n) - cost.effort * np.tensordot(scale, terms.mean, 1)
    loose = cost.effort * np.tensordot(scale, terms.open, 1)
    slack = cost.effort * np.tensordot(scale, terms.slack, 1)
    own = np.einsum("cabii->cabi", mean).min(axis=0)
    own = own - np.einsum("abii->abi", loose) - np.einsum("ii->i", slack)
    off = np.abs(mean).max(axis=0) + slack + loose
    first, second = bearing
    cross = off[..., first, second].copy()
    off[..., first, second] = off[..., second, first] = 0.0
    off[..., range(n), range(n)] = 0.0
    if spend:
        diagonal = _spent(own, off, bearing)
    else:
        has = np.sqrt(np.maximum(own, cost.velocity if cost.velocity > 0 else 1.0))
        diagonal = own - (off * has[..., :, None] / has[..., None, :]).sum(axis=-1)
    return FieldCells(scale, terms.low, terms.high, diagonal, cross)


def _spent(own: Array, off: Array, bearing: tuple[int, int]) -> Array:
    """Diagonals (A, B, n) in which the other joints spend theirs on relieving the bearing ones."""
    n = own.shape[-1]
    others = [j for j in range(n) if j not in bearing]
    diagonal = own.copy()
    for j in others:
        asked = off[..., j].sum(axis=-1)
        has = np.maximum(own[..., j], 0.25)
        for i in range(n):
            # 2 |a| |v_i| |v_j| ≤ |a| (ρ v_i² + v_j²/ρ), ρ = asked / has; other pairs meet twice.
            half = 0.5 if i in others else 1.0
            ratio = np.maximum(asked, 1e-12) / has
            diagonal[..., i] -= half * off[..., i, j] * ratio
            diagonal[..., j] -= half * off[..., i, j] / ratio
    return diagonal
