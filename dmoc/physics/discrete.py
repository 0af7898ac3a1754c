r"""Midpoint discrete Lagrangian and the forced discrete Euler–Lagrange equations.

With L_d(q, q⁺) = h L((q + q⁺)/2, (q⁺ − q)/h), momentum p = ∂L/∂q̇ and force f = ∂L/∂q at the
midpoint, and the discrete force (h/2) u on either side of an interval,

.. math:: r^-_k = D_1 L_d(q_k, q_{k+1}) + \tfrac h2 u_k = \tfrac h2 (f + u) - p, \qquad
          r^+_k = D_2 L_d(q_k, q_{k+1}) + \tfrac h2 u_k = \tfrac h2 (f + u) + p .

The equations of motion are r⁺_{k−1} + r⁻_k = 0 for k = 1..N−1; the discrete Legendre transforms
p_0 = −r⁻_0 and p_N = r⁺_{N−1} are the boundary conditions on the end velocities.

Source: Björkenstam et al., section 2.3 (with the sign of d/dt ∂L/∂q̇ and the index of q̇_N mended).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from dmoc.physics.dynamics import ArmModel, lagrangian_gradients


def midpoint(qa: Any, qb: Any, h: Any) -> tuple[Any, Any]:
    """(q, v) = ((qa + qb)/2, (qb − qa)/h) of one interval."""
    return (qa + qb) / 2, (qb - qa) / h


def del_rows(
    arm: ArmModel, qa: Any, qb: Any, u: Any, h: Any, scale: Any, wrench: Any = None
) -> Any:
    """(r⁻, r⁺) of one interval, each row times `scale` (n, 1): a column (2n, 1).

    `qa`, `qb` [rad], `u` [N·m] (n, 1), `h` [s]; unscaled rows are momenta [N·m·s].
    """
    q, v = midpoint(qa, qb, h)
    p, f = lagrangian_gradients(arm, q, v, wrench)
    push = h / 2 * (f + u)
    return ca.vertcat(scale * (push - p), scale * (push + p))


def del_rows_jacobian(
    arm: ArmModel, u: Any, u_max: Any, h: Any, scale: Any, q: Any, v: Any, wrench: Any = None
) -> Any:
    """Jacobian (2n, 3n+1) of `del_rows` by (qa, qb, u/u_max, h), by the chain rule.

    `q`, `v` are *symbols* for midpoint position and velocity; only 2n directions are
    differentiated, and the rest is products.
    """
    n = arm.num_joints
    p, f = lagrangian_gradients(arm, q, v, wrench)
    jac = ca.jacobian(ca.vertcat(p, f), ca.vertcat(q, v))
    pq, pv, fq, fv = jac[:n, :n], jac[:n, n:], jac[n:, :n], jac[n:, n:]
    by_u = ca.diag(scale * u_max) * (h / 2)
    out = []
    for side in (-1, 1):
        by_q = h / 4 * fq + side * pq / 2
        by_v = fv / 2 + side * pv / h
        rate = (f + u) / 2 - ca.mtimes(by_v, v)
        rows = ca.horzcat(by_q - by_v, by_q + by_v, ca.DM.zeros(n, n), rate)
        out.append(ca.diag(scale) @ rows + ca.horzcat(ca.DM(n, 2 * n), by_u, ca.DM(n, 1)))
    return ca.vertcat(*out)


def del_rows_hessian(
    arm: ArmModel, u_max: Any, h: Any, scale: Any, lam: Any, q: Any, v: Any, wrench: Any = None
) -> Any:
    """Hessian (3n+1, 3n+1) of λᵀ `del_rows` by (qa, qb, u/u_max, h).

    λ = (λ⁻, λ⁺) (2n, 1). With a = s(λ⁻ + λ⁺) and b = s(λ⁺ − λ⁻) the function is
    (h/2) a·(f(q, v) + u) + b·p(q, v): one Hessian by the 2n symbols (q, v), then products.
    """
    n = arm.num_joints
    a, b = scale * (lam[:n] + lam[n:]), scale * (lam[n:] - lam[:n])
    p, f = lagrangian_gradients(arm, q, v, wrench)
    alpha, beta = ca.dot(a, f), ca.dot(b, p)
    y = ca.vertcat(q, v)
    hess, grad = ca.hessian(h / 2 * alpha + beta, y)
    half = ca.gradient(alpha, y) / 2
    qq, qv, vv = hess[:n, :n] / 4, hess[:n, n:] / (2 * h), hess[n:, n:] / h**2
    aa = qq - qv - qv.T + vv
    ab = qq + qv - qv.T - vv
    bb = qq + qv + qv.T + vv
    rate = half - ca.mtimes(hess[:, n:], v) / h
    rate_v = rate[n:] / h - grad[n:] / h**2
    ah, bh = rate[:n] / 2 - rate_v, rate[:n] / 2 + rate_v
    # dv/dh = −v/h twice, the explicit h once on either side.
    hh = ca.dot(v, ca.mtimes(hess[n:, n:], v)) / h**2 + 2 * ca.dot(grad[n:], v) / h**2
    hh -= 2 * ca.dot(half[n:], v) / h
    uh = a * u_max / 2
    none = ca.DM(n, n)
    return ca.vertcat(
        ca.horzcat(aa, ab, none, ah),
        ca.horzcat(ab.T, bb, none, bh),
        ca.horzcat(none, none, none, uh),
        ca.horzcat(ah.T, bh.T, uh.T, hh),
    )
