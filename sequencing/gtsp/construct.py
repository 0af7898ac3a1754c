"""First tours: an order that keeps the precedences, then random cheapest insertion."""

from __future__ import annotations

import numpy as np

from sequencing.gtsp.arrays import Arrays
from sequencing.gtsp.normal_form import NormalForm


def random_order(form: NormalForm, generator: np.random.Generator) -> np.ndarray:
    """A random order of the clusters that keeps the precedences; the depot first."""
    if not form.ordered:
        rest = generator.permutation(np.arange(1 if form.pinned else 0, form.num_clusters))
        return np.concatenate([[0], rest]) if form.pinned else rest
    waiting = form.before.sum(axis=0)
    out: list[int] = []
    left = set(range(form.num_clusters))
    while left:
        ready = [g for g in sorted(left) if waiting[g] == 0]
        g = 0 if form.pinned and not out else int(generator.choice(ready))
        out.append(g)
        left.remove(g)
        waiting = waiting - form.before[g]
    return np.array(out, dtype=np.int64)


def insertion_tour(arrays: Arrays, generator: np.random.Generator, state: np.ndarray) -> np.ndarray:
    """A tour (M,) of nodes: clusters in random order, each at its cheapest place and node."""
    from sequencing.gtsp.ruin_recreate_kernel import insert_cheapest

    form = arrays.form
    m = form.num_clusters
    sequence = random_order(form, generator)
    order = np.empty(m, dtype=np.int64)
    node = np.empty(m, dtype=np.int64)
    edge = np.zeros(m)
    order[0] = sequence[0]
    node[0] = generator.integers(form.ptr[sequence[0]], form.ptr[sequence[0] + 1])
    for size, g in enumerate(sequence[1:], start=1):
        insert_cheapest(
            form.cost, arrays.turned, arrays.into, arrays.outof, form.ptr, form.before,
            form.ordered, form.pinned, 0.0, state, order, node, edge, size, g,
        )  # fmt: skip
    return node
