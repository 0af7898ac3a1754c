"""Changed assumptions: is the order still good, and is the saving still there?

Every change of masses, torque limits, weights or departure length is planned anew, and the nominal
sequence is priced under it: the difference is what trusting the nominal assumptions would cost.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import InputError
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing.cycle_types import CycleCost
from sequencing.edges.nodes import StationNodes, station_nodes
from sequencing.edges.store import EdgeStore
from sequencing.edges.worker import context_fingerprint
from sequencing.runs.archive import write_atomic
from studies.stud_welding.model import Model, StudyBench, open_model, priced_nodes, scaled_masses
from studies.stud_welding.search import Found, best_sequence
from studies.stud_welding.types import ChangeRow, Use
from studies.stud_welding.use import cycle_use
from studies.stud_welding.weights import with_friction, with_nominal_motions

# Raised whenever a change of the code changes what a row says.
ROW_VERSION = 2


def row_key(
    name: str,
    station: Station,
    table: Array,
    cycles: Sequence[tuple[int, ...]],
    limit: int,
    bench: StudyBench,
) -> str:
    """sha256 of all that decides a row: the changed station, estimates, cycles, budget, bench."""
    digest = hashlib.sha256(
        f"row|{ROW_VERSION}|{name}|{cycles!r}|{limit}|{bench.seed}|{station.fingerprint}".encode()
    )
    digest.update(context_fingerprint(station, bench.method, bench.solver).encode())
    digest.update(np.ascontiguousarray(table).tobytes())
    return digest.hexdigest()


def rows_file(store: EdgeStore) -> Path:
    """The study's file of rows: it lies beside the store of solved edges."""
    return store.path.with_name("change_rows.json")


def keep_row(path: Path, key: str, row: ChangeRow) -> None:
    """Add a row to the file."""
    write_atomic(path, json.dumps({**_rows(path), key: asdict(row)}, indent=1))


def kept_row(path: Path, key: str) -> ChangeRow | None:
    """The row under `key`, if there is one."""
    data = _rows(path).get(key)
    if data is None:
        return None
    for name in ("best", "nominal", "old"):
        data[name] = None if data[name] is None else CycleCost(**data[name])
    for name in ("best_use", "nominal_use"):
        data[name] = None if data[name] is None else Use(**data[name])
    return ChangeRow(**{**data, "order": tuple(data["order"])})


def _rows(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}
    except ValueError as error:
        raise InputError.of(
            "rows-damaged",
            file=str(path),
            value=str(error),
            legal="the rows of a study",
            fix="remove the file; its rows are priced again",
        ) from error


@dataclass(frozen=True)
class Change:
    """A changed assumption: group, name and what it makes of the station.

    `other_poses`: poses must be searched again; `time_weight`: the factor on c_t, where that is
    the change; `friction`: so many times the drives' friction is added to nominal motions.
    """

    group: str
    name: str
    apply: Callable[[Station], Station] = lambda station: station
    other_poses: bool = False
    time_weight: float | None = None
    friction: float = 0.0


def _masses(factor: float) -> Change:
    return Change(
        "masses",
        f"masses × {factor:g}",
        lambda s: s.replace(robot=scaled_masses(s.robot, factor)),
    )


def _torque(factor: float) -> Change:
    def apply(s: Station) -> Station:
        limit = factor * s.robot.torque_limit_nm
        return s.replace(robot=s.robot.with_limits(torque_limit_nm=limit))

    return Change("torque limits", f"torque limits × {factor:g}", apply)


def _velocity_weight(factor: float) -> Change:
    return Change(
        "weights",
        f"speed weight c_v × {factor:g}",
        lambda s: s.replace(cost=replace(s.cost, velocity=factor * s.cost.velocity)),
    )


def _time_weight(factor: float) -> Change:
    return Change(
        "weights",
        f"time weight c_t × {factor:g}",
        lambda s: s.replace(cost=replace(s.cost, time=factor * s.cost.time)),
        time_weight=factor,
    )


def _departure(length_m: float) -> Change:
    def apply(s: Station) -> Station:
        return s.replace(studs=tuple(replace(stud, depart_m=length_m) for stud in s.studs))

    return Change("departure", f"departure {100 * length_m:g} cm", apply, other_poses=True)


CHANGES = (
    _masses(0.75),
    _masses(1.25),
    _torque(0.75),
    _torque(1.25),
    _velocity_weight(0.1),
    _velocity_weight(10.0),
    _time_weight(0.1),
    _time_weight(3.0),
    _time_weight(10.0),
    _time_weight(30.0),
    _time_weight(100.0),
    _departure(0.01),
    _departure(0.05),
    _departure(0.10),
    Change("friction", "friction × 1", friction=1.0),
    Change("friction", "friction × 2", friction=2.0),
)
#: What a reduced study changes.
FEW_CHANGES = ("masses × 1.25", "time weight c_t × 10", "departure 5 cm", "friction × 1")


