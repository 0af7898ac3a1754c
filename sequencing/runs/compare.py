"""What differs between two runs: inputs, order, poses, costs, motions."""

from __future__ import annotations

from typing import Any

import numpy as np

from sequencing.runs.folder import Run
from sequencing.runs.tables import markdown_table, number


def compare_runs(a: Run, b: Run) -> dict[str, Any]:
    """Differences from run `a` to run `b`, ready for `--json`.

    `identical` means that nothing in result.json and motions.npz differs. `same_order` looks at
    the studs, `same_poses` also at the alternatives. Motions are matched by origin and target
    (and direction); `max_joint_deviation_rad` compares them at equal shares of their durations.
    """
    order_a, order_b = ([w.stud for w in run.welds] for run in (a, b))
    poses_a, poses_b = ([(w.stud, w.alternative) for w in run.welds] for run in (a, b))
    motions = _motions(a, b)
    deviations = [
        m["max_joint_deviation_rad"]
        for m in motions["common"]
        if m["max_joint_deviation_rad"] is not None
    ]
    return {
        "a": str(a.folder),
        "b": str(b.folder),
        "identical": dict(a.result) == dict(b.result),
        "inputs": _changed(a.result["inputs"], b.result["inputs"]),
        "versions": _changed(a.result["versions"], b.result["versions"]),
        "seed": [a.result["seed"], b.result["seed"]],
        "same_order": order_a == order_b,
        "same_poses": poses_a == poses_b,
        "order": [order_a, order_b],
        "moved_poses": _moved_poses(poses_a, poses_b),
        "cost": _costs(a, b),
        "duration_s": _pair(a.result["duration_s"], b.result["duration_s"]),
        "certified": [a.result["certified"], b.result["certified"]],
        "fallbacks": [a.result["fallbacks"], b.result["fallbacks"]],
        "motions": motions,
        "max_joint_deviation_rad": max(deviations, default=None),
    }


def comparison_text(report: dict[str, Any]) -> str:
    """`compare_runs` as Markdown: what is equal, the figures side by side, the motions."""
    if report["identical"]:
        return "The runs are identical."
    changed = [*report["inputs"], *(f"version of {name}" for name in report["versions"])]
    lines = [f"Changed: {', '.join(changed) or 'no input and no version'}."]
    lines.append(
        f"Same order: {_yes(report['same_order'])}; same poses: {_yes(report['same_poses'])}."
    )
    for name, order in zip(("a", "b"), report["order"]):
        lines.append(f"Order {name}: {' → '.join(order)}")
    lines += [
        f"Stud {item['stud']}: alternative {item['a']} in a, {item['b']} in b"
        for item in report["moved_poses"]
    ]
    rows = [[key, *_cells(value)] for key, value in report["cost"].items()]
    rows.append(["duration s", *_cells(report["duration_s"])])
    rows += [
        [f"J {item['from']} → {item['to']}", *_cells(item["cost"])]
        for item in report["motions"]["common"]
    ]
    rows += [[f"only in a: {name}", "", "", ""] for name in report["motions"]["only_a"]]
    rows += [[f"only in b: {name}", "", "", ""] for name in report["motions"]["only_b"]]
    table = markdown_table(["", report["a"], report["b"], "change %"], rows)
    return "\n\n".join([*lines, table])


def run_differences(a: Run, b: Run, tolerance: float) -> list[str]:
    """What differs between two runs by more than `tolerance` (see `differences`), one line each.

    Order, poses, weld costs, motions with cost, duration, status and certificate, totals. Solver,
    planner and method of a motion count where both runs name them.
    """
    first, second = _figures(a), _figures(b)
    for ends in first["motions"].keys() & second["motions"].keys():
        one, two = first["motions"][ends], second["motions"][ends]
        for name in _MAKERS:
            if not (one[name] and two[name]):
                del one[name], two[name]
    return differences(first, second, tolerance)


