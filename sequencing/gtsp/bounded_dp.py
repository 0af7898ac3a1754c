"""Bounded dynamic programming: the default exact method.

With the cost of a good tour as the cut: Lagrangian multipliers on the walk relaxation, then on
ng-route relaxations with growing memories, removal of the nodes and arcs that cannot be in a
better tour, and a search over the (set of clusters, node) states that the bounds leave. Where the
states do not fit into the limit, the answer is the proven lower bound.
"""

from __future__ import annotations

import math

import numpy as np

from sequencing.gtsp.normal_form import NormalForm
from sequencing.gtsp.relaxation import Relaxation
from sequencing.gtsp.rooted import Rooted, rooted_problems
from sequencing.gtsp.state_search import BYTES_A_STATE, search_states

LARGEST_SETS = 63  # clusters in one 64-bit mask
FIRST_STEPS, NG_STEPS, LATER_STEPS = (8, 16), 40, 15
FIRST_STATES = 100_000  # in one layer of the first search
STATES_A_ROW = 20  # later: a search that costs about as much as the next relaxation
LARGEST_LAYER = 8_000_000  # states; some minutes at most


def bounded_dp(
    form: NormalForm,
    upper: float,
    tolerance: float,
    states: int | None,
    memory_bytes: int,
) -> tuple[np.ndarray | None, float]:
    """A tour of the normal form cheaper than `upper` (None: none was found) and a lower bound.

    upper is the cost of a known tour (inf: none); a tour counts as cheaper only by more than
    `tolerance`. states: most states in one layer (0: relaxations only, None: what
    `memory_bytes` allows). The lower bound is proven; it is ≥ min(upper, answer) − tolerance
    where the search was complete. Where one rooted problem stays open, the others are only
    bounded, and only as far as that matters.
    """
    most = min(LARGEST_LAYER, memory_bytes // (2 * BYTES_A_STATE)) if states is None else states
    best: np.ndarray | None = None
    bound = math.inf
    multipliers: np.ndarray | None = None
    for rooted in rooted_problems(form):
        enough = bound if bound < upper - tolerance else math.inf
        nodes, low, multipliers = _solve_rooted(
            rooted, upper - tolerance, most if enough == math.inf else 0, enough, multipliers
        )
        if nodes is not None:
            full = np.concatenate([[rooted.root], rooted.node[nodes]])
            cost = math.fsum(form.cost[full, np.roll(full, -1)])
            if cost < upper:
                best, upper = full, cost
        bound = min(bound, low)
    return best, min(bound, upper) if math.isfinite(upper) else bound


def _solve_rooted(
    rooted: Rooted, cut: float, most: int, enough: float, multipliers: np.ndarray | None
) -> tuple[np.ndarray | None, float, np.ndarray]:
    """(better nodes or None, proven bound, multipliers) of one rooted problem.

    Without states (`most` 0) it ends after the first relaxation, or at a bound of `enough`.
    """
    relaxation = Relaxation(rooted, cut, multipliers)
    relaxation.walk_phase()
    for steps in FIRST_STEPS:  # the first few, with all arcs, are the dearest
        relaxation.ng_phase(steps)
    steps = NG_STEPS
    while not relaxation.closed and relaxation.bound < enough:
        relaxation.ng_phase(steps)
        steps = LATER_STEPS
        if relaxation.closed or most == 0:
            break
        rows = relaxation.rows_a_position
        grown = relaxation.enlarge_memory()
        if relaxation.m <= LARGEST_SETS:
            limit = min(most, max(FIRST_STATES, STATES_A_ROW * rows)) if grown else most
            finished, nodes, _ = search_states(relaxation, limit)
            if finished and nodes is None:
                return None, cut, relaxation.lam
            if finished and nodes is not None:
                return nodes, _rooted_cost(rooted, nodes), relaxation.lam
        if not grown:
            break
    return None, cut if relaxation.closed else min(relaxation.bound, cut), relaxation.lam


def _rooted_cost(rooted: Rooted, nodes: np.ndarray) -> float:
    travel = rooted.cost[nodes[:-1], nodes[1:]]
    return math.fsum([rooted.leave[nodes[0]], *travel, rooted.back[nodes[-1]]])
