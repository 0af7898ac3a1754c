r"""Kernels of a primal-dual point: residuals, bounds, steps.

The rows are c(x) = 0 and d(x) − s = 0; limit rows without any bound are idle and left out
everywhere. `defect` (rows,) holds c and d − s; `cost` and `limit` are `Entries` of `frames`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dmoc.arrays import Array
from dmoc.jit import njit

# Multipliers of bounds stay within this factor of μ/slack.
KEPT_FACTOR = 1e10


class Point(NamedTuple):
    """w = (x, s), the variables and one slack per limit row, y = (momentum rows, limit rows), and
    z_lo, z_up ≥ 0, the multipliers of the bounds of w; also a step from one point to another."""

    w: Array
    y: Array
    z_lo: Array
    z_up: Array


class FreeBox(NamedTuple):
    """lo ≤ w ≤ up (infinite where there is no bound), `fixed` (size,) variables without a step;
    `size` is the length of x, `equal` the number of momentum rows."""

    lo: Array
    up: Array
    fixed: Array
    size: int
    equal: int


@njit
def gather_rows(values, row, target, w, box, out):  # type: ignore[no-untyped-def]
    """Objective, Σ|defect| and largest |defect|; `out` becomes the defect, 0 for idle rows.

    `values` are those of all copies of all blocks, `row` their rows (−1 the objective), `target`
    the right-hand side of the momentum rows.
    """
    lo, up, _, size, equal = box
    total = 0.0
    for i in range(equal):
        out[i] = -target[i]
    for i in range(equal, out.shape[0]):
        out[i] = -w[size + i - equal]
    for i in range(values.shape[0]):
        if row[i] < 0:
            total += values[i]
        else:
            out[row[i]] += values[i]
    theta, worst = 0.0, 0.0
    for i in range(out.shape[0]):
        if i >= equal:
            s = size + i - equal
            if lo[s] == -np.inf and up[s] == np.inf:
                out[i] = 0.0
        theta += abs(out[i])
        worst = max(worst, abs(out[i]))
    return total, theta, worst


@njit
def gradients(slopes, y, cost, limit, grad, pull):  # type: ignore[no-untyped-def]
    """`grad` becomes ∇f; J_dᵀy of the limit rows is added to `pull`. `slopes` are nonzeros."""
    for i in range(grad.shape[0]):
        grad[i] = 0.0
    for i in range(cost.source.shape[0]):
        grad[cost.column[i]] += slopes[cost.source[i]]
    for i in range(limit.source.shape[0]):
        pull[limit.column[i]] += slopes[limit.source[i]] * y[limit.row[i]]


@njit
def measure(grad, pull, point, box, mu):  # type: ignore[no-untyped-def]
    """Largest dual residual and |z·slack − μ|, Σ z·slack, Σ|y| + Σz, Σz, number of bounds."""
    w, y, z_lo, z_up = point
    lo, up, fixed, size, equal = box
    dual, product, total, sum_y, sum_z = 0.0, 0.0, 0.0, 0.0, 0.0
    bounds = 0
    for i in range(w.shape[0]):
        if i < size:
            value = 0.0 if fixed[i] else grad[i] + pull[i]
        else:
            value = -y[equal + i - size]
        if lo[i] > -np.inf:
            value -= z_lo[i]
            here = z_lo[i] * (w[i] - lo[i])
            product, total = max(product, abs(here - mu)), total + here
            sum_z, bounds = sum_z + z_lo[i], bounds + 1
        if up[i] < np.inf:
            value += z_up[i]
            here = z_up[i] * (up[i] - w[i])
            product, total = max(product, abs(here - mu)), total + here
            sum_z, bounds = sum_z + z_up[i], bounds + 1
        dual = max(dual, abs(value))
    for i in range(y.shape[0]):
        sum_y += abs(y[i])
    return dual, product, total, sum_y + sum_z, sum_z, bounds


@njit
def centring(point, lo, up, sigma, inwards):  # type: ignore[no-untyped-def]
    """`sigma` z_lo/(w − lo) + z_up/(up − w), `inwards` −1/(w − lo) + 1/(up − w)."""
    w, _, z_lo, z_up = point
    for i in range(w.shape[0]):
        sigma[i] = 0.0
        inwards[i] = 0.0
        if lo[i] > -np.inf:
            inverse = 1.0 / (w[i] - lo[i])
            sigma[i] += z_lo[i] * inverse
            inwards[i] -= inverse
        if up[i] < np.inf:
            inverse = 1.0 / (up[i] - w[i])
            sigma[i] += z_up[i] * inverse
            inwards[i] += inverse


@njit
def right_hand_side(  # type: ignore[no-untyped-def]
    grad, pull, y, defect, sigma, inwards, mu, slopes, limit, box, out
):
    """Gradient of the condensed system, ∇f + Jᵀy + μ·inwards + J_dᵀ(Σ_s r_d + g_s), (size,).

    r_d = d − s and g_s = −y_d + μ·inwards.
    """
    for i in range(box.size):
        out[i] = grad[i] + pull[i] + mu * inwards[i]
    for i in range(limit.source.shape[0]):
        j = limit.row[i]
        s = box.size + j - box.equal
        if sigma[s] > 0.0:
            weight = sigma[s] * defect[j] - y[j] + mu * inwards[s]
            out[limit.column[i]] += slopes[limit.source[i]] * weight


@njit
def complete(point, defect, sigma, inwards, mu, slopes, limit, box, step):  # type: ignore[no-untyped-def]
    """The rest of a step whose first `size` w and `equal` y are known: slacks, the multipliers
    of their rows, and those of the bounds."""
    w, y, z_lo, z_up = point
    dw, dy, dz_lo, dz_up = step
    lo, up, _, size, equal = box
    for i in range(size, w.shape[0]):
        dw[i] = 0.0
    for i in range(limit.source.shape[0]):
        s = size + limit.row[i] - equal
        if sigma[s] > 0.0:
            dw[s] += slopes[limit.source[i]] * dw[limit.column[i]]
    for s in range(size, w.shape[0]):
        j = equal + s - size
        dy[j] = 0.0
        if sigma[s] > 0.0:
            dw[s] += defect[j]
            dy[j] = sigma[s] * dw[s] - y[j] + mu * inwards[s]
    for i in range(w.shape[0]):
        dz_lo[i] = 0.0
        dz_up[i] = 0.0
        if lo[i] > -np.inf:
            dz_lo[i] = (mu - z_lo[i] * dw[i]) / (w[i] - lo[i]) - z_lo[i]
        if up[i] < np.inf:
            dz_up[i] = (mu + z_up[i] * dw[i]) / (up[i] - w[i]) - z_up[i]


@njit
def bound_step(w, dw, lo, up, tau):  # type: ignore[no-untyped-def]
    """The longest step ≤ 1 that keeps the share 1 − τ of every slack."""
    step = 1.0
    for i in range(w.shape[0]):
        longest = step
        if dw[i] < 0.0 and lo[i] > -np.inf:
            longest = -tau * (w[i] - lo[i]) / dw[i]
        elif dw[i] > 0.0 and up[i] < np.inf:
            longest = tau * (up[i] - w[i]) / dw[i]
        if longest < step:
            step = longest
    return step


@njit
def multiplier_step(point, step_of, tau):  # type: ignore[no-untyped-def]
    """The longest step ≤ 1 that keeps the share 1 − τ of every multiplier of a bound."""
    _, _, z_lo, z_up = point
    _, _, dz_lo, dz_up = step_of
    step = 1.0
    for i in range(z_lo.shape[0]):
        if dz_lo[i] < 0.0:
            step = min(step, -tau * z_lo[i] / dz_lo[i])
        if dz_up[i] < 0.0:
            step = min(step, -tau * z_up[i] / dz_up[i])
    return step


@njit
def mean_product_after(point, step_of, lo, up, step, dual_step):  # type: ignore[no-untyped-def]
    """Mean of z·slack after a step."""
    w, _, z_lo, z_up = point
    dw, _, dz_lo, dz_up = step_of
    total, bounds = 0.0, 0
    for i in range(w.shape[0]):
        if lo[i] > -np.inf:
            total += (w[i] + step * dw[i] - lo[i]) * (z_lo[i] + dual_step * dz_lo[i])
            bounds += 1
        if up[i] < np.inf:
            total += (up[i] - w[i] - step * dw[i]) * (z_up[i] + dual_step * dz_up[i])
            bounds += 1
    return total / bounds if bounds else 0.0


@njit
def log_slacks(w, lo, up):  # type: ignore[no-untyped-def]
    """Σ log of all slacks; products of a few at a time, for logarithms are slow."""
    logs, product = 0.0, 1.0
    for i in range(w.shape[0]):
        if lo[i] > -np.inf:
            product *= w[i] - lo[i]
        if up[i] < np.inf:
            product *= up[i] - w[i]
        if not 1e-200 < product < 1e200:
            logs, product = logs + np.log(product), 1.0
    return logs + np.log(product)


@njit
def keep_near(w, lo, up, mu, z_lo, z_up):  # type: ignore[no-untyped-def]
    """Multipliers of bounds back to within a factor of μ/slack."""
    for i in range(w.shape[0]):
        if lo[i] > -np.inf:
            centre = mu / (w[i] - lo[i])
            z_lo[i] = min(max(z_lo[i], centre / KEPT_FACTOR), centre * KEPT_FACTOR)
        if up[i] < np.inf:
            centre = mu / (up[i] - w[i])
            z_up[i] = min(max(z_up[i], centre / KEPT_FACTOR), centre * KEPT_FACTOR)


@njit
def push_inside(w, lo, up, push, share):  # type: ignore[no-untyped-def]
    """Move w inside its bounds: by `push`·max(1, |bound|), at most `share` of the range."""
    for i in range(w.shape[0]):
        low, high = lo[i] > -np.inf, up[i] < np.inf
        room = share * (up[i] - lo[i]) if low and high else np.inf
        if low:
            w[i] = max(w[i], lo[i] + min(push * max(1.0, abs(lo[i])), room))
        if high:
            w[i] = min(w[i], up[i] - min(push * max(1.0, abs(up[i])), room))
