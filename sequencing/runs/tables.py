"""tables.md: Tables 1 and 2, what J consists of, what is assumed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

Result = Mapping[str, Any]


def tables_markdown(result: Result) -> str:
    """The text of tables.md, from the object of result.json alone."""
    parts = [f"# {named(result['name'])}: tables", headline(result)]
    if result["tables"] is not None:
        parts += [
            "## Table 1: alternatives and range of the weld costs",
            table_1(result),
            "## Table 2: cost of the cycle, old and new sequence",
            table_2(result),
        ]
    parts += ["## What the travel cost consists of", table_shares(result)]
    parts += ["## What is assumed", provenance_text(result)]
    return "\n\n".join(parts) + "\n"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column is left-aligned, the others right-aligned."""
    rule = ["---"] + ["---:"] * (len(header) - 1)
    clean = [[" ".join(cell.replace("|", "¦").split()) for cell in row] for row in [header, *rows]]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [clean[0], rule, *clean[1:]])


def named(text: Any) -> str:
    """A name from an input as plain text: on one line, no markup, no HTML, no cell of its own."""
    line = " ".join(str(text).replace("|", "¦").split())
    return re.sub(r"([\\`*\[\]<>&!~])", r"\\\1", line)


def number(value: float | None, digits: int = 1) -> str:
    """A figure for a person; a missing one is a dash."""
    return "–" if value is None else f"{value:.{digits}f}"


def headline(result: Result) -> str:
    """How big, how safe, how well proven."""
    search, motions = result["search"], result["motions"]
    if search is None:
        return (
            f"{len(motions)} motions without a station, {number(result['duration_s'])} s; "
            f"{result['certified']} of them are certified free of collision between their knots."
        )
    text = (
        f"{len(result['welds'])} studs, {result['configurations']} configurations, "
        f"{len(motions)} motions; cycle time {number(result['duration_s'])} s. "
        f"{result['certified']} of {len(motions)} motions are certified free of collision between "
        f"their knots; {result['fallbacks']} are time-scaled seeds instead of optimal motions. "
        f"Edges evaluated: {search['edges_evaluated']} of {search['edges_total']} "
        f"({search['edges_training']} to fit the estimate, {search['edges_held_out']} held out to "
        f"judge it), {search['edges_failed']} without a motion.\n\n{gaps(search)}"
    )
    deep = [(w.get("contact_depth_m", 0.0), named(w["stud"])) for w in result["welds"]]
    if deep and max(deep)[0] > 5e-6:
        depth, stud = max(deep)
        text += (
            f"\n\nAt the weld poses the collision shapes of tool and part overlap by up to "
            f"{1e3 * depth:.2f} mm ({stud}); {sum(d > 5e-6 for d, _ in deep)} of {len(deep)} "
            "poses overlap."
        )
    polish = result.get("polish")
    if polish is not None:
        text += (
            f"\n\nPolish (tools turned continuously, {len(polish['moved'])} welds): "
            f"{number(polish['cost_before'])} → {number(polish['cost_after'])}, "
            f"{number(polish['saving_percent'], 2)} % more. The gaps speak of the cycle before."
        )
    look = result.get("second_look")
    if look is not None:
        text += (
            f"\n\nSecond look: {look['engine']} finds {look['contacts']} contacts in "
            f"{look['motions']} motions at {look['configurations']} configurations, with the "
            "convex pieces and with the original meshes."
        )
        text += "".join(f" Refused on the way: {named(entry)}." for entry in look["refused"])
    text += shortfalls(result)
    for entry in result["unreachable"]:
        text += f"\n\nNot in the cycle: stud {named(entry['stud'])} ({named(entry['reason'])})."
    return text


def shortfalls(result: Result) -> str:
    """Which motions are not proven to keep the station's clearance; nothing where all do."""
    asked = result.get("clearance_m") or 0.0  # runs of before do not say
    short = [
        f"{m['key']} {number(_millimetres(proven))} mm"
        for m in result["motions"]
        if (proven := m.get("proven_clearance_m")) is not None and proven < asked * (1 - 1e-9)
    ]
    if not short:
        return ""
    return (
        f"\n\n**Warning: {len(short)} motions keep less than the {1e3 * asked:g} mm that the "
        f"station asks for** (proven: {', '.join(short)}). They are certified free of contact; "
        "their `note` in result.json names what is nearest."
    )


def gaps(search: Mapping[str, Any]) -> str:
    """The two gaps, each by its name and with all that it says."""
    kind = "proven" if search["bound_is_proven"] else "not proven"
    text = (
        f"**Strict gap {number(search['gap_percent'])} %** to the lower bound "
        f"{number(search['lower_bound'])} ({kind}): no order of these poses, with any motions "
        "within the robot's speed and acceleration limits, costs less."
    )
    if search["conditional_gap_percent"] is not None:
        text += (
            f" **Conditional gap {number(search['conditional_gap_percent'], 2)} %**: it holds if "
            "no unevaluated edge costs less than its factor times its estimate (factors follow "
            f"the estimate's own deviation; median {search['conditional_factor']:.3f}). Coverage "
            f"{number(search['coverage_percent'])} %: so many of the edges drawn at random cost "
            f"more, judged by {search['edges_held_out']} edges that the estimate was not fitted to."
        )
    return text


