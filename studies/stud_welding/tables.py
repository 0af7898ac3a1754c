"""study.md of the stud-welding study: every table with one sentence that says how to read it."""

from __future__ import annotations

from collections.abc import Sequence

from sequencing.cycle_types import CycleCost
from sequencing.runs.tables import markdown_table, number
from studies.stud_welding.ablation import NEW
from studies.stud_welding.paper import paper_tables
from studies.stud_welding.types import NEAR_PERCENT, Shares, StudWeldingStudy

STATION_WORDS = {
    "A": "Station A: short gun (0.30 m), made as a typical one.",
    "B": "Station B: long gun (0.90 m), part lower and further away.",
    "C": "Station C: station B with its studs jittered, **picked** because its saving equalled the "
    "published one in a prototype without obstacles. With obstacles the poses differ, and so does "
    "the saving.",
}


def stud_welding_markdown(study: StudWeldingStudy) -> str:
    """The whole text, from the study alone."""
    parts = [
        f"# Stud welding, station {study.station}{' (reduced)' if study.reduced else ''}",
        summary(study),
        "## Table 1: alternatives and range of the weld costs",
        table_1(study),
        "## Table 2: old and new sequence",
        table_2(study),
        "## What each part of the method is worth",
        ablation_table(study),
        "## Where the saving comes from",
        *(shares_table(shares) for shares in study.shares),
        share_words(study),
        "## What if the assumptions are wrong?",
        changes_table(study),
        "## Leaving and reaching the welds",
        departures_table(study),
        "## Cycle time against effort and electrical energy",
        trade_off_table(study),
        "## What was assumed",
        assumed(study),
    ]
    return "\n\n".join(parts) + "\n"


def summary(study: StudWeldingStudy) -> str:
    """The headline, and why it is not the paper's."""
    paper = paper_tables()
    old, new = paper["old_sequence"]["total"], paper["new_sequence"]["total"]
    low, high = min(study.old_totals), max(study.old_totals)
    # Both at screening quality: the tied sequences have no final motions.
    here = next((r.cost.total for r in study.ablation if r.name == NEW and r.cost), study.new.total)
    published = _change(new, old)
    if len(study.old_totals) == 1:
        against = (
            "the only sequence of least travel time that was found "
            f"({number(study.old_time_s, 2)} s of approximate travel)."
        )
    else:
        against = (
            f"the median of {len(study.old_totals)} tied sequences of least travel time "
            f"({number(study.old_time_s, 2)} s of approximate travel each), whose costs range from "
            f"{number(low)} to {number(high)}: against the cheapest {_change(here, low)} %, "
            f"against the dearest {_change(here, high)} %."
        )
    return (
        f"{STATION_WORDS[study.station]} {len(study.studs)} studs. The new sequence costs "
        f"**{signed(-study.saving_percent)} %** against {against}{_near(study)} The paper "
        f"prints {published} %: a property of its station and of the one old sequence that it "
        "compares with; neither is published."
    )


def _near(study: StudWeldingStudy) -> str:
    if not study.near_totals:
        return ""
    if len(study.near_totals) == 1:
        return f" Another at most {NEAR_PERCENT:g} % slower costs {number(study.near_totals[0])}."
    return (
        f" {len(study.near_totals)} others at most {NEAR_PERCENT:g} % slower cost "
        f"{number(min(study.near_totals))} to {number(max(study.near_totals))}."
    )


def _change(value: float, base: float) -> str:
    return signed(100.0 * (value / base - 1.0))


