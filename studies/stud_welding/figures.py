"""Figures of the stud-welding study; each draws on the axes it is given."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MultipleLocator, NullFormatter, ScalarFormatter

from sequencing.report.curves import COLOURS
from studies.stud_welding.paper import paper_tables
from studies.stud_welding.types import NEAR_PERCENT, StudWeldingStudy

BLUE, RED, GREEN, GREY = COLOURS[0], COLOURS[1], COLOURS[2], "0.55"


def draw_weld_costs(axes: Axes, study: StudWeldingStudy) -> None:
    """Table 1 as ranges: ours and the paper's, stud by stud."""
    paper = paper_tables()["studs"][: len(study.studs)]
    place = np.arange(len(study.studs))
    for x, row in zip(place, study.studs):
        axes.plot(
            [x - 0.15] * 2,
            [row.lowest_cost, row.highest_cost],
            color=BLUE,
            lw=4,
            solid_capstyle="butt",
            label="station" if x == 0 else None,
        )
    for x, row in zip(place, paper):
        axes.plot(
            [x + 0.15] * 2,
            row[2:],
            color=GREY,
            lw=4,
            solid_capstyle="butt",
            marker="_",
            label="paper (another station)" if x == 0 else None,
        )
    axes.set_xticks(place, [row.stud for row in study.studs], rotation=90)
    axes.set(ylabel="weld cost over the poses", yscale="log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.legend()


def draw_old_sequences(axes: Axes, study: StudWeldingStudy) -> None:
    """Cost of every tied sequence of least time, the median, and the new sequence."""
    totals = sorted(study.old_totals)
    axes.plot(
        totals,
        np.arange(1, len(totals) + 1),
        "o",
        color=RED,
        label="sequences of least travel time",
    )
    if study.near_totals:
        axes.plot(
            study.near_totals,
            np.arange(1, len(study.near_totals) + 1),
            "x",
            color=GREY,
            label=f"at most {NEAR_PERCENT:g} % slower",
        )
    axes.axvline(study.old.total, color=RED, lw=1, ls="--", label="their median, final motions")
    axes.axvline(study.new.total, color=BLUE, lw=2, label="new sequence")
    axes.set(
        xlabel="J of the cycle",
        ylabel="sequence",
        ylim=(0, max(len(totals), len(study.near_totals)) + 1),
    )
    axes.yaxis.set_major_locator(MultipleLocator(1.0))
    axes.legend()


def draw_ablation(axes: Axes, study: StudWeldingStudy) -> None:
    """Totals of the ablation, travel and welding stacked."""
    rows = [row for row in study.ablation if row.cost is not None]
    place = np.arange(len(rows))
    travel = [row.cost.travel for row in rows if row.cost is not None]
    welding = [row.cost.welding for row in rows if row.cost is not None]
    axes.barh(place, travel, color=BLUE, label="travel")
    axes.barh(place, welding, left=travel, color=COLOURS[4], label="welding")
    for y, row in enumerate(rows):
        if row.cost is not None and row.against_old_percent is not None:
            axes.text(row.cost.total, y, f" {row.against_old_percent:+.1f} %", va="center")
    axes.set_yticks(place, [row.name for row in rows])
    axes.invert_yaxis()
    axes.set(xlabel="J of the cycle")
    axes.margins(x=0.18)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=2, frameon=False)


def draw_shares(axes: Axes, study: StudWeldingStudy) -> None:
    """Parts of the saving of both comparisons."""
    colours = {"poses": BLUE, "order": COLOURS[4], "motions": GREEN}
    labels: set[str] = set()
    for y, shares in enumerate(study.shares):
        left = 0.0
        for part, value in shares.parts.items():
            name = None if part in labels else part
            labels.add(part)
            axes.barh(y, value, left=left, color=colours[part], label=name)
            left += value
    axes.set_yticks(
        range(len(study.shares)),
        ["optimal motions\non both sides", "old at full speed"][: len(study.shares)],
    )
    axes.invert_yaxis()
    axes.set(xlabel="J saved (Shapley values)")
    if labels:
        axes.legend()


