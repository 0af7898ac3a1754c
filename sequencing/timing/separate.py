"""A first schedule without collisions where full speed collides: robots wait for each other."""

from __future__ import annotations

import numpy as np

from sequencing.timing.prepared import Geometry, PreparedCell
from sequencing.timing.slack import SlackGraph, slack_graph
from sequencing.timing.strategies import Timing

ROUNDS = 4000


def separated_timing(prepared: PreparedCell, geometry: Geometry, fast: Timing) -> Timing:
    """Full speed; of two trajectories that would meet, the one that begins later waits longer.

    Starting from as-early-as-possible, the earliest meeting is mended first, a tenth of a second
    at a time, and everything after it is pushed back; the process gets as much longer as that
    takes. After `ROUNDS`, or when one wait passes a minute (robots that block each other at rest
    cannot be parted by waiting), `fast` is returned as it was: the caller's check decides.
    """
    cell = prepared.cell
    first = cell.first
    pauses = [robot.pause_s for robot in cell.robots]
    size = first[-1]
    flat = np.array([t for row in cell.durations_s for t in row])
    wait = np.zeros(size)
    graph = slack_graph(cell.durations_s, cell.handovers, None, None, pauses)
    step = 0.1
    for _ in range(ROUNDS):
        start, total = _earliest(graph, flat, wait, pauses)
        timing = Timing(start, np.ones(size), total)
        crossings = geometry.crossings(total)
        meeting = crossings.collisions(start, np.ones(size))
        if geometry.sharpen(meeting):
            continue
        if not meeting:
            return timing
        # The earliest meeting is mended first, by delaying the one that begins later.
        a, b = min(meeting, key=lambda pair: max(start[pair[0]], start[pair[1]]))
        late = a if (start[a], a) > (start[b], b) else b
        wait[late] += step
        if wait[late] > 60.0:
            break
    return fast


def _earliest(
    graph: SlackGraph, flat: np.ndarray, wait: np.ndarray, pauses: list[tuple[float, ...]]
) -> tuple[np.ndarray, float]:
    start = np.zeros(flat.size)
    end = np.zeros(flat.size)
    for k in graph.order:
        early = 0.0
        for m in range(graph.pred_at[k], graph.pred_at[k + 1]):
            early = max(early, end[graph.pred[m]] + graph.lag_s[m])
        start[k] = early + wait[k]
        end[k] = start[k] + flat[k]
    after = np.array([t for row in pauses for t in row])
    return start, float((end + after).max())