def table_1(study: StudWeldingStudy) -> str:
    """Alternatives and weld costs, the paper's beside them."""
    paper = paper_tables()["studs"]
    rows = []
    for place, row in enumerate(study.studs):
        theirs = paper[place] if place < len(paper) else None
        rows.append(
            [
                row.stud,
                str(row.alternatives),
                f"[{number(row.lowest_cost, 2)}, {number(row.highest_cost, 2)}]",
                "–" if theirs is None else str(theirs[1]),
                "–" if theirs is None else f"[{theirs[2]:g}, {theirs[3]:g}]",
            ]
        )
    low = sum(row.lowest_cost for row in study.studs)
    high = sum(row.highest_cost for row in study.studs)
    others = "" if len(paper) == len(study.studs) else f" ({len(paper)} studs)"
    rows.append(
        [
            "all",
            str(sum(row.alternatives for row in study.studs)),
            f"[{number(low)}, {number(high)}]",
            f"{sum(row[1] for row in paper)}{others}",
            f"[{number(sum(row[2] for row in paper))}, "
            f"{number(sum(row[3] for row in paper))}]{others}",
        ]
    )
    theirs_low, theirs_high = sum(row[2] for row in paper), sum(row[3] for row in paper)
    published = paper_tables()
    standing = [
        100.0 * (cost - least) / (most - least) if most > least else 0.0
        for cost, least, most in (
            (study.old.welding, low, high),
            (study.new.welding, low, high),
            (published["old_sequence"]["welding"], theirs_low, theirs_high),
            (published["new_sequence"]["welding"], theirs_low, theirs_high),
        )
    ]
    return markdown_table(
        ["stud", "alternatives", "weld cost", "paper: alternatives", "paper: cost"], rows
    ) + (
        f"\n\nBetween the sum of the cheapest poses (0 %) and of the dearest (100 %) the welding "
        f"of the old sequence stands at {number(standing[0])} %, of the new at "
        f"{number(standing[1])} %; in the paper at {number(standing[2])} % and "
        f"{number(standing[3])} %. The paper's station is another one: the columns stand side by "
        "side for the pattern, not stud for stud."
    )


def table_2(study: StudWeldingStudy) -> str:
    """Travel, welding, total of both sequences, final motions."""
    paper = paper_tables()
    keys = ("travel", "welding", "total")
    rows = []
    for name, ours, theirs in (
        ("old sequence (median)", study.old, paper["old_sequence"]),
        ("new sequence", study.new, paper["new_sequence"]),
    ):
        rows.append([name, *_cost_cells(ours), *(number(theirs[key]) for key in keys)])
    old, new = study.old.to_dict(), study.new.to_dict()
    rows.append(
        [
            "saving %",
            *(number(_saving(old[key], new[key])) for key in keys),
            *(
                number(_saving(paper["old_sequence"][key], paper["new_sequence"][key]))
                for key in keys
            ),
        ]
    )
    orders = (
        f"\n\nOld order: {' → '.join(study.old_order)}.\n\n"
        f"New order: {' → '.join(study.new_order)}."
    )
    header = ["", *keys, "paper: travel", "welding", "total"]
    return markdown_table(header, rows) + orders


def _saving(old: float, new: float) -> float | None:
    return 100.0 * (1.0 - new / old) if old else None


def _cost_cells(cost: CycleCost | None) -> Sequence[str]:
    if cost is None:
        return "–", "–", "–"
    return number(cost.travel), number(cost.welding), number(cost.total)


def ablation_table(study: StudWeldingStudy) -> str:
    """The rows of the ablation."""
    rows = [
        [
            row.name,
            *_cost_cells(row.cost),
            signed(row.against_old_percent),
            signed(row.against_new_percent),
        ]
        for row in study.ablation
    ]
    late = ""
    if any((row.against_new_percent or 0.0) < -0.05 for row in study.ablation):
        late = (
            " A row below the new sequence: planning ended with a conditional gap, and the edges "
            "of that row were solved afterwards."
        )
    return markdown_table(
        ["sequence", "travel", "welding", "total", "against old %", "against new %"], rows
    ) + (
        "\n\nAll rows with certified motions of screening quality (20 intervals), so that they "
        "compare; Table 2 has final ones." + late
    )


def signed(value: float | None) -> str:
    """A percentage with its sign; what rounds to zero has a plus."""
    return "–" if value is None else f"{round(value, 1) + 0.0:+.1f}"


def shares_table(shares: Shares) -> str:
    """Parts of the saving of one comparison."""
    rows = [
        [part, number(value), number(shares.percent(part))] for part, value in shares.parts.items()
    ]
    rows.append(["**all**", number(shares.total), "100.0" if shares.total > 0 else "–"])
    return f"Compared: {shares.from_}.\n\n" + markdown_table(["part", "J saved", "share %"], rows)


def share_words(study: StudWeldingStudy) -> str:
    """How the split is defined, and the other split: standing still against moving."""
    if not study.shares:
        return "No mixed sequence has motions throughout: the saving cannot be split."
    saved = study.old.total - study.new.total
    text = (
        "Shapley values: what a part gives, averaged over all orders in which the parts can be "
        "exchanged; they add up exactly."
    )
    if any(value < 0.0 for shares in study.shares for value in shares.parts.values()):
        text += " A negative part makes the cycle dearer on that average, to the gain of another."
    if saved > 0:
        still = 100.0 * (study.old.welding - study.new.welding) / saved
        text += f" Of the saving in Table 2, {number(still)} % falls while the robot stands still."
    return text


