"""Orders and circles against their definition, on random graphs."""

from itertools import pairwise

import numpy as np
import pytest

from dmoc.errors import ProblemError
from dmoc.order_graph import circle_of, in_order
from sequencing.gtsp import GtspProblem
from sequencing.timing.cell.types import waiting_order


@pytest.mark.parametrize("seed", range(40))
def test_an_order_or_a_circle_but_never_both(seed: int) -> None:
    draw = np.random.default_rng(seed)
    pairs = [(int(a), int(b)) for a, b in draw.integers(0, 9, (draw.integers(4, 14), 2))]
    circle = circle_of(pairs)
    if circle:
        assert circle[0] == circle[-1]
        assert len(set(circle)) == len(circle) - 1
        assert set(pairwise(circle)) <= set(pairs)
        return
    order = in_order(range(9), pairs)
    assert sorted(order) == list(range(9))
    assert all(order.index(a) < order.index(b) for a, b in pairs)


def test_the_circle_is_named_in_its_order_and_nothing_that_only_hangs_on_it() -> None:
    pairs = [(3, 0), (0, 1), (1, 2), (2, 0), (2, 4)]
    cost = np.ones((5, 5))
    with pytest.raises(ProblemError, match="clusters 0 -> 1 -> 2 -> 0"):
        GtspProblem(cost, np.arange(5), precedence=pairs)
    names = ["left/0", "left/1", "right/0", "right/1"]
    with pytest.raises(ProblemError, match="right/0 -> left/0 -> left/1 -> right/0"):
        waiting_order([[2], [0], [1], [2]], names)
