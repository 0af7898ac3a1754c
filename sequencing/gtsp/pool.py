"""Diverse good tours out of many."""

from __future__ import annotations

from collections.abc import Sequence

from sequencing.gtsp.problem import GtspProblem


def travels(problem: GtspProblem, nodes: Sequence[int]) -> frozenset[tuple[int, int]]:
    """The travels of a tour as a set of (exit node, entry node)."""
    return frozenset((int(u), int(v)) for u, v in problem.edges(nodes))


def diverse(
    problem: GtspProblem, tours: Sequence[tuple[int, ...]], count: int
) -> tuple[tuple[int, ...], ...]:
    """At most `count` of the tours: the first, then always the one with most new travels.

    Ties go to the earlier (better) tour; a tour without a new travel is not taken.
    """
    left = list(dict.fromkeys(tours))
    if not left:
        return ()
    chosen = [left.pop(0)]
    seen = set(travels(problem, chosen[0]))
    while left and len(chosen) < count:
        news = [len(travels(problem, nodes) - seen) for nodes in left]
        at = max(range(len(left)), key=lambda k: (news[k], -k))
        if news[at] == 0:
            break
        chosen.append(left.pop(at))
        seen |= travels(problem, chosen[-1])
    return tuple(chosen)
