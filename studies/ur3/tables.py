"""The tables of the UR3 study, as Markdown, from the object of its study.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sequencing.runs.tables import markdown_table, number

Data = Mapping[str, Any]


def ur3_markdown(data: Data) -> str:
    """Movements, classes of random pairs, payload, duration, obstacles, exports, in this order."""
    parts = [
        "# UR3 study",
        data["statement"],
        "## Movements A–D (3 s), saving against the trapezoidal movej",
        _movements(data["movements"]),
        "## Random pairs of each class, medians",
        _classes(data["classes"]),
        _goals(data["goals"]),
        "## Payload",
        _sweep(data["payload"], "payload_kg", "payload [kg]"),
        "## Duration, on physical energy",
        _sweep(data["duration"], "duration_s", "duration [s]"),
        _best_durations(data["best_duration"]),
        "## A post in the way",
        _obstacles(data["obstacles"]),
        "## Exports, read back",
        _exports(data["exports"]),
    ]
    return "\n\n".join(parts) + "\n"


def _movements(movements: list[Data]) -> str:
    rows = []
    for move in movements:
        for name, metric in move["metrics"].items():
            rows.append(
                [
                    move["name"],
                    name,
                    number(metric["baseline_j"]),
                    number(metric["swarm"]["median_saving_percent"]),
                    number(metric["gradient"]["saving_percent"]),
                    number(metric["physical_saving_with_base_percent"], 2),
                    number(move["paper_saving_percent"]),
                ]
            )
    header = (
        "move",
        "metric",
        "baseline [J]",
        "swarm [%] (median)",
        "gradient [%]",
        "physical, base load included [%]",
        "paper [%]",
    )
    return markdown_table(header, rows)


def _classes(classes: Mapping[str, Data]) -> str:
    rows = []
    for name, found in classes.items():
        median = found["median"]
        for metric in ("iv_absolute", "energy"):
            rows.append(
                [
                    name,
                    str(len(found["pairs"])),
                    metric,
                    *(
                        number(median[f"{metric}/{key}"])
                        for key in ("swarm_percent", "gradient_percent")
                    ),
                    number(median[f"{metric}/physical_with_base_percent"], 2),
                    *(number(median[key], 2) for key in ("bezier_j", "free_form_j")),
                ]
            )
    header = (
        "class",
        "pairs",
        "metric",
        "swarm [%]",
        "gradient [%]",
        "physical, base load included [%]",
        "best Bézier [J]",
        "free form [J]",
    )
    return markdown_table(header, rows)


def _goals(goals: Data) -> str:
    return (
        f"The gradient ends below the swarm in {100 * goals['gradient_below_swarm_share']:.1f} % "
        f"of the pairs and metrics. The free-form reference converged in "
        f"{100 * goals['free_form_converged_share']:.0f} % of {goals['references']} cases; "
        f"{goals['bezier_below_free_form']} Bézier motions lie below it "
        f"({goals['bezier_below_optimal_control']} below the optimal control alone, before the "
        f"best Bézier's knots are freed)."
    )


def _sweep(entries: list[Data], key: str, title: str) -> str:
    rows = [
        [
            entry["move"],
            entry["metric"],
            number(entry[key], 2),
            _if_feasible(entry, "baseline"),
            _if_feasible(entry, "gradient"),
            _meaningful(entry["saving_percent"]),
            _if_feasible(entry, "baseline", "_with_base_j"),
            _if_feasible(entry, "gradient", "_with_base_j"),
        ]
        for entry in entries
    ]
    header = (
        "move",
        "metric",
        title,
        "movej [J]",
        "Bézier [J]",
        "saving [%]",
        "movej with base load [J]",
        "Bézier with base load [J]",
    )
    return markdown_table(header, rows)


def _meaningful(percent: float | None) -> str:
    """A share of an energy near zero says nothing: a dash."""
    return number(None if percent is None or percent > 100.0 else percent)


def _if_feasible(entry: Data, motion: str, suffix: str = "_j") -> str:
    return number(entry[motion + suffix]) if entry[f"{motion}_feasible"] else "limits broken"


def _best_durations(entries: list[Data]) -> str:
    rows = [
        [
            entry["move"],
            entry["motion"],
            number(entry["duration_s"], 2),
            number(entry["with_base_j"]),
            number(entry["duration_without_base_s"], 2),
            number(entry["without_base_j"]),
        ]
        for entry in entries
    ]
    header = (
        "move",
        "motion",
        "best duration, base load included [s]",
        "[J]",
        "without base load [s]",
        "[J] ",
    )
    return markdown_table(header, rows)


def _obstacles(entries: list[Data]) -> str:
    rows = [
        [
            entry["move"],
            entry["metric"],
            number(entry["post_height_m"], 2),
            " – ".join(entry["movej_touches"] or ["free"]),
            _if_feasible(entry, "swarm"),
            _if_feasible(entry, "gradient"),
            number(entry["without_post_j"]),
        ]
        for entry in entries
    ]
    header = (
        "move",
        "metric",
        "post [m]",
        "movej touches",
        "swarm [J]",
        "gradient [J]",
        "without the post [J]",
    )
    return markdown_table(header, rows)


def _exports(entries: list[Data]) -> str:
    rows = [
        [
            entry["run"],
            "yes" if entry["certified"] else "no",
            f"{1e3 * item['step_s']:.0f}",
            str(item["points"]),
            number(1e3 * item["deviation_rad"], 3),
            f"{item['read_back_rad']:.1e}",
        ]
        for entry in entries
        for item in entry["servoj"]
    ]
    header = (
        "run",
        "certified",
        "servoj step [ms]",
        "points",
        "deviation by sampling [mrad]",
        "read back [rad]",
    )
    return markdown_table(header, rows)
