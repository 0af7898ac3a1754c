"""Kernels of `timeline`: step energies, their gradient and batches, in numba.

`line` is a `CellTimeline`.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

from dmoc.jit import njit
from sequencing.timing.power.dc_link import price_kernel


@njit(fastmath=True)
def drawn_kernel(line, start, override, scratch, drawn):
    """Fill drawn (L, K) [J]; scratch needs as many entries as the longest table has nodes."""
    coefficients, node, cell_s, duration_s, hold_w, first, link_of, _, total_s, _, _ = line
    steps = drawn.shape[1]
    dt = total_s / steps
    drawn[:, :] = 0.0
    for r in range(first.shape[0] - 1):
        row = drawn[link_of[r]]
        last_j = first[r + 1] - 1
        k = 0  # the step being filled; everything before `t` is accounted for
        t = 0.0
        for j in range(first[r], first[r + 1]):
            delta = override[j]
            power = hold_w[j, 0]
            begin = start[j]
            # Standing still until `begin`: whole steps, then the part of a step.
            while k < steps and (k + 1) * dt <= begin:
                row[k] += power * ((k + 1) * dt - t)
                k += 1
                t = k * dt
            if k < steps and begin > t:
                row[k] += power * (begin - t)
                t = begin
            a, b = node[j], node[j + 1]
            size = b - a
            for i in range(size):
                value = coefficients[4, a + i]
                value = value * delta + coefficients[3, a + i]
                value = value * delta + coefficients[2, a + i]
                value = value * delta + coefficients[1, a + i]
                scratch[i] = (value * delta + coefficients[0, a + i]) / delta
            scale = delta / cell_s[j]
            end = begin + duration_s[j] / delta
            full = int(min(end, total_s) / dt + 1e-9)
            before = 0.0
            for kk in range(k, min(full, steps)):
                x = ((kk + 1) * dt - begin) * scale
                i = int(x)
                if i > size - 2:
                    i = size - 2
                now = scratch[i] + (x - i) * (scratch[i + 1] - scratch[i])
                row[kk] += now - before
                before = now
            if full > k:
                k = full
                t = k * dt
            if k < steps:
                row[k] += scratch[size - 1] - before
            if end > t:
                t = end
            if j == last_j:
                power = hold_w[j, 1]
                while k < steps:
                    row[k] += power * max(0.0, (k + 1) * dt - t)
                    k += 1
                    t = max(t, k * dt)


@njit(fastmath=True)
def gradient_kernel(line, start, override, price, grad):
    """Fill grad (2, S): dJ/d start and dJ/d override, price (L, K) held fixed."""
    coefficients, node, cell_s, duration_s, hold_w, first, link_of, _, total_s, _, _ = line
    steps = price.shape[1]
    dt = total_s / steps
    grad[:, :] = 0.0
    for r in range(first.shape[0] - 1):
        row = price[link_of[r]]
        for b in range(1, steps + 1):
            weight = row[b - 1] - (row[b] if b < steps else 0.0)
            if weight == 0.0:
                continue
            t = b * dt
            for j in range(first[r], first[r + 1]):
                begin = start[j]
                if begin >= t:
                    break
                delta = override[j]
                a = node[j]
                size = node[j + 1] - a
                x = (t - begin) * delta / cell_s[j]
                hold0 = hold_w[j, 0]
                inside = x < size - 1
                i = int(x) if inside else size - 2
                f = x - i if inside else 1.0
                value = 0.0
                slope = 0.0
                rise = 0.0
                power = 1.0
                for m in range(5):
                    c0 = coefficients[m, a + i]
                    c1 = coefficients[m, a + i + 1]
                    cm = c0 + f * (c1 - c0)
                    value += power * cm
                    slope += m * power * cm
                    rise += power * (c1 - c0)
                    power *= delta
                # slope = delta dQ/d delta, value = Q
                by_delta = (slope - value) / (delta * delta)
                if inside:
                    watt = rise / cell_s[j]
                    grad[0, j] += weight * (hold0 - watt)
                    grad[1, j] += weight * (by_delta + watt * (t - begin) / delta)
                else:
                    after = hold_w[j, 1]
                    if j + 1 < first[r + 1]:
                        after = hold_w[j + 1, 0]
                    grad[0, j] += weight * (hold0 - after)
                    grad[1, j] += weight * (by_delta + after * duration_s[j] / (delta * delta))


@njit
def cost_kernel(line, start, override, scratch, drawn, price):
    drawn_kernel(line, start, override, scratch, drawn)
    limits = line.limits
    total = 0.0
    for m in range(drawn.shape[0]):
        total += price_kernel(
            drawn[m], limits[m, 0], limits[m, 1], limits[m, 0], limits[m, 2], price[m]
        )
    return total


@njit
def value_kernel(drawn, low, high, factor):
    w = low
    bought = 0.0
    for k in range(drawn.shape[0]):
        y = w - drawn[k]
        bought += max(0.0, low - y)
        w = min(max(y, low), high)
    return factor * (bought - (w - low))


@njit
def cost_batch_kernel(line, start, override, scratch, drawn, out):
    limits = line.limits
    for p in range(start.shape[0]):
        drawn_kernel(line, start[p], override[p], scratch, drawn)
        total = 0.0
        for m in range(drawn.shape[0]):
            total += value_kernel(drawn[m], limits[m, 0], limits[m, 1], limits[m, 2])
        out[p] = total
