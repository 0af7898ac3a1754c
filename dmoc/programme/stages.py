"""Stage functions: the small functions of one interval that every programme is mapped from.

A `Stage` holds three CasADi functions of local variables z (L, 1) and parameters θ (P, 1):

    rows(z, θ) → r (m, 1);  jac(z, θ) → (r, nonzeros of ∂r/∂z);
    hess(z, θ, λ) → nonzeros of the upper triangle of ∂²(λᵀr)/∂z².

Nothing in them depends on N, on boundary states or on boxes, so one compiled library serves every
problem of a robot and cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from dmoc.physics.discrete import del_rows, del_rows_hessian, del_rows_jacobian, midpoint
from dmoc.physics.dynamics import ArmModel


@dataclass(frozen=True)
class Stage:
    """One family of rows; `parts` are rows, jac, hess in that order."""

    name: str
    parts: tuple[ca.Function, ca.Function, ca.Function]
    jac_sparsity: ca.Sparsity
    hess_sparsity: ca.Sparsity

    @property
    def num_rows(self) -> int:
        """m."""
        return int(self.jac_sparsity.size1())

    @property
    def num_local(self) -> int:
        """L."""
        return int(self.jac_sparsity.size2())

    @property
    def num_params(self) -> int:
        """P."""
        return int(self.parts[0].size1_in(1))


def make_stage(name: str, z: Any, theta: Any, lam: Any, rows: Any, jac: Any, hess: Any) -> Stage:
    """A stage from SX expressions of its rows and their derivatives."""
    rows = ca.densify(rows)
    hess = ca.triu(hess)
    options = {"cse": True}
    parts = (
        ca.Function(f"{name}_rows", [z, theta], [rows], options),
        ca.Function(f"{name}_jac", [z, theta], [rows, _nonzeros(jac)], options),
        ca.Function(f"{name}_hess", [z, theta, lam], [_nonzeros(hess)], options),
    )
    return Stage(name, parts, jac.sparsity(), hess.sparsity())


def _nonzeros(matrix: Any) -> Any:
    return ca.SX(0, 1) if matrix.nnz() == 0 else ca.vertcat(*matrix.nonzeros())


def expression_stage(name: str, z: Any, theta: Any, rows: Any) -> Stage:
    """A stage from SX expressions, derivatives by CasADi."""
    rows = ca.densify(rows)
    lam = ca.SX.sym("lam", rows.size1())
    hess = ca.hessian(ca.dot(lam, rows), z)[0]
    return make_stage(name, z, theta, lam, rows, ca.jacobian(rows, z), hess)


def local_interval(n: int) -> tuple[Any, Any, Any, Any, Any]:
    """Symbols z = (qa, qb, u/u_max, h) of one interval and its four parts."""
    qa, qb, u = (ca.SX.sym(name, n) for name in ("qa", "qb", "u"))
    h = ca.SX.sym("h")
    return ca.vertcat(qa, qb, u, h), qa, qb, u, h


def dynamics_stage(arm: ArmModel, with_wrench: bool) -> Stage:
    """Both momentum rows of an interval (2n); θ = (row scale n, u_max n[, wrench 6])."""
    n = arm.num_joints
    z, qa, qb, u, h = local_interval(n)
    scale, u_max = ca.SX.sym("scale", n), ca.SX.sym("u_max", n)
    wrench = ca.SX.sym("wrench", 6) if with_wrench else None
    theta = ca.vertcat(scale, u_max)
    if wrench is not None:
        theta = ca.vertcat(theta, wrench)
    lam, q, v = ca.SX.sym("lam", 2 * n), ca.SX.sym("q", n), ca.SX.sym("v", n)
    rows = del_rows(arm, qa, qb, u * u_max, h, scale, wrench)
    jac = del_rows_jacobian(arm, u * u_max, u_max, h, scale, q, v, wrench)
    hess = del_rows_hessian(arm, u_max, h, scale, lam, q, v, wrench)
    at = midpoint(qa, qb, h)
    jac, hess = ca.substitute([jac, hess], [q, v], list(at))
    return make_stage("dynamics", z, theta, lam, rows, jac, hess)
