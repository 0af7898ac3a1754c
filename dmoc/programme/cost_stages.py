r"""The running cost of one interval as a stage function.

One point of quadrature, the midpoint, does not see how the speed changes within an interval, and an
optimum makes use of that: speeds at the knots that alternate between 0 and twice the mean cost
nothing more. So the rate is averaged over two speeds beside the mean one,

.. math:: \tfrac12 \bigl(c(\bar q, \bar v + \delta, u) + c(\bar q, \bar v - \delta, u)\bigr),
          \qquad \delta = \sqrt\kappa\, h\, a,

with the acceleration a of the equations of motion at the midpoint, M a = u − b(q̄, v̄) (+ Jᵀw). For
c_v vᵀv that is c_v (v̄ᵀv̄ + κ h² aᵀa): κ = 1/12 is the cost of the curve, κ = 1/4 the mean of the
two knot speeds, κ = 0 the published form.

Derivatives are by the chain rule over y = (q, v, δ, u, h), with a′ = M⁻¹(−τ_q, −τ_v, 1) and, for a
pull μ = M⁻¹g on a, the second derivatives g·a″ = −∇²(μᵀτ) − (Dᵀa′ + a′ᵀD), D = ∂(M μ)/∂q. Without
a″ (Gauss–Newton) steps of 0.1 s and more hardly converge.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from dmoc.physics.discrete import midpoint
from dmoc.physics.dynamics import ArmModel, inverse_dynamics, lagrangian_gradients
from dmoc.programme.stages import Stage, expression_stage, local_interval, make_stage
from dmoc.robot.drive import DriveParams, electrical_power_w


class Rate(NamedTuple):
    """A rate `at`(weights, q, v, u) of cost per second, with its number of weights."""

    num_weights: int
    at: Callable[[Any, Any, Any, Any], Any]


def quadratic_rate() -> Rate:
    """c_t + c_e uᵀu + c_v vᵀv; weights (c_t, c_e, c_v)."""
    return Rate(3, lambda w, q, v, u: w[0] + w[1] * ca.sumsqr(u) + w[2] * ca.sumsqr(v))


def matrix_rate(n: int) -> Rate:
    """`quadratic_rate` plus xᵀQx + uᵀRu, x = (q, v); Q and R column by column after its weights."""
    squared = (2 * n) ** 2

    def at(w: Any, q: Any, v: Any, u: Any) -> Any:
        state = ca.reshape(w[3 : 3 + squared], 2 * n, 2 * n)
        effort, x = ca.reshape(w[3 + squared :], n, n), ca.vertcat(q, v)
        return quadratic_rate().at(w, q, v, u) + ca.bilin(state, x, x) + ca.bilin(effort, u, u)

    return Rate(3 + squared + n * n, at)


def electrical_rate(n: int, drive: DriveParams, smoothing_rad_s: float) -> Rate:
    """c_t + c_j P_el + c_v vᵀv; weights (c_t, c_j, c_v).

    P_el [W] is the sum of `electrical_power_w` over the axes, friction smoothed below
    `smoothing_rad_s`.
    """

    def at(w: Any, q: Any, v: Any, u: Any) -> Any:
        power = electrical_power_w(v, ca.SX.zeros(n), u, drive, smoothing_rad_s)
        return w[0] + w[1] * ca.sum1(power) + w[2] * ca.sumsqr(v)

    return Rate(3, at)


def midpoint_cost_stage(n: int, rate: Rate) -> Stage:
    """h times the rate at the midpoint (κ = 0); θ = (weights, u_max n)."""
    z, qa, qb, u, h = local_interval(n)
    weights, u_max = ca.SX.sym("w", rate.num_weights), ca.SX.sym("u_max", n)
    q, v = midpoint(qa, qb, h)
    return expression_stage(
        "cost", z, ca.vertcat(weights, u_max), h * rate.at(weights, q, v, u * u_max)
    )


def spread_cost_stage(arm: ArmModel, rate: Rate, with_wrench: bool) -> Stage:
    """h times the mean rate at v̄ ± √κ h a; θ = (weights, κ, u_max n[, wrench 6])."""
    n = arm.num_joints
    z, qa, qb, scaled, h = local_interval(n)
    weights, kappa = ca.SX.sym("w", rate.num_weights), ca.SX.sym("kappa")
    u_max, root = ca.SX.sym("u_max", n), ca.sqrt(kappa)
    wrench = ca.SX.sym("wrench", 6) if with_wrench else None
    theta = ca.vertcat(weights, kappa, u_max)
    if wrench is not None:
        theta = ca.vertcat(theta, wrench)
    q, v, u, a, delta, pull = (ca.SX.sym(s, n) for s in ("q", "v", "u", "a", "delta", "pull"))

    inertia = _Inertia(ca.jacobian(lagrangian_gradients(arm, q, v)[0], v))
    bias = inverse_dynamics(arm, q, v, ca.SX.zeros(n), wrench)
    acceleration = inertia.solve(u - bias)
    torque = inverse_dynamics(arm, q, v, a, wrench)
    mean = (rate.at(weights, q, v + delta, u) + rate.at(weights, q, v - delta, u)) / 2

    def in_local(*expressions: Any) -> Any:
        known = ca.substitute(list(expressions), [delta], [root * h * a])
        known = ca.substitute(known, [a], [acceleration])
        return ca.substitute(known, [q, v, u], [*midpoint(qa, qb, h), scaled * u_max])

    by_delta = ca.gradient(mean, delta)
    # δ = √κ h M⁻¹(u − b): its pull on the cost through q, v and u.
    pulled = inertia.solve(root * h * by_delta)
    by_qv = ca.substitute(ca.gradient(ca.dot(pull, torque), ca.vertcat(q, v)), pull, pulled)
    by_q = ca.gradient(mean, q) - by_qv[:n]
    by_v = ca.gradient(mean, v) - by_qv[n:]
    by_h = mean + h * root * ca.dot(by_delta, a) - ca.dot(by_v, v)
    by_u = h * u_max * (ca.gradient(mean, u) + pulled)
    jac = ca.horzcat((h / 2 * by_q - by_v).T, (h / 2 * by_q + by_v).T, by_u.T, by_h)

    lam, one, none, zero = ca.SX.sym("lam"), ca.DM.eye(n), ca.DM(n, n), ca.DM(n, 1)
    last = ca.DM([0.0] * (3 * n) + [1.0])
    tangent = inertia.solve(-ca.jacobian(torque, ca.vertcat(q, v)))
    aq, av = tangent[:, :n], tangent[:, n:]
    slope = root * ca.horzcat(
        aq / 2 - av / h, aq / 2 + av / h, inertia.inverse() * ca.repmat(u_max.T, n, 1), -av @ v / h
    )
    chain = ca.vertcat(
        ca.horzcat(one / 2, one / 2, none, zero),
        ca.horzcat(-one / h, one / h, none, -v / h),
        h * slope + root * a @ last.T,
        ca.horzcat(none, none, ca.diag(u_max), zero),
        last.T,
    )
    curvature, gradient = ca.hessian(h * mean, ca.vertcat(q, v, delta, u, h))
    # Second derivatives of v = (q⁺ − q)/h, of the factor h in δ = √κ h a, and of a itself.
    gv, gd = h * by_v, gradient[2 * n : 3 * n]
    mixed = ca.vertcat(gv / h**2, -gv / h**2, zero, ca.dot(gv, v) / h**2) + slope.T @ gd
    bends, turn = _bends(arm, q, v, torque, pull)
    turn = ca.horzcat(turn / 2, turn / 2, none, zero).T @ (slope / root)
    both = chain[: 2 * n, :].T @ bends @ chain[: 2 * n, :] + turn + turn.T
    hess = chain.T @ curvature @ chain + mixed @ last.T + last @ mixed.T
    hess = lam * ca.triu(hess - ca.substitute(both, pull, h * pulled))
    rows, jac, hess = in_local(h * mean, jac, hess)
    return make_stage("cost", z, theta, lam, rows, jac, hess)


def _bends(arm: ArmModel, q: Any, v: Any, torque: Any, pull: Any) -> tuple[Any, Any]:
    """∇²(μᵀτ) (2n, 2n) by (q, v) and ∂(M μ)/∂q (n, n) for μ = `pull`."""
    by_q, by_v = (ca.gradient(ca.dot(pull, torque), x) for x in (q, v))
    qq, vq, vv = ca.jacobian(by_q, q), ca.jacobian(by_v, q), ca.jacobian(by_v, v)
    qq = ca.triu(qq) + ca.triu(qq, False).T
    momentum = lagrangian_gradients(arm, q, pull)[0]
    return ca.vertcat(ca.horzcat(qq, vq.T), ca.horzcat(vq, vv)), ca.jacobian(momentum, q)


class _Inertia:
    """L D Lᵀ of a symmetric positive definite SX matrix."""

    def __init__(self, matrix: Any) -> None:
        n = matrix.shape[0]
        self._lower: list[list[Any]] = [[None] * n for _ in range(n)]
        self._diagonal: list[Any] = []
        for j in range(n):
            left, d = self._lower, self._diagonal
            d.append(matrix[j, j] - sum(left[j][k] ** 2 * d[k] for k in range(j)))
            for i in range(j + 1, n):
                rest = sum(left[i][k] * left[j][k] * d[k] for k in range(j))
                left[i][j] = (matrix[i, j] - rest) / d[j]

    def solve(self, right: Any) -> Any:
        """M⁻¹ times the columns of `right`."""
        n, x = len(self._diagonal), [right[i, :] for i in range(right.shape[0])]
        for i in range(n):
            for k in range(i):
                x[i] = x[i] - self._lower[i][k] * x[k]
        x = [row / d for row, d in zip(x, self._diagonal)]
        for i in reversed(range(n)):
            for k in range(i + 1, n):
                x[i] = x[i] - self._lower[k][i] * x[k]
        return ca.vertcat(*x)

    def inverse(self) -> Any:
        """M⁻¹."""
        return self.solve(ca.SX.eye(len(self._diagonal)))
