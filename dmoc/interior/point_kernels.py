r"""Kernels of a primal-dual point: residuals, bounds, steps.

w = (x, s) holds the variables and one slack per limit row, lo ≤ w ≤ up (infinite where there is no
bound), z_lo, z_up ≥ 0 their multipliers, y = (momentum rows, limit rows). The rows are c(x) = 0 and
d(x) − s = 0; limit rows without any bound are idle and left out everywhere. `size` is the length of
x, `equal` the number of momentum rows. `defect` (rows,) holds c and d − s.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit

# Multipliers of bounds stay within this factor of μ/slack.
KEPT_FACTOR = 1e10


@njit
def gather_rows(values, row, target, w, lo, up, size, equal, out):  # type: ignore[no-untyped-def]
    """Objective, Σ|defect| and largest |defect|; `out` becomes the defect, 0 for idle rows.

    `values` are those of all copies of all blocks, `row` their rows (−1 the objective), `target`
    the right-hand side of the momentum rows.
    """
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
def gradients(  # type: ignore[no-untyped-def]
    slopes, y, cost_source, cost_column, source, row, column, grad, pull
):
    """`grad` becomes ∇f; J_dᵀy of the limit rows is added to `pull`. `slopes` are nonzeros."""
    for i in range(grad.shape[0]):
        grad[i] = 0.0
    for i in range(cost_source.shape[0]):
        grad[cost_column[i]] += slopes[cost_source[i]]
    for i in range(source.shape[0]):
        pull[column[i]] += slopes[source[i]] * y[row[i]]


@njit
def measure(  # type: ignore[no-untyped-def]
    grad, pull, y, w, lo, up, z_lo, z_up, fixed, size, equal, mu
):
    """Largest dual residual and |z·slack − μ|, Σ z·slack, Σ|y| + Σz, Σz, number of bounds."""
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
def centring(w, lo, up, z_lo, z_up, sigma, inwards):  # type: ignore[no-untyped-def]
    """`sigma` z_lo/(w − lo) + z_up/(up − w), `inwards` −1/(w − lo) + 1/(up − w)."""
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
    grad, pull, y, defect, sigma, inwards, mu, slopes, source, row, column, size, equal, out
):
    """Gradient of the condensed system, ∇f + Jᵀy + μ·inwards + J_dᵀ(Σ_s r_d + g_s), (size,).

    r_d = d − s and g_s = −y_d + μ·inwards.
    """
    for i in range(size):
        out[i] = grad[i] + pull[i] + mu * inwards[i]
    for i in range(source.shape[0]):
        j = row[i]
        s = size + j - equal
        if sigma[s] > 0.0:
            weight = sigma[s] * defect[j] - y[j] + mu * inwards[s]
            out[column[i]] += slopes[source[i]] * weight


@njit
def complete(  # type: ignore[no-untyped-def]
    defect,
    y,
    w,
    lo,
    up,
    z_lo,
    z_up,
    sigma,
    inwards,
    mu,
    slopes,
    source,
    row,
    column,
    size,
    equal,
    dw,
    dy,
    dz_lo,
    dz_up,
):
    """The rest of a step of which `dw[:size]` and `dy[:equal]` are known: slacks, the multipliers
    of their rows, and those of the bounds."""
    for i in range(size, w.shape[0]):
        dw[i] = 0.0
    for i in range(source.shape[0]):
        s = size + row[i] - equal
        if sigma[s] > 0.0:
            dw[s] += slopes[source[i]] * dw[column[i]]
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
def multiplier_step(z_lo, z_up, dz_lo, dz_up, tau):  # type: ignore[no-untyped-def]
    """The longest step ≤ 1 that keeps the share 1 − τ of every multiplier of a bound."""
    step = 1.0
    for i in range(z_lo.shape[0]):
        if dz_lo[i] < 0.0:
            step = min(step, -tau * z_lo[i] / dz_lo[i])
        if dz_up[i] < 0.0:
            step = min(step, -tau * z_up[i] / dz_up[i])
    return step


@njit
def mean_product_after(  # type: ignore[no-untyped-def]
    w, dw, lo, up, z_lo, z_up, dz_lo, dz_up, step, dual_step
):
    """Mean of z·slack after a step."""
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
