r"""Energy of a whole schedule: tables, starts and overrides in, grid energy and gradient out.

Robot r runs its trajectories in order; trajectory j starts at t_j with override delta_j and the
robot stands still in between. With Q_j from `path_power`, the energy it has drawn up to time t is

    G(t) = sum of finished Q_j(T_j)/delta_j + Q((t - t_j) delta_j)/delta_j + holding,

and step k draws G(t_{k+1}) - G(t_k), summed over the robots of a link. The link's price (see
`dc_link`) is piecewise constant, so dJ/dp = sum_b (price_{b-1} - price_b) dG(t_b)/dp over the few
steps b where it changes: the gradient costs little more than the value.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dmoc.errors import ProblemError
from sequencing.timing.power.along_path import PowerTable
from sequencing.timing.power.dc_link import LinkParams
from sequencing.timing.power.timeline_kernels import (
    cost_batch_kernel,
    cost_kernel,
    drawn_kernel,
    gradient_kernel,
)


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