def differences(a: Any, b: Any, tolerance: float, place: str = "") -> list[str]:
    """Where two JSON objects differ: numbers by more than tolerance · max(1, |a|, |b|)."""
    if isinstance(a, dict) and isinstance(b, dict):
        found = []
        for key in dict.fromkeys((*a, *b)):
            where = f"{place}/{key}" if place else str(key)
            if key not in a or key not in b:
                found.append(f"{where}: only in {'b' if key not in a else 'a'}")
            else:
                found += differences(a[key], b[key], tolerance, where)
        return found
    if isinstance(a, list | tuple) and isinstance(b, list | tuple) and len(a) == len(b):
        pairs = enumerate(zip(a, b))
        return [
            line for k, (x, y) in pairs for line in differences(x, y, tolerance, f"{place}[{k}]")
        ]
    numbers = [isinstance(x, int | float) and not isinstance(x, bool) for x in (a, b)]
    if all(numbers):
        equal = a == b or abs(a - b) <= tolerance * max(1.0, abs(a), abs(b)) < np.inf
    else:
        equal = a == b and isinstance(a, bool) == isinstance(b, bool)
    return [] if equal else [f"{place}: {a!r} in a, {b!r} in b"]


_MAKERS = ("solver", "planner", "method")


def _figures(run: Run) -> dict[str, Any]:
    result = run.result
    fields = ("kind", "status", "source", "certified", "cost", "duration_s")
    return {
        "order": [weld.stud for weld in run.welds],
        "welds": {
            weld.stud: {
                "alternative": weld.alternative, "q_rad": weld.q_rad.tolist(),
                "cost": weld.cost, "time_s": weld.time_s,
            }
            for weld in run.welds
        },
        "motions": {
            f"{entry['from']}→{entry['to']}": {
                **{name: entry[name] for name in fields},
                **{name: entry.get(name, "") for name in _MAKERS},
            }
            for entry in result["motions"]
        },
        "duration_s": result["duration_s"], "certified": result["certified"],
        **{
            name: result["tables"][name] if "tables" in result else None
            for name in ("energy_based", "time_based", "time_based_totals")
        },
    }  # fmt: skip


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _cells(pair: dict[str, float | None]) -> list[str]:
    return [number(pair["a"], 2), number(pair["b"], 2), number(pair["change_percent"], 1)]


def _pair(before: float, after: float) -> dict[str, float | None]:
    change = None if not before else 100.0 * (after - before) / before
    return {"a": before, "b": after, "change_percent": change}


def _costs(a: Run, b: Run) -> dict[str, Any]:
    before, after = a.costs, b.costs
    return {key: _pair(before[key], after[key]) for key in ("travel", "welding", "total")}


def _changed(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    for key in sorted({*a, *b}):
        before, after = a.get(key), b.get(key)
        if isinstance(before, dict) and isinstance(after, dict):
            changes |= {f"{key}/{k}": v for k, v in _changed(before, after).items()}
        elif before != after:
            changes[key] = [before, after]
    return changes


def _moved_poses(a: list[tuple[str, int]], b: list[tuple[str, int]]) -> list[dict[str, Any]]:
    before, after = dict(a), dict(b)
    return [
        {"stud": stud, "a": before.get(stud), "b": after.get(stud)}
        for stud in sorted({*before, *after})
        if before.get(stud) != after.get(stud)
    ]


def _motions(a: Run, b: Run) -> dict[str, Any]:
    by_ends_a, by_ends_b = (
        {(item.origin, item.target): item for item in run.motions} for run in (a, b)
    )
    common = []
    for ends in [ends for ends in by_ends_a if ends in by_ends_b]:
        first, second = by_ends_a[ends].motion, by_ends_b[ends].motion
        deviation = None
        if first.trajectory is not None and second.trajectory is not None:
            share = np.linspace(0.0, 1.0, 201)
            curves = [
                t.sample(t.t_s[0] + share * t.duration_s).q_rad
                for t in (first.trajectory, second.trajectory)
            ]
            deviation = float(np.max(np.abs(curves[0] - curves[1])))
        common.append(
            {
                "from": ends[0],
                "to": ends[1],
                "cost": _pair(first.cost, second.cost),
                "duration_s": _pair(first.duration_s, second.duration_s),
                "status": [first.status.value, second.status.value],
                "max_joint_deviation_rad": deviation,
            }
        )
    return {
        "common": common,
        "only_a": ["→".join(ends) for ends in by_ends_a if ends not in by_ends_b],
        "only_b": ["→".join(ends) for ends in by_ends_b if ends not in by_ends_a],
    }