def changes_table(study: StudWeldingStudy) -> str:
    """One row per changed assumption."""
    rows = []
    for row in study.changes:
        rows.append(
            [
                row.name,
                _total(row.old),
                _total(row.nominal),
                number(row.best.total),
                signed(None if row.saving_percent is None else -row.saving_percent),
                number(row.regret_percent),
                number(row.conditional_gap_percent),
                number(row.common_neighbours_percent, 0),
                f"{row.same_poses}/{len(row.order)}",
            ]
        )
    header = [
        "change",
        "old",
        "nominal sequence",
        "best found",
        "against old %",
        "regret %",
        "conditional gap %",
        "neighbours kept %",
        "poses kept",
    ]
    said: dict[str, list[str]] = {}
    for row in study.changes:
        if row.note:
            said.setdefault(row.note, []).append(row.name)
    notes = "".join(f"\n\n{', '.join(names)}: {note}." for note, names in said.items())
    return markdown_table(header, rows) + (
        "\n\nRegret: what keeping the nominal sequence costs if the change is true. A regret below "
        "the conditional gap says only that nothing better was found; –: the search ended before "
        "it had one. Neighbours kept: pairs of studs welded one after the other in both sequences. "
        "Where only motions without friction are known, friction raises or lowers their price; "
        "motions made for it would cost less." + notes
    )


def _total(cost: CycleCost | None) -> str:
    return "–" if cost is None else number(cost.total)


def departures_table(study: StudWeldingStudy) -> str:
    """Travel costs for each way of leaving."""
    if not study.departures:
        return "Not computed."
    names = list(study.departures[0].travel)
    rows = [
        [
            row.name,
            number(row.end_speed_m_s, 2),
            number(row.ratio, 2),
            *(number(row.travel[name]) for name in names),
        ]
        for row in study.departures
    ]
    header = ["way to leave", "tip speed m/s", "new: ratio", *names]
    cheapest = {row.name: row.cheapest for row in study.departures}
    if len(set(cheapest.values())) == 1:
        words = f" Welds included, {study.departures[0].cheapest} is the cheapest in every row."
    else:
        each = "; ".join(f"{way}: {name}" for way, name in cheapest.items())
        words = f" The cheapest, welds included: {each}."
    return markdown_table(header, rows) + (
        "\n\nTravel cost of each sequence without obstacles. The plan itself chooses one to four "
        "twentieths for each motion. Other lengths of the line are among the changed assumptions "
        "above." + words
    )


def trade_off_table(study: StudWeldingStudy) -> str:
    """Points sorted by cycle time."""
    rows = []
    for point in sorted(study.trade_offs, key=lambda p: (p.use.duration_s, p.name, p.sequence)):
        use = point.use
        rows.append(
            [
                f"{point.name}, {point.sequence}",
                number(use.duration_s, 2),
                number(use.motion_s, 2),
                number(use.effort / 1e6),
                number(use.drive_j / 1e3, 2),
                number(use.net_j / 1e3, 2),
                number(use.total_j / 1e3, 2),
                "yes" if point.on_front else "",
            ]
        )
    header = [
        "point",
        "cycle s",
        "motion s",
        "∫uᵀu 10⁶ N²m²s",
        "drives kJ",
        "net kJ",
        "with base kJ",
        "on front",
    ]
    return markdown_table(header, rows) + (
        "\n\nDrives: drawn from the link, braking energy shared between the axes but not given "
        "back; net: all of it given back; with base: drives and the constant consumption. The "
        "front is of cycle time and energy with base. Welds are held by the motors. The drive "
        "model is assumed."
    )


def assumed(study: StudWeldingStudy) -> str:
    """The tags of the station's numbers, and what is ours in the old method."""
    words = (
        "The old method's own data (travel times, tie-breaking) are not published: here it "
        "minimises the sum of the slowest joint's times between poses, and both sequences get the "
        "same kind of motions. The robot's own tags are in the report of each cycle."
    )
    rows = [[key, tag] for key, tag in study.provenance.items()]
    return words if not rows else markdown_table(["number", "where from"], rows) + "\n\n" + words