def table_1(result: Result) -> str:
    """Per stud: how many alternatives and what the weld costs in the best and worst of them."""
    rows = [
        [
            named(row["stud"]),
            str(row["alternatives"]),
            f"[{number(row['lowest_cost'], 2)}, {number(row['highest_cost'], 2)}]",
        ]
        for row in result["tables"]["studs"]
    ]
    return markdown_table(["stud", "alternatives", "weld cost"], rows)


def table_2(result: Result) -> str:
    """Old sequence (least approximate travel time) against new (least optimal-control cost)."""
    tables, parts = result["tables"], ("travel", "welding", "total")
    old, new = tables["time_based"], tables["energy_based"]
    savings = [100.0 * (1.0 - new[key] / old[key]) if old[key] else None for key in parts]
    rows = [
        ["old sequence (time)", *(number(old[key]) for key in parts)],
        ["new sequence (optimal control)", *(number(new[key]) for key in parts)],
        ["saving %", *(number(x) for x in savings)],
    ]
    totals, spread = tables["time_based_totals"], _against_least_time(tables)
    if len(totals) > 1:
        spread += (
            f" Sequences of least time tie: of {len(totals)} such sequences the totals range from "
            f"{number(min(totals))} to {number(max(totals))}; the table shows the median "
            "one (of an even number the cheaper of the middle two)."
        )
    return (
        markdown_table(["", *parts], rows)
        + f"\n\nThe saving depends on the station and on the old sequence.{spread}"
    )


def _against_least_time(tables: Result) -> str:
    """What acceleration limits make of the comparison; older runs do not have it."""
    least, seconds = tables.get("least_time"), tables.get("travel_s")
    if not least or not seconds:
        return ""
    times = ", ".join(
        f"{name} {number(seconds[key], 2)} s"
        for name, key in (("old", "old"), ("least-time", "least_time"), ("new", "new"))
        if seconds[key] is not None
    )
    return (
        " Its travel time, max |Δq| / v, ignores acceleration. A sequence of least time under "
        f"speed and acceleration limits costs {number(least['total'])}: against it the saving is "
        f"{number(tables['saving_against_least_time_percent'])} %. Travel times of the final "
        f"motions: {times}."
    )


def table_shares(result: Result) -> str:
    """Per motion: duration, cost and the terms of the cost."""
    names = ("time", "effort", "velocity")
    rows, sums = [], dict.fromkeys(names, 0.0)
    for item in result["motions"]:
        shares = item["cost_shares"]
        for name in names:
            sums[name] += shares.get(name, 0.0)
        state = item["status"] + (", seed" if item["source"] == "fallback" else "")
        state += ", certified" if item["certified"] else ""
        rows.append(
            [
                f"{item['key']} {named(item['from'])} → {named(item['to'])}",
                state,
                _clearances(item),
                number(item["duration_s"], 2),
                number(item["cost"], 2),
                _percent(item.get("cost_gap")),
                *(number(shares.get(name), 2) for name in names),
            ]
        )
    total = sum(sums.values())
    rows.append(
        [
            "**all**",
            "",
            "",
            number(sum(m["duration_s"] or 0.0 for m in result["motions"]), 2),
            number(total, 2),
            "",
            *(number(sums[name], 2) for name in names),
        ]
    )
    if total > 0:
        rows.append(
            [
                "**share %**",
                "",
                "",
                "",
                "100.0",
                "",
                *(number(100 * sums[n] / total) for n in names),
            ]
        )
    header = [
        "motion",
        "status",
        "clearance mm, proven / seen",
        "time s",
        "J",
        "executed %",
        "J time",
        "J effort",
        "J velocity",
    ]
    cost = result["cost"]
    weights = ", ".join(
        f"{key} {value:g}" for key, value in cost.items() if isinstance(value, float)
    )
    return markdown_table(header, rows) + f"\n\nWeights ({cost['kind']}): {weights}."


def _percent(share: float | None) -> str:
    """How much more or less than J the executed curve costs; of older runs nothing is known."""
    return number(None) if share is None else f"{100 * share:+.2f}"


def _clearances(item: Result) -> str:
    """What nothing undercuts between the knots, and the smallest distance met [mm]."""
    seen = number(_millimetres(item["min_clearance_m"]))
    return f"{number(_millimetres(item['proven_clearance_m']))} / {seen}"


def _millimetres(length_m: float | None) -> float | None:
    return None if length_m is None else 1000.0 * length_m


def provenance_text(result: Result) -> str:
    """Every tagged value of the robot, the assumed ones first and named as such."""
    tags = result["robot"]["provenance"]
    assumed = sorted(key for key, tag in tags.items() if tag == "assumed")
    known = sorted(key for key, tag in tags.items() if tag != "assumed")
    # Runs of older versions name no warnings.
    doubts = [
        f"- warning {doubt['code']}, {named(doubt['field'])}: {named(doubt['value'])}; "
        f"{named(doubt['fix'])}"
        for doubt in result["robot"].get("warnings", ())
    ]
    lines = [f"Robot {named(result['robot']['name'])}."]
    if assumed:
        lines.append(
            "**Assumed, not measured**: "
            + ", ".join(map(named, assumed))
            + ". Costs in this file are as good "
            "as these values."
        )
    if not tags:
        lines.append("The robot file tags none of its values: treat all of them as assumed.")
    lines += [f"- {named(key)}: {named(tags[key])}" for key in known] + doubts
    return "\n".join(
        [
            " ".join(lines[: 2 if assumed or not tags else 1]),
            "",
            *lines[2 if assumed or not tags else 1 :],
        ]
    ).rstrip()
