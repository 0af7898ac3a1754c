"""What must come before what, as a graph: the order that follows, or the circle that forbids one.

networkx is loaded only when a graph is asked for something.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import Any


def in_order(items: Sequence[Any], pairs: Iterable[tuple[Any, Any]]) -> list[Any]:
    """The items, each after all that `pairs` (before, after) put before it; no circle, please."""
    import networkx as nx

    graph = nx.DiGraph(list(pairs))
    graph.add_nodes_from(items)
    return list(nx.topological_sort(graph))


def circle_of(pairs: Iterable[tuple[Hashable, Hashable]]) -> list[Any]:
    """One circle among `pairs` (before, after), its first item again at the end; [] if none.

    A person can only take one pair out of a circle, not out of the set of all items that some
    circle holds up: so one circle is named, in its order.
    """
    import networkx as nx

    try:
        steps = nx.find_cycle(nx.DiGraph(list(pairs)))
    except nx.NetworkXNoCycle:
        return []
    return [steps[0][0], *(after for _, after in steps)]
