"""From stage functions to a nonlinear programme: gather, map, scatter.

Variables, knot by knot: x = (q_0, û_0, q_1, û_1, …, û_{N−1}, q_N, h[, q̇_N]), û = u/u_max. A `Block`
says where the K copies of a stage read and write. Values, gradients, Jacobians and Hessians are
assembled by constant sparse 0/1 matrices: CasADi differentiates nothing here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from dmoc.programme.stages import Stage

Index = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """Positions of the variables of N intervals and n joints."""

    num_intervals: int
    num_joints: int
    end_velocity: bool = False

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.step + 1 + (self.num_joints if self.end_velocity else 0)

    @property
    def step(self) -> int:
        """Position of h."""
        return (2 * self.num_intervals + 1) * self.num_joints

    def last_velocity(self) -> Index:
        """(n,) positions of q̇_N, which is a variable only with `end_velocity`."""
        return self.step + 1 + np.arange(self.num_joints if self.end_velocity else 0)

    def knots(self) -> Index:
        """(N+1, n) positions of q_k."""
        n = self.num_joints
        return np.arange(self.num_intervals + 1)[:, None] * 2 * n + np.arange(n)

    def torques(self) -> Index:
        """(N, n) positions of û_k."""
        return self.knots()[:-1] + self.num_joints

    def intervals(self) -> Index:
        """(3n+1, N) positions of z = (q_k, q_{k+1}, û_k, h) for every interval."""
        q, u = self.knots(), self.torques()
        h = np.full((self.num_intervals, 1), self.step)
        return np.hstack([q[:-1], q[1:], u, h]).T

    def pack(self, q: Any, u: Any, h: float, v_end: Any = 0.0) -> npt.NDArray[np.float64]:
        """x from knots (N+1, n), scaled torques (N, n), step and, if it is there, q̇_N (n,)."""
        x = np.empty(self.size)
        x[self.knots()], x[self.torques()], x[self.step] = q, u, h
        x[self.last_velocity()] = v_end
        return x


@dataclass(frozen=True)
class Block:
    """K copies of a stage: `variables` (L, K), `params` (P,) shared or (P, K), `rows` (m, K).

    `rows` None means that the single row is a term of the objective.
    """

    stage: Stage
    variables: Index
    params: Index
    rows: Index | None

    @property
    def copies(self) -> int:
        """K."""
        return int(self.variables.shape[1])


@dataclass(frozen=True)
class Programme:
    """min f(x, p) subject to bounds on x and g(x, p); oracles as CasADi functions."""

    nlp: ca.Function
    grad_f: ca.Function
    jac_g: ca.Function
    hess_lag: ca.Function
    num_variables: int
    num_rows: int
    num_params: int


def assemble(blocks: list[Block], num_x: int, num_g: int, num_p: int) -> Programme:
    """The programme whose objective and rows are the sums of all blocks."""
    x, p = ca.MX.sym("x", num_x), ca.MX.sym("p", num_p)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", num_g)
    cost: Any = ca.MX(0)
    rows: Any = ca.MX.zeros(num_g)
    grad: Any = ca.MX.zeros(num_x)
    jacs, hesses = [], []
    cost_j: Any = ca.MX(0)
    rows_j: Any = ca.MX.zeros(num_g)
    for block in blocks:
        values = block.stage.parts[0].map(block.copies)
        slopes = block.stage.parts[1].map(block.copies)
        curves = block.stage.parts[2].map(block.copies)
        z, theta = _gather(x, block.variables), _gather(p, block.params, block.copies)
        first = _jacobian_entries(block)
        r = values(z, theta)
        r_j, nonzeros = slopes(z, theta)
        if block.rows is None:
            cost, cost_j = cost + ca.sum2(r), cost_j + ca.sum2(r_j)
            grad += _scatter(first.columns, num_x) @ ca.vec(nonzeros)
            lam = ca.repmat(lam_f, 1, block.copies)
        else:
            place = _scatter(block.rows.T.ravel(), num_g)
            rows, rows_j = rows + place @ ca.vec(r), rows_j + place @ ca.vec(r_j)
            jacs.append((first, ca.vec(nonzeros)))
            lam = _gather(lam_g, block.rows)
        if block.stage.hess_sparsity.nnz() > 0:
            hesses.append((_hessian_entries(block), ca.vec(curves(z, theta, lam))))
    jac = _sparse_sum(jacs, num_g, num_x)
    hess = _sparse_sum(hesses, num_x, num_x)
    return Programme(
        nlp=ca.Function("nlp", [x, p], [cost, rows], ["x", "p"], ["f", "g"]),
        grad_f=ca.Function("nlp_grad_f", [x, p], [cost_j, grad], ["x", "p"], ["f", "grad_f_x"]),
        jac_g=ca.Function("nlp_jac_g", [x, p], [rows_j, jac], ["x", "p"], ["g", "jac_g_x"]),
        hess_lag=ca.Function(
            "nlp_hess_l",
            [x, p, lam_f, lam_g],
            [hess],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
        num_variables=num_x,
        num_rows=num_g,
        num_params=num_p,
    )


@dataclass(frozen=True)
class _Entries:
    """Global (row, column) of every local nonzero of all copies, copy by copy."""

    rows: Index
    columns: Index


def _gather(vector: Any, index: Index, copies: int = 1) -> Any:
    """(m, K) matrix of entries; an index without copies is repeated."""
    if index.ndim == 1:
        return ca.repmat(vector[index.tolist()], 1, copies)
    picked = vector[index.T.ravel().tolist()]
    return ca.reshape(picked, index.shape[0], index.shape[1])


def _jacobian_entries(block: Block) -> _Entries:
    row, column = _triplet(block.stage.jac_sparsity)
    columns = block.variables[column].T.ravel()
    if block.rows is None:
        return _Entries(np.zeros_like(columns), columns)
    return _Entries(block.rows[row].T.ravel(), columns)


def _hessian_entries(block: Block) -> _Entries:
    """Upper triangle: a local pair may come out transposed in the global order."""
    row, column = _triplet(block.stage.hess_sparsity)
    i, j = block.variables[row].T.ravel(), block.variables[column].T.ravel()
    return _Entries(np.minimum(i, j), np.maximum(i, j))


def _triplet(sparsity: ca.Sparsity) -> tuple[Index, Index]:
    row, column = sparsity.get_triplet()
    return np.array(row, dtype=np.int64), np.array(column, dtype=np.int64)


def _scatter(target: Index, size: int) -> ca.DM:
    """Constant (size, len(target)) matrix that adds entry j of a vector to entry target[j]."""
    count = len(target)
    return ca.DM(ca.Sparsity(size, count, list(range(count + 1)), target.tolist()), np.ones(count))


def _sparse_sum(parts: list[tuple[_Entries, Any]], num_rows: int, num_columns: int) -> Any:
    """One sparse matrix from local nonzeros; entries at the same place are added."""
    keys = np.concatenate([e.columns * num_rows + e.rows for e, _ in parts])
    unique, place = np.unique(keys, return_inverse=True)
    column, row = np.divmod(unique, num_rows)
    sparsity = ca.Sparsity.triplet(num_rows, num_columns, row.tolist(), column.tolist())
    nonzeros = _scatter(place, len(unique)) @ ca.vertcat(*[values for _, values in parts])
    return ca.MX(sparsity, ca.densify(nonzeros))
