r"""Timing variables in a box: any point of [0, 1]^{2S} is a schedule that keeps the total time.

Trajectory k of nominal duration T_k must follow its predecessors (the robot's own order and the
hand-overs) and be over by its latest finish L_k = min over successors s of (L_s - T_s), or the
total time. With e_k the latest end of its predecessors, the slack A_k = L_k - e_k - T_k is never
negative, and

    D_k = T_k + x_k min(A_k, (1/delta_min - 1) T_k),   wait_k = y_k (A_k + T_k - D_k),
    start_k = e_k + wait_k,   delta_k = T_k / D_k.

For one trajectory per robot this is the window problem D = T_0 + x (T_c - T_0),
wait = y (T_c - D); the critical robot has no slack, so it is fixed by itself. The DTO paper's
delay limit (Eq. 8) is the same set written in delta, with the division it is missing.
"""

# mypy: disallow-untyped-defs=False

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dmoc.errors import ProblemError
from dmoc.jit import njit
from sequencing.timing.cell.types import predecessors, waiting_order
from sequencing.timing.power.along_path import MIN_OVERRIDE


class SlackGraph(NamedTuple):
    """S trajectories with precedence; see `slack_graph`.

    `order` is topological; the predecessors of k are `pred[pred_at[k]:pred_at[k+1]]`, and
    `lag_s` beside it how long after the predecessor's end k may start; `latest_s` is L_k.
    Frozen trajectories (`fixed`) keep `fixed_start_s` and `fixed_length_s` whatever z says.
    """

    duration_s: np.ndarray
    order: np.ndarray
    pred_at: np.ndarray
    pred: np.ndarray
    lag_s: np.ndarray
    latest_s: np.ndarray
    fixed: np.ndarray
    fixed_start_s: np.ndarray
    fixed_length_s: np.ndarray
    total_s: float

    @property
    def free(self) -> np.ndarray:
        """Indices of trajectories that are not frozen."""
        return np.flatnonzero(~self.fixed)


def slack_graph(
    robots: Sequence[Sequence[float]],
    handovers: Sequence[tuple[int, int]] = (),
    total_s: float | None = None,
    fixed: dict[int, tuple[float, float]] | None = None,
    pause_s: Sequence[Sequence[float]] | None = None,
) -> SlackGraph:
    """Graph of nominal durations per robot, hand-overs (from, to) by flat index, and total time.

    `total_s` None means the shortest possible: every trajectory as soon and as fast as it can.
    `pause_s` is the least time each robot stands still after each trajectory (a weld, a grip); a
    hand-over waits for it too. `fixed` maps an index to its (start_s, length_s). Raises
    `ProblemError` if hand-overs form a circle or the total time is too short, naming both times.
    """
    durations = np.array([t for robot in robots for t in robot], dtype=float)
    size = durations.size
    preds = predecessors([len(robot) for robot in robots], handovers)
    pause = np.zeros(size)
    if pause_s is not None:
        pause[:] = [t for robot in pause_s for t in robot]
    order = waiting_order(preds)
    held = fixed or {}
    end = np.zeros(size)
    for k in order:
        start = max((end[p] + pause[p] for p in preds[k]), default=0.0)
        end[k] = sum(held[k]) if k in held else start + durations[k]
    needed = float((end + pause).max(initial=0.0))
    total = needed if total_s is None else float(total_s)
    if total < needed - 1e-9:
        raise ProblemError.of(
            "total-time",
            "",
            "total_s",
            f"{total:.6g} s",
            f">= {needed:.6g} s",
            "allow the time that the trajectories need at full speed",
        )
    latest = max(total, needed) - pause
    for k in order[::-1]:
        begin = held[k][0] if k in held else latest[k] - durations[k]
        for p in preds[k]:
            latest[p] = min(latest[p], begin - pause[p])
    mask = np.zeros(size, dtype=np.bool_)
    start_s, length_s = np.zeros(size), durations.copy()
    for k, (begin, length) in held.items():
        mask[k], start_s[k], length_s[k] = True, begin, length
    pred_at = np.concatenate([[0], np.cumsum([len(p) for p in preds])]).astype(np.int64)
    flat = np.array([p for row in preds for p in row], dtype=np.int64)
    return SlackGraph(
        durations,
        np.array(order, dtype=np.int64),
        pred_at,
        flat,
        pause[flat],
        latest,
        mask,
        start_s,
        length_s,
        max(total, needed),
    )


