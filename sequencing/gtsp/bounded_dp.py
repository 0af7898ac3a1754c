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

FIRST_STATES = 200_000
LARGEST_SETS = 63  # clusters in one 64-bit mask
ROUNDS = 40
NG_STEPS, LATER_STEPS = 60, 15
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
    where the search was complete.
    """
    most = min(LARGEST_LAYER, memory_bytes // BYTES_A_STATE) if states is None else states
    best: np.ndarray | None = None
    bound = math.inf
    multipliers: np.ndarray | None = None
    for rooted in rooted_problems(form):
        nodes, low, multipliers = _solve_rooted(rooted, upper - tolerance, most, multipliers)
        if nodes is not None:
            full = np.concatenate([[rooted.root], rooted.node[nodes]])
            cost = math.fsum(form.cost[full, np.roll(full, -1)])
            if cost < upper:
                best, upper = full, cost
        bound = min(bound, low)
    return best, min(bound, upper) if math.isfinite(upper) else bound


def _solve_rooted(
    rooted: Rooted, cut: float, most: int, multipliers: np.ndarray | None
) -> tuple[np.ndarray | None, float, np.ndarray]:
    """(better nodes or None, proven bound, multipliers) of one rooted problem."""
    relaxation = Relaxation(rooted, cut, multipliers)
    relaxation.walk_phase()
    limit = FIRST_STATES
    first = True
    for _ in range(ROUNDS):
        if relaxation.closed:
            return None, cut, relaxation.lam
        relaxation.ng_phase(NG_STEPS if first else LATER_STEPS)
        first = False
        if relaxation.closed:
            return None, cut, relaxation.lam
        if most == 0 or relaxation.m > LARGEST_SETS:
            if most == 0 or not relaxation.enlarge_memory():
                break
            continue
        grown = relaxation.enlarge_memory()
        finished, nodes, _ = search_states(relaxation, min(limit, most) if grown else most)
        if finished:
            if nodes is None:
                return None, cut, relaxation.lam
            total = _rooted_cost(rooted, nodes)
            return nodes, total, relaxation.lam
        if not grown or limit >= most:
            break
        limit *= 3
    return None, min(relaxation.bound, cut), relaxation.lam


def _rooted_cost(rooted: Rooted, nodes: np.ndarray) -> float:
    travel = rooted.cost[nodes[:-1], nodes[1:]]
    return math.fsum([rooted.leave[nodes[0]], *travel, rooted.back[nodes[-1]]])