def price_change(
    change: Change,
    nominal: Model,
    table: Array,
    old: tuple[int, ...],
    new: tuple[int, ...],
    world: CollisionWorld,
    bench: StudyBench,
    limit: int,
) -> ChangeRow | None:
    """The row of a change; None where no cycle exists under it.

    `table` (V, V) are the nominal estimates, `old` and `new` cycles of nominal nodes, `limit` the
    most edges that the search may solve beyond those of the two cycles.
    """
    if change.friction:
        model = with_friction(nominal, change.friction)
        return _row(
            change,
            nominal,
            model,
            table,
            "motions optimal without friction",
            (old, new),
            new,
            limit,
        )
    station = change.apply(nominal.station)
    key = row_key(change.name, station, table, (old, new), limit, bench)
    kept = kept_row(rows_file(bench.store), key)
    if kept is not None:
        return kept
    note = ""
    if change.other_poses:
        world = CollisionWorld(station)
        found = alternatives(station, world)
        nodes = station_nodes(station, found)
        lost = [item.stud.id for item in found if not item.alternatives]
        note = f"unreachable: {', '.join(lost)}" if lost else ""
    else:
        nodes = priced_nodes(nominal.nodes, station)
    if not nodes.studs:
        return None
    same = matching(nominal.nodes, nodes)
    model = open_model(change.name, station, nodes, world, bench)
    if change.group == "weights":
        model = with_nominal_motions(model, nominal)
    row = _row(
        change,
        nominal,
        model,
        _carried(nominal, model, table, same),
        note,
        tuple(_mapped(cycle, same) for cycle in (old, new)),
        new,
        limit,
    )
    if row is not None:
        keep_row(rows_file(bench.store), key, row)
    return row


def _row(
    change: Change,
    nominal: Model,
    model: Model,
    table: Array,
    note: str,
    carried: tuple[tuple[int, ...] | None, ...],
    new: tuple[int, ...],
    limit: int,
) -> ChangeRow | None:
    found = best_sequence(model, table, [c for c in carried if c is not None], limit)
    if found is None:
        return None
    old_cost, new_cost = (None if c is None else model.cost_of(c) for c in carried)
    if carried[1] is None:
        note = (note + "; " if note else "") + "a pose of the nominal sequence is gone"
    neighbours, poses = compare_orders(nominal, new, model, found.nodes)
    use = None
    if new_cost is not None and carried[1] is not None:
        use = cycle_use(model, carried[1])
    return ChangeRow(
        change.group,
        change.name,
        found.cost,
        new_cost,
        old_cost,
        above(new_cost, found),
        None if old_cost is None else -above_cost(found.cost, old_cost),
        found.conditional_gap_percent,
        found.conditional_factor,
        neighbours,
        poses,
        model.studs_of(found.nodes),
        found.edges,
        cycle_use(model, found.nodes),
        use,
        note,
    )


def above(cost: CycleCost | None, found: Found) -> float | None:
    """100 (cost − found) / found of the totals."""
    return None if cost is None else above_cost(cost, found.cost)


def above_cost(cost: CycleCost, base: CycleCost) -> float:
    """100 (cost − base) / base of the totals."""
    return 100.0 * (cost.total / base.total - 1.0)


def matching(before: StationNodes, after: StationNodes) -> dict[int, int]:
    """Nodes of `before` → the nodes of `after` with the same stud and joint vector."""
    place = {(after.stud[v], after.q_rad[v].tobytes()): v for v in range(after.num_nodes)}
    keys = [(before.stud[v], before.q_rad[v].tobytes()) for v in range(before.num_nodes)]
    return {v: place[key] for v, key in enumerate(keys) if key in place}


def _mapped(cycle: tuple[int, ...], same: dict[int, int]) -> tuple[int, ...] | None:
    return tuple(same[v] for v in cycle) if all(v in same for v in cycle) else None


def _carried(nominal: Model, model: Model, table: Array, same: dict[int, int]) -> Array:
    """Nominal estimates × ratio of the straight lines; where poses are new, lines × the median."""
    usable = np.isfinite(table) & np.isfinite(nominal.rough)
    carried = model.rough * float(np.median(table[usable] / nominal.rough[usable]))
    before = np.array(list(same.keys()), dtype=np.int64)
    after = np.array(list(same.values()), dtype=np.int64)
    known = np.ix_(after, after)
    source = np.ix_(before, before)
    with np.errstate(invalid="ignore"):
        carried[known] = table[source] * (model.rough[known] / nominal.rough[source])
    return np.where(np.isfinite(carried), carried, np.inf)


def compare_orders(
    first: Model, one: tuple[int, ...], second: Model, other: tuple[int, ...]
) -> tuple[float, int]:
    """Share [%] of neighbouring studs in common (direction aside), number of studs posed alike."""
    sides = []
    for model, cycle in ((first, one), (second, other)):
        names = [model.nodes.stud[v] for v in cycle]
        sides.append({frozenset(pair) for pair in zip(names, [*names[1:], names[0]])})
    poses = {
        (first.nodes.stud[v], first.nodes.q_rad[v].tobytes()) for v in one if v != first.nodes.home
    }
    alike = sum((second.nodes.stud[v], second.nodes.q_rad[v].tobytes()) in poses for v in other)
    return 100.0 * len(sides[0] & sides[1]) / max(1, len(sides[0])), alike