def draw_changes(axes: Axes, study: StudWeldingStudy) -> None:
    """Saving and regret under each changed assumption."""
    place = np.arange(len(study.changes))
    saving = [np.nan if r.saving_percent is None else r.saving_percent for r in study.changes]
    regret = [np.nan if r.regret_percent is None else r.regret_percent for r in study.changes]
    axes.axvline(study.saving_percent, color=BLUE, lw=1, ls="--", label="nominal saving")
    axes.plot(saving, place, "o", color=BLUE, label="saving of the best found against old")
    axes.plot(regret, place, "s", color=RED, label="regret of the nominal sequence")
    axes.set_yticks(place, [row.name for row in study.changes])
    axes.invert_yaxis()
    axes.set(xlabel="%")
    axes.grid(axis="x", lw=0.4)
    axes.legend(loc="best")


def draw_departures(axes: Axes, study: StudWeldingStudy) -> None:
    """Travel cost by way of leaving, one bar per sequence."""
    if not study.departures:
        return
    names = list(study.departures[0].travel)
    place, width = np.arange(len(study.departures)), 0.8 / len(names)
    for k, name in enumerate(names):
        values = [row.travel[name] or np.nan for row in study.departures]
        axes.barh(
            place + (k - (len(names) - 1) / 2) * width,
            values,
            width,
            label=name,
            color=COLOURS[k % len(COLOURS)],
        )
    axes.set_yticks(place, [row.name for row in study.departures])
    axes.invert_yaxis()
    axes.set(xlabel="travel cost without obstacles")
    axes.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)


def draw_trade_offs(energy: Axes, effort: Axes, study: StudWeldingStudy) -> None:
    """Cycle time against electrical energy and against effort."""
    style = {"new": ("o", BLUE), "re-optimised": ("^", GREEN), "old": ("s", RED)}
    for kind, (marker, colour) in style.items():
        # Full speed is no weight: it stands apart from the line of weights.
        mine = [p for p in study.trade_offs if p.sequence == kind]
        for p in (p for p in mine if p.time_weight is None):
            energy.plot(p.use.duration_s, p.use.total_j / 1e3, marker, color=colour)
            effort.plot(p.use.duration_s, p.use.effort / 1e6, marker, color=colour)
        points = sorted(
            (p for p in mine if p.time_weight is not None), key=lambda p: p.use.duration_s
        )
        time = [p.use.duration_s for p in points]
        label = f"{kind} sequence"
        energy.plot(
            time, [p.use.total_j / 1e3 for p in points], marker, ls=":", color=colour, label=label
        )
        effort.plot(
            time, [p.use.effort / 1e6 for p in points], marker, ls=":", color=colour, label=label
        )
    for p in study.trade_offs:
        if p.sequence != "re-optimised":
            text = "full speed" if p.time_weight is None else f"{p.time_weight:g}"
            energy.annotate(
                text,
                (p.use.duration_s, p.use.total_j / 1e3),
                fontsize=7,
                xytext=(4, 4),
                textcoords="offset points",
            )
    energy.set(xlabel="cycle time [s]", ylabel="electrical energy, base load included [kJ]")
    effort.set(xlabel="cycle time [s]", ylabel="∫uᵀu dt [10⁶ N²m²s]")
    energy.legend()


def study_figures(study: StudWeldingStudy) -> dict[str, bytes]:
    """All figures as PNG by file name; the bytes depend on the study only."""
    single = {
        "weld_costs": (draw_weld_costs, (10, 4)),
        "old_sequences": (draw_old_sequences, (8, 4)),
        "ablation": (draw_ablation, (9, 4)),
        "shares": (draw_shares, (8, 2.6)),
        "changes": (draw_changes, (8, 6)),
        "departures": (draw_departures, (8, 6)),
    }
    found = {}
    for name, (draw, size) in single.items():
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.subplots(), study)
        found[f"{name}.png"] = _png(figure)
    figure = Figure(figsize=(12, 4.5), layout="constrained")
    energy, effort = figure.subplots(1, 2)
    draw_trade_offs(energy, effort, study)
    return found | {"trade_offs.png": _png(figure)}


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()
