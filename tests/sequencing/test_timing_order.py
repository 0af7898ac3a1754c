"""The order level against enumeration."""

from itertools import product

import numpy as np
import pytest

from dmoc.errors import ProblemError
from sequencing.timing.order import align_exact, order_exact, order_search


def random_cost(seed):
    rng = np.random.default_rng(seed)
    known = {}

    def cost(window):
        return known.setdefault(
            window, float(rng.uniform(1, 2) + 0.5 * sum(w is None for w in window))
        )

    return cost


def every_alignment(counts):
    """All sequences of windows, naively."""
    if not any(counts):
        return [()]
    out = []
    for move in product((0, 1), repeat=len(counts)):
        if any(move) and all(c >= m for c, m in zip(counts, move)):
            for rest in every_alignment(tuple(c - m for c, m in zip(counts, move))):
                out.append((move, *rest))
    return out


@pytest.mark.parametrize("seed", range(5))
def test_alignment_equals_enumeration(seed) -> None:
    counts = (2, 3)
    cost = random_cost(seed)
    handovers = [((0, 0), (1, 1))]
    best = np.inf
    for moves in every_alignment(counts):
        at, total, done = [0, 0], 0.0, {}
        for w, move in enumerate(moves):
            total += cost(tuple(a if m else None for a, m in zip(at, move)))
            for r, m in enumerate(move):
                if m:
                    done[r, at[r]] = w
                    at[r] += 1
        if all(done[a] < done[b] for a, b in handovers):
            best = min(best, total)
    found = align_exact(counts, cost, handovers)
    assert found.cost_j == pytest.approx(best)
    assert sum(w[0] is not None for w in found.windows) == 2
    assert sum(w[1] is not None for w in found.windows) == 3


def pair_cost(seed, n):
    table = np.random.default_rng(seed).uniform(0, 1, (n, n))
    return lambda orders: float(sum(table[a, b] for a, b in zip(*orders)))


@pytest.mark.parametrize("seed", range(3))
def test_search_finds_the_enumerated_order(seed) -> None:
    cost = pair_cost(seed, 5)
    _, exact = order_exact((5, 5), cost)
    orders, value = order_search((5, 5), cost, seed)
    assert value == pytest.approx(exact)
    assert cost(orders) == pytest.approx(value)


def test_too_large_cells_are_refused_by_the_exact_methods() -> None:
    with pytest.raises(ProblemError, match="lattice"):
        align_exact((39, 39, 39), lambda w: 1.0)
    with pytest.raises(ProblemError, match="orders"):
        order_exact((13, 13, 13), lambda o: 1.0)
