r"""Energy of a whole schedule: tables, starts and overrides in, grid energy and gradient out.

Robot r runs its trajectories in order; trajectory j starts at t_j with override delta_j and the
robot stands still in between. With Q_j from `path_power`, the energy it has drawn up to time t is

    G(t) = sum of finished Q_j(T_j)/delta_j + Q((t - t_j) delta_j)/delta_j + holding,

and step k draws G(t_{k+1}) - G(t_k), summed over the robots of a link. The link's price (see
`dc_link`) is piecewise constant, so dJ/dp = sum_b (price_{b-1} - price_b) dG(t_b)/dp over the few
steps b where it changes: the gradient costs little more than the value.
"""
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dmoc.errors import ProblemError
from dmoc.jit import njit
from sequencing.timing.power.along_path import PowerTable
from sequencing.timing.power.dc_link import LinkParams, price_kernel


class CellTimeline(NamedTuple):
    """R robots with their power tables, flattened for the kernels; S trajectories in all.

    `coefficients` (5, sum of nodes) concatenates the tables; trajectory s owns nodes
    `node[s]:node[s+1]` with cells of `cell_s[s]`, nominal duration `duration_s[s]` and powers at
    rest `hold_w[s]` (start, end); robot r owns trajectories `first[r]:first[r+1]` and hangs on link
    `link_of[r]`; `limits` (L, 3) is W_min, W_max, grid factor of each link.
    """

    coefficients: np.ndarray
    node: np.ndarray
    cell_s: np.ndarray
    duration_s: np.ndarray
    hold_w: np.ndarray
    first: np.ndarray
    link_of: np.ndarray
    limits: np.ndarray
    total_s: float
    steps: int
    longest: int  # nodes of the longest table

    @property
    def num_trajectories(self) -> int:
        """S."""
        return int(self.duration_s.size)

    @property
    def step_s(self) -> float:
        """Length of a link step [s]."""
        return self.total_s / self.steps


def make_timeline(
    robots: Sequence[Sequence[PowerTable]],
    total_s: float,
    links: Sequence[LinkParams],
    link_of: Sequence[int],
    step_s: float = 0.004,
) -> CellTimeline:
    """Collect the tables of each robot's trajectories, in their order, on `links`."""
    if not robots or any(not tables for tables in robots) or len(link_of) != len(robots):
        legal = "at least one trajectory for each robot, one link index for each robot"
        raise ProblemError.of("timeline", "", "robots", str([len(t) for t in robots]), legal)
    tables = [table for robot in robots for table in robot]
    node = np.concatenate([[0], np.cumsum([t.coefficients.shape[1] for t in tables])])
    return CellTimeline(
        coefficients=np.ascontiguousarray(np.hstack([t.coefficients for t in tables])),
        node=node.astype(np.int64),
        cell_s=np.array([t.cell_s for t in tables]),
        duration_s=np.array([t.duration_s for t in tables]),
        hold_w=np.array([[t.hold_start_w, t.hold_end_w] for t in tables]),
        first=np.concatenate([[0], np.cumsum([len(r) for r in robots])]).astype(np.int64),
        link_of=np.asarray(link_of, dtype=np.int64),
        limits=np.array([[k.min_energy_j, k.max_energy_j, k.grid_factor] for k in links]),
        total_s=float(total_s),
        steps=max(1, round(total_s / step_s)),
        longest=int(np.diff(node).max()),
    )


def coarser(line: CellTimeline, times: int) -> CellTimeline:
    """The same schedule problem with steps and table cells about so many times longer.

    Step energies stay exact at the table's nodes; the link's limits are looked at less often.
    """
    columns, counts = [], []
    for a, b in itertools.pairwise(line.node):
        old = np.linspace(0.0, 1.0, b - a)
        new = np.linspace(0.0, 1.0, max(2, round((b - a - 1) / times)) + 1)
        columns.append([np.interp(new, old, row) for row in line.coefficients[:, a:b]])
        counts.append(len(new))
    node = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return line._replace(
        coefficients=np.ascontiguousarray(np.hstack(columns)),
        node=node,
        cell_s=line.duration_s / (np.diff(node) - 1),
        steps=max(1, round(line.steps / times)),
        longest=int(np.diff(node).max()),
    )


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


def _scratch(line: CellTimeline) -> np.ndarray:
    return np.empty(line.longest)


def drawn_j(line: CellTimeline, start_s: np.ndarray, override: np.ndarray) -> np.ndarray:
    """Energy drawn from each link in each step (L, K) [J]."""
    drawn = np.empty((len(line.limits), line.steps))
    start, speed = (np.ascontiguousarray(row, dtype=float) for row in (start_s, override))
    drawn_kernel(line, start, speed, _scratch(line), drawn)
    return drawn


def cost(line: CellTimeline, start_s: np.ndarray, override: np.ndarray) -> float:
    """Grid energy J [J] of one schedule (clip model, end energy credited)."""
    out = cost_batch(line, np.asarray(start_s)[None], np.asarray(override)[None])
    return float(out[0])


def cost_batch(line: CellTimeline, start_s: np.ndarray, override: np.ndarray) -> np.ndarray:
    """J (P,) [J] of P schedules: starts and overrides (P, S)."""
    starts = np.ascontiguousarray(start_s, dtype=float)
    overrides = np.ascontiguousarray(override, dtype=float)
    out = np.empty(len(starts))
    drawn = np.empty((len(line.limits), line.steps))
    cost_batch_kernel(line, starts, overrides, _scratch(line), drawn, out)
    return out


def cost_and_gradient(
    line: CellTimeline, start_s: np.ndarray, override: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """J [J], dJ/d start (S,) [J/s] and dJ/d override (S,) [J]."""
    start = np.ascontiguousarray(start_s, dtype=float)
    speed = np.ascontiguousarray(override, dtype=float)
    drawn = np.empty((len(line.limits), line.steps))
    price = np.empty_like(drawn)
    value = cost_kernel(line, start, speed, _scratch(line), drawn, price)
    grad = np.empty((2, line.num_trajectories))
    gradient_kernel(line, start, speed, price, grad)
    return float(value), grad[0], grad[1]
