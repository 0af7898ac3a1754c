"""Which share of the saving comes from poses, from the order, from the motions.

A saving between two sequences that differ in several respects has no natural split: what a part
gives depends on which parts changed before it. The Shapley value takes the mean over all orders of
change; the parts then add up to the saving exactly, and none is favoured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import factorial

from studies.stud_welding.model import Model
from studies.stud_welding.types import Shares
from studies.stud_welding.use import at_full_speed, full_speed_cost, trajectories_of

SAME_MOTIONS = "both sequences with optimal motions (as in Table 2)"
FAST_MOTIONS = "old sequence at full speed along its paths, new one with optimal motions"


def shapley(parts: Sequence[str], cost: Mapping[str, float]) -> dict[str, float]:
    r"""Shapley values of what each part takes off the cost; they sum to cost("") − cost(all).

    `cost` is keyed by the changed parts joined by "+", in the order of `parts`:

    .. math:: s_i = \sum_{S \not\ni i} \frac{|S|!\,(n-|S|-1)!}{n!}
              \bigl(c(S) - c(S \cup i)\bigr)

    Source: Shapley (1953), A value for n-person games.
    """
    n = len(parts)
    values = {}
    for part in parts:
        others = [name for name in parts if name != part]
        value = 0.0
        for size in range(n):
            weight = factorial(size) * factorial(n - size - 1) / factorial(n)
            for chosen in combinations(others, size):
                changed = key_of(parts, (*chosen, part))
                value += weight * (cost[key_of(parts, chosen)] - cost[changed])
        values[part] = value
    return values


def key_of(parts: Sequence[str], chosen: Sequence[str]) -> str:
    """The chosen parts joined by "+", in the order of `parts`."""
    return "+".join(part for part in parts if part in chosen)


def sharing_out(
    model: Model,
    olds: Sequence[tuple[int, ...]],
    new: tuple[int, ...],
) -> tuple[Shares, ...]:
    """Shares of poses and order, and of poses, order and motions, from old to `new`.

    `olds` are tried in their order until both mixed sequences (old order with new poses, new order
    with old poses) have motions throughout; none then no shares.
    """
    for old in olds:
        mixed = {
            "": old,
            "poses": with_poses(model, old, new),
            "order": with_poses(model, new, old),
            "poses+order": new,
        }
        costs = {key: model.cost_of(cycle) for key, cycle in mixed.items()}
        if any(cost is None for cost in costs.values()):
            continue
        optimal = {key: cost.total for key, cost in costs.items() if cost is not None}
        parts = ("poses", "order")
        same = Shares(SAME_MOTIONS, optimal, shapley(parts, optimal))
        three = (*parts, "motions")
        table = {}
        for key, cycle in mixed.items():
            fast = [at_full_speed(model, curve) for curve in trajectories_of(model, cycle)]
            cost = costs[key]
            assert cost is not None
            table[key] = full_speed_cost(model, fast) + cost.welding
            table[key_of(three, (*key.split("+"), "motions"))] = cost.total
        return same, Shares(FAST_MOTIONS, table, shapley(three, table))
    return ()


def with_poses(model: Model, order: tuple[int, ...], poses: tuple[int, ...]) -> tuple[int, ...]:
    """The studs in the order of one cycle, each in its pose of another."""
    pose = {int(model.nodes.cluster_of[v]): v for v in poses}
    return tuple(pose[int(model.nodes.cluster_of[v])] for v in order)
