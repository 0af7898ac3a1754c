"""Cycle time against effort and electrical energy: the front of what the weights can reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from studies.stud_welding.changes import Change
from studies.stud_welding.model import Model
from studies.stud_welding.types import ChangeRow, TradeOff, Use
from studies.stud_welding.use import at_full_speed, cycle_use, trajectories_of


def trade_off_points(
    model: Model,
    old: tuple[int, ...],
    new: tuple[int, ...],
    changes: Sequence[Change],
    rows: Sequence[ChangeRow],
) -> tuple[TradeOff, ...]:
    """Points by growing weight of time: the new sequence with motions for each weight, sequences
    planned for each weight, the old one with optimal motions, and both at full speed."""
    points = [
        TradeOff("nominal weights", "new", 1.0, cycle_use(model, new)),
        TradeOff("nominal weights", "old", 1.0, cycle_use(model, old)),
    ]
    weight = {change.name: change.time_weight for change in changes}
    for row in rows:
        factor = weight.get(row.name)
        if factor is None:
            continue
        points.append(TradeOff(row.name, "re-optimised", factor, row.best_use))
        if row.nominal_use is not None:
            points.append(TradeOff(row.name, "new", factor, row.nominal_use))
    for name, cycle in (("new", new), ("old", old)):
        fast = [at_full_speed(model, curve) for curve in trajectories_of(model, cycle)]
        use = cycle_use(model, cycle, fast)
        points.append(TradeOff("full speed", "new" if name == "new" else "old", None, use))
    return mark_front(points, lambda use: use.total_j)


def mark_front(points: Sequence[TradeOff], price: Callable[[Use], float]) -> tuple[TradeOff, ...]:
    """The points, `on_front` where none is as good in time and in `price` and better in one."""
    marked = []
    for point in points:
        mine = (point.use.duration_s, price(point.use))
        beaten = any(
            theirs != mine and theirs[0] <= mine[0] and theirs[1] <= mine[1]
            for theirs in ((p.use.duration_s, price(p.use)) for p in points)
        )
        marked.append(replace(point, on_front=not beaten))
    return tuple(marked)
