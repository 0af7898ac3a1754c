"""What each part of the method is worth: sequences found with parts of it left out."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from sequencing.cycle.baseline import time_costs
from sequencing.cycle_types import CycleCost
from studies.stud_welding.model import Model
from studies.stud_welding.search import best_poses, best_sequence, sequence_by
from studies.stud_welding.types import AblationRow

OLD, NEW = "old sequence", "lazy optimal control (new)"


def static_estimate(model: Model) -> Array:
    """The paper's estimate of travels (V, V): least travel time × mean holding rate of the ends.

    Section 2.1 takes "into account static energy consumptions at the start and end"; a constant
    that all travels share would not change the sequence and is left out.
    """
    rate = model.station.cost.holding_rate(model.station.robot.gravity_torque_nm(model.nodes.q_rad))
    times = time_costs(model.station, model.nodes)
    return np.asarray(times * (rate[:, None] + rate[None, :]) / 2.0)


def ablation_cycles(
    model: Model, table: Array, old: tuple[int, ...], new: tuple[int, ...], limit: int
) -> dict[str, tuple[int, ...] | None]:
    """The sequences of the ablation by name; `table` (V, V) are estimates of travel costs."""
    nodes = model.nodes
    order = [int(nodes.cluster_of[v]) for v in old]
    reordered = best_sequence(model, table, [old], limit, gap=0.005, only=old)
    return {
        OLD: old,
        "old order, cheapest weld pose of each stud": best_poses(
            model, np.zeros(table.shape), order, true_costs=False
        ),
        "old poses, best order": None if reordered is None else reordered.nodes,
        "old order, best poses": best_poses(model, table, order),
        "paper's static estimate only": sequence_by(model, static_estimate(model)),
        "straight-line estimate only": sequence_by(model, model.rough),
        NEW: new,
    }


def ablation_rows(
    model: Model, cycles: dict[str, tuple[int, ...] | None]
) -> tuple[AblationRow, ...]:
    """Their costs with certified motions at screening quality, against old and new."""
    costs = {name: None if c is None else model.cost_of(c) for name, c in cycles.items()}
    rows = []
    for name, cost in costs.items():
        cycle = cycles[name]
        order = () if cycle is None else model.studs_of(cycle)
        rows.append(
            AblationRow(name, cost, change(cost, costs[OLD]), change(cost, costs[NEW]), order)
        )
    return tuple(rows)


def change(cost: CycleCost | None, base: CycleCost | None) -> float | None:
    """100 (cost − base) / base of the totals."""
    if cost is None or base is None or base.total == 0:
        return None
    return 100.0 * (cost.total / base.total - 1.0)