_STRETCH = 1.0 / MIN_OVERRIDE - 1.0


@njit
def decode_kernel(graph, points, outs):
    """Points (P, 2, S) in [0, 1] to outs (P, 2, S): start [s] and override."""
    duration, order, pred_at, pred, lag, latest, fixed, fix_start, fix_length, _ = graph
    for i in range(points.shape[0]):
        z, out = points[i], outs[i]
        for k in order:
            if fixed[k]:
                out[0, k] = fix_start[k]
                out[1, k] = duration[k] / fix_length[k]
                continue
            early = 0.0
            for m in range(pred_at[k], pred_at[k + 1]):
                p = pred[m]
                early = max(early, out[0, p] + duration[p] / out[1, p] + lag[m])
            slack = max(0.0, latest[k] - early - duration[k])
            longer = z[0, k] * min(slack, _STRETCH * duration[k])
            out[0, k] = early + z[1, k] * (slack - longer)
            out[1, k] = duration[k] / (duration[k] + longer)


@njit
def pull_back_kernel(graph, z, timing, by_timing, grad):
    """Chain rule from (dJ/d start, dJ/d override) to dJ/dz, both (2, S)."""
    duration, order, pred_at, pred, lag, latest, fixed, _, _, _ = graph
    by_end = np.zeros(duration.shape[0])
    for index in range(order.shape[0] - 1, -1, -1):
        k = order[index]
        grad[0, k] = 0.0
        grad[1, k] = 0.0
        if fixed[k]:
            continue
        early = 0.0
        last = -1
        for m in range(pred_at[k], pred_at[k + 1]):
            p = pred[m]
            end = timing[0, p] + duration[p] / timing[1, p] + lag[m]
            if end > early:
                early = end
                last = p
        slack = max(0.0, latest[k] - early - duration[k])
        cap = _STRETCH * duration[k]
        room = min(slack, cap)
        x, y = z[0, k], z[1, k]
        length = duration[k] / timing[1, k]
        by_length = -by_timing[1, k] * duration[k] / (length * length) + by_end[k]
        by_start = by_timing[0, k] + by_end[k]
        by_longer = by_length - y * by_start
        grad[0, k] = by_longer * room
        grad[1, k] = by_start * (slack - x * room)
        by_slack = y * by_start
        if slack < cap:
            by_slack += x * by_longer
        if last >= 0:
            by_end[last] += by_start - (by_slack if slack > 0.0 else 0.0)


def decode(graph: SlackGraph, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start [s] and override (S,) of z (2, S)."""
    out = decode_batch(graph, np.asarray(z, dtype=float)[None])
    return out[0, 0], out[0, 1]


def decode_batch(graph: SlackGraph, z: np.ndarray) -> np.ndarray:
    """(P, 2, S) starts and overrides of P points z (P, 2, S)."""
    points = np.ascontiguousarray(z, dtype=float)
    out = np.empty_like(points)
    decode_kernel(graph, points, out)
    return out


def pull_back(
    graph: SlackGraph, z: np.ndarray, timing: np.ndarray, by_timing: np.ndarray
) -> np.ndarray:
    """dJ/dz (2, S) from dJ/d(start, override) (2, S) at `timing` = decode(z)."""
    grad = np.empty_like(timing)
    pull_back_kernel(graph, z, timing, by_timing, grad)
    return grad


def encode(graph: SlackGraph, start_s: np.ndarray, override: np.ndarray) -> np.ndarray:
    """z (2, S) of a schedule that keeps the order, the hand-overs and the total time."""
    z = np.zeros((2, graph.duration_s.size))
    end = start_s + graph.duration_s / override
    for k in graph.order:
        early = 0.0
        for m in range(graph.pred_at[k], graph.pred_at[k + 1]):
            early = max(early, end[graph.pred[m]] + graph.lag_s[m])
        slack = max(0.0, graph.latest_s[k] - early - graph.duration_s[k])
        room = min(slack, _STRETCH * graph.duration_s[k])
        longer = graph.duration_s[k] / override[k] - graph.duration_s[k]
        rest = slack - longer
        if room > 1e-12:
            z[0, k] = min(1.0, max(0.0, longer / room))
        if rest > 1e-12:
            z[1, k] = min(1.0, max(0.0, (start_s[k] - early) / rest))
    return z
