"""The fit whose links stay bodies: every pseudo-inertia is U Uᵀ, friction and rotors are >= 0.

A link's ten numbers are its pseudo-inertia J = [[tr(I)/2 1 − I, m c], [m cᵀ, m]], positive definite
for every body with mass. U is upper triangular with a positive diagonal, so ten free numbers a
link reach exactly the possible bodies; the Jacobian is exact. The samples are compressed by QR
first, so an iteration does not see them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, nnls

from dmoc.arrays import Array
from dmoc.identification.terms import TermColumns

_UPPER = ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3))
#: Tie of the numbers that are no link's to their start, against columns without data.
_TIE = 1e-3


def pseudo_inertia(pi: Array) -> Array:
    """J (4, 4) of a link's ten numbers."""
    m, h, (xx, xy, yy, xz, yz, zz) = pi[0], pi[1:4], pi[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    out = np.empty((4, 4))
    out[:3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    out[:3, 3] = out[3, :3] = h
    out[3, 3] = m
    return out


def link_numbers(j: Array) -> Array:
    """The ten numbers (…, 10) of J (…, 4, 4)."""
    s = j[..., :3, :3]
    trace = s[..., 0, 0] + s[..., 1, 1] + s[..., 2, 2]
    columns = [j[..., 3, 3], *(j[..., k, 3] for k in range(3))]
    columns += [trace - s[..., 0, 0], -s[..., 0, 1], trace - s[..., 1, 1]]
    columns += [-s[..., 0, 2], -s[..., 1, 2], trace - s[..., 2, 2]]
    return np.stack(columns, axis=-1)


def repaired(j: Array) -> Array:
    """J with eigenvalues of at least 1e-4 of the mean, so that it is a body's."""
    values, vectors = np.linalg.eigh(j)
    least = 1e-4 * max(float(np.abs(values).mean()), 1e-3)
    return (vectors * np.maximum(values, least)) @ vectors.T


def _root(j: Array) -> Array:
    """Upper triangular U with U Uᵀ = J."""
    return np.asarray(np.linalg.cholesky(j[::-1, ::-1])[::-1, ::-1], dtype=np.float64)


def _coordinates(j: Array) -> Array:
    u = _root(j)
    alpha = np.log(u[3, 3])
    u = u / u[3, 3]
    return np.array([alpha, *np.log(np.diag(u)[:3]), *(u[k] for k in _UPPER)])


def _body(x: Array) -> tuple[Array, Array]:
    """J (4, 4) of ten coordinates and its derivatives (10, 4, 4)."""
    x = np.concatenate([np.clip(x[:4], -40.0, 40.0), x[4:]])  # a wild step must stay a number
    scale = np.exp(x[0])
    u = np.eye(4)
    u[[0, 1, 2], [0, 1, 2]] = np.exp(x[1:4])
    for value, place in zip(x[4:], _UPPER):
        u[place] = value
    u *= scale
    slopes = np.zeros((10, 4, 4))
    slopes[0] = u
    for k in range(3):
        slopes[1 + k, k, k] = u[k, k]
    for k, place in enumerate(_UPPER):
        slopes[4 + k][place] = scale
    half = slopes @ u.T
    return u @ u.T, half + np.swapaxes(half, 1, 2)


@dataclass(frozen=True, eq=False)
class Compressed:
    """Per joint the R of QR of [Y | torque], its number of rows, for any weights."""

    rows: tuple[Array, ...]
    counts: Array

    @staticmethod
    def of(regressor: Array, torque: Array, moving: Array) -> Compressed:
        """From (M, n, p), (M, n), and the mask (M, n) of what counts."""
        found, counts = [], moving.sum(axis=0)
        for j in range(torque.shape[1]):
            keep = moving[:, j] > 0
            stacked = np.column_stack([regressor[keep, j], torque[keep, j]])
            found.append(np.array(np.linalg.qr(stacked, mode="r"), dtype=np.float64))
        return Compressed(tuple(found), counts)

    def weighted(self, sigma: Array) -> tuple[Array, Array]:
        """Rows and right-hand side of all joints, divided by their sigma."""
        whole = np.vstack([row / s for row, s in zip(self.rows, sigma)])
        whole = np.array(np.linalg.qr(whole, mode="r"), dtype=np.float64)
        return whole[:, :-1], whole[:, -1]

    def residual(self, parameters: Array) -> Array:
        """Root mean square of every joint's misfit [N·m]."""
        total = [np.sum((r[:, :-1] @ parameters - r[:, -1]) ** 2) for r in self.rows]
        return np.sqrt(np.array(total) / np.maximum(self.counts, 1.0))


def weighted_least_squares(data: Compressed, passes: int = 3) -> tuple[Array, Array]:
    """Parameters without any rule, and every joint's sigma by it [N·m]: the measure of noise."""
    size = np.array([np.linalg.norm(r[:, -1]) for r in data.rows])
    size = np.maximum(size / np.sqrt(np.maximum(data.counts, 1.0)), 1e-12)
    sigma = size
    parameters: Array = np.zeros(data.rows[0].shape[1] - 1)
    for _ in range(passes):
        matrix, right = data.weighted(sigma)
        parameters = np.array(np.linalg.lstsq(matrix, right, rcond=1e-10)[0], dtype=np.float64)
        spare = np.maximum(data.counts - matrix.shape[1] / len(sigma), 1.0)
        found = data.residual(parameters) * np.sqrt(np.maximum(data.counts, 1.0) / spare)
        sigma = np.maximum(found, 1e-7 * size)
    return parameters, sigma


def friction_first(data: Compressed, sigma: Array, layout: TermColumns, prior: Array) -> Array:
    """Prior links, with everything beside them fitted non-negative (offsets have any sign)."""
    matrix, right = data.weighted(sigma)
    links = layout.num_links
    rest = right - matrix[:, :links] @ prior[:links]
    offset = layout.block("offset")
    own = matrix[:, links:]
    both = np.hstack([own, -matrix[:, offset]])
    ridge = 1e-6 * np.eye(both.shape[1]) * np.linalg.norm(both) / np.sqrt(both.size)
    found = nnls(np.vstack([both, ridge]), np.concatenate([rest, np.zeros(len(ridge))]))[0]
    extra = found[: own.shape[1]]
    extra[offset.start - links : offset.stop - links] -= found[own.shape[1] :]
    return np.concatenate([prior[:links], extra])


@dataclass(frozen=True, eq=False)
class ConsistentFit:
    """Parameters, their covariance for residuals without memory, iterations, whether it ended."""

    parameters: Array
    covariance: Array
    iterations: int
    converged: bool


def fit_consistent(
    data: Compressed,
    sigma: Array,
    layout: TermColumns,
    prior: Array,
    start: Array,
    weight: float,
    memory: Array,
    most: int = 200,
) -> ConsistentFit:
    """Least squares of the whitened rows + weight ‖L⁻¹(J − J₀)L⁻ᵀ‖² over possible bodies.

    `memory` (n,) is how many neighbouring residuals say the same: it widens the covariance only.
    """
    n, links, size = layout.num_joints, layout.num_links, layout.size
    matrix, right = data.weighted(sigma)
    bodies = np.array([repaired(pseudo_inertia(prior[10 * i : 10 * i + 10])) for i in range(n)])
    inverse = np.array([solve_triangular(_root(j), np.eye(4)) for j in bodies])
    root = np.sqrt(weight)
    tie = _TIE / np.maximum(np.abs(start[links:]), 1.0)
    rows = len(matrix)

    def unpack(x: Array) -> tuple[Array, Array, Array]:
        found = [_body(x[10 * i : 10 * i + 10]) for i in range(n)]
        j = np.array([body for body, _ in found])
        parameters = np.concatenate([link_numbers(j).ravel(), x[links:]])
        return parameters, j, np.array([slope for _, slope in found])

    def misfit(x: Array) -> Array:
        parameters, j, _ = unpack(x)
        away = inverse @ (j - bodies) @ np.swapaxes(inverse, 1, 2)
        return np.concatenate(
            [matrix @ parameters - right, root * away.ravel(), tie * (x[links:] - start[links:])]
        )

    def jacobian(x: Array) -> Array:
        _, _, slopes = unpack(x)
        out = np.zeros((rows + 16 * n + size - links, size))
        for i in range(n):
            own = slice(10 * i, 10 * i + 10)
            out[:rows, own] = matrix[:, own] @ link_numbers(slopes[i]).T
            away = inverse[i] @ slopes[i] @ inverse[i].T
            out[rows + 16 * i : rows + 16 * i + 16, own] = root * away.reshape(10, 16).T
        out[:rows, links:] = matrix[:, links:]
        out[rows + 16 * n :, links:] = np.diag(tie)
        return out

    least = np.full(size, -np.inf)
    for name in ("armature", "coulomb", "viscous", "coupling"):
        least[layout.block(name)] = 0.0
    begin = np.concatenate([*(_coordinates(j) for j in bodies), start[links:]])
    begin = np.where(np.isfinite(least), np.maximum(begin, 1e-3), begin)
    found = least_squares(
        misfit,
        begin,
        jacobian,
        bounds=(least, np.full(size, np.inf)),
        method="trf",
        x_scale="jac",
        ftol=1e-9,
        xtol=1e-10,
        gtol=1e-10,
        max_nfev=most,
    )
    parameters = unpack(found.x)[0]
    wide, _ = data.weighted(sigma * np.sqrt(memory))
    # The prior is quadratic in the ten numbers, so the covariance is taken in them.
    hessian = wide.T @ wide
    basis = np.array([pseudo_inertia(row) for row in np.eye(10)])
    for i in range(n):
        own = slice(10 * i, 10 * i + 10)
        away = (inverse[i] @ basis @ inverse[i].T).reshape(10, 16)
        hessian[own, own] += weight * away @ away.T
    hessian[np.arange(links, size), np.arange(links, size)] += tie**2
    scale = 1.0 / np.sqrt(np.diag(hessian))
    covariance = np.linalg.inv(hessian * scale[:, None] * scale) * scale[:, None] * scale
    return ConsistentFit(parameters, covariance, int(found.nfev), bool(found.status > 0))
