"""`dmoc schedule`: when the robots of a cell move, and how fast."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import planning
from dmoc.motion.status import Status
from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.runs.tables import markdown_table, number
from sequencing.timing import run_schedule


def run_schedule_command(console: Console, cell: str, seed: int, out: Path | None) -> CommandResult:
    """Baselines and optimised timings of a cell.yaml; exit 3 where every timing collides."""
    embedded = Path(planning.__file__).parent / "stations" / cell / "cell.yaml"
    data = run_schedule(embedded if embedded.is_file() else cell, seed, progress=console.say)
    console.show(cases_table(data["cases"]))
    console.show(
        f"best: {data['best']}, {number(data['energy_j'])} J on the links; "
        f"savings count from {data['baseline']}"
    )
    for line in remarks(data):
        console.show(line)
    save_json(out, "schedule.json", data)
    return CommandResult(data, 0 if data["status"] == Status.CONVERGED else 3)


def remarks(data: dict[str, Any]) -> list[str]:
    """What else an engineer should see: the first level, and contacts that no timing mends."""
    order, lines = data["order"], []
    if order["method"] == "none":
        lines.append(f"order: {order['reason']}")
    else:
        found = "other windows or orders" if order["changed"] else "nothing better than the given"
        proof = "proven" if order["proven"] else "not proven"
        lines.append(
            f"order: {found} ({order['method']}, {proof}; {order['orders']:.0f} orders, "
            f"{order['alignments']} windows in time)"
        )
    for name, what in (
        ("fixture_contacts", "the part or fixtures of another station"),
        ("obstacle_contacts", "an obstacle"),
    ):
        if data[name]:
            lines.append(f"warning: a path meets {what}, whatever the timing: {data[name][0]}")
    for name, share in data["torque_share"].items():
        if share["scheduled"] > 1.0:
            lines.append(
                f"warning: {name} needs {100 * share['scheduled']:.0f} % of a joint's torque limit "
                "as scheduled: slow its motions down or carry less"
            )
    for name, tags in data["provenance"]["robot"].items():
        if "drive" in tags:
            lines.append(f"joules of {name} rest on its drive, {tags['drive']}")
    if data["status"] != Status.CONVERGED:
        lines.append(data["advice"])
    return lines


def cases_table(cases: list[dict[str, Any]]) -> str:
    """The cases of a schedule as a markdown table."""
    rows = [
        [
            case["name"],
            number(case["total_energy_j"]),
            number(case["saving_with_base_percent"], 2),
            number(case["energy_j"]),
            number(case["saving_percent"], 2),
            number(case["duration_s"], 2),
            str(case["collisions"]),
            number(case["cpu_s"], 2),
        ]
        for case in cases
    ]
    header = (
        "case",
        "with base load J",
        "saving %",
        "links J",
        "saving %",
        "duration s",
        "collisions",
        "CPU s",
    )
    return markdown_table(header, rows)
