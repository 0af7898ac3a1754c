"""Everything the stud-welding study writes: study.json, study.md, study.html, CSV, figures."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

from sequencing.report.markup import markdown_html
from sequencing.runs.archive import csv_text, json_text, write_atomic
from studies.stud_welding.figures import study_figures
from studies.stud_welding.tables import stud_welding_markdown
from studies.stud_welding.types import StudWeldingStudy

#: Which figure stands under which heading of study.md.
PLACES = {
    "Table 1": "weld_costs.png",
    "Table 2": "old_sequences.png",
    "What each part": "ablation.png",
    "Where the saving": "shares.png",
    "What if the": "changes.png",
    "Leaving and": "departures.png",
    "Cycle time": "trade_offs.png",
}


def study_entry(study: StudWeldingStudy) -> dict[str, Any]:
    """The object of study.json: the study's fields, its saving and the shares in percent."""
    entry = asdict(study)
    entry["saving_percent"] = study.saving_percent
    for shares, row in zip(study.shares, entry["shares"]):
        row["total"] = shares.total
        row["percent"] = {part: shares.percent(part) for part in shares.parts}
    return entry


def write_study(study: StudWeldingStudy, out: Path) -> tuple[Path, ...]:
    """Write all files of the study to `out`; returns their paths. Same study, same bytes."""
    figures = study_figures(study)
    files: dict[str, str | bytes] = {
        "study.json": json_text(study_entry(study)),
        "study.md": stud_welding_markdown(study),
        "study.html": study_page(study, figures),
        **{f"figures/{name}": data for name, data in figures.items()},
        **{f"tables/{name}": text for name, text in study_csv(study).items()},
    }
    for name, content in files.items():
        write_atomic(out / name, content)
    return tuple(out / name for name in files)


def study_page(study: StudWeldingStudy, figures: Mapping[str, bytes]) -> str:
    """One page with tables and embedded figures; the scenes are linked."""
    style = (resources.files("sequencing.report") / "templates" / "report.css").read_text("utf-8")
    sections = stud_welding_markdown(study).split("\n## ")
    parts = [markdown_html(sections[0])]
    scenes = (
        '<p>3-D scenes: <a href="scene.html">new sequence</a>, '
        '<a href="old/scene.html">old sequence</a>. <a href="report.html">Report of the new '
        'cycle</a>, <a href="old/report.html">of the old</a>.</p>'
    )
    parts.append(scenes)
    for section in sections[1:]:
        title = section.splitlines()[0]
        parts.append(markdown_html("## " + section))
        for start, name in PLACES.items():
            if title.startswith(start) and name in figures:
                data = base64.b64encode(figures[name]).decode("ascii")
                parts.append(f'<img alt="{title}" src="data:image/png;base64,{data}">')
    wide = "table { display: block; overflow-x: auto; } td:first-child { white-space: nowrap; }"
    return (
        '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        f"<title>Stud welding, station {study.station}</title>\n<style>\n{style}{wide}</style>"
        "</head>\n<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def study_csv(study: StudWeldingStudy) -> dict[str, str]:
    """CSV tables by file name, units in the headers where there are any."""

    def cost(prefix: str, value: Any) -> dict[str, Any]:
        keys = ("travel", "welding", "total")
        return {
            f"{prefix}_{key}": "" if value is None else float(getattr(value, key)) for key in keys
        }

    tables: dict[str, list[dict[str, Any]]] = {
        "table1.csv": [asdict(row) for row in study.studs],
        "table2.csv": [
            {"sequence": "old"} | cost("j", study.old),
            {"sequence": "new"} | cost("j", study.new),
        ],
        "old_sequences.csv": [{"total": total} for total in study.old_totals],
        "ablation.csv": [
            {"sequence": r.name}
            | cost("j", r.cost)
            | {
                "against_old_percent": r.against_old_percent,
                "against_new_percent": r.against_new_percent,
                "order": " ".join(r.order),
            }
            for r in study.ablation
        ],
        "changes.csv": [
            {"group": r.group, "change": r.name}
            | cost("old", r.old)
            | cost("nominal", r.nominal)
            | cost("best", r.best)
            | {
                key: getattr(r, key)
                for key in (
                    "saving_percent",
                    "regret_percent",
                    "conditional_gap_percent",
                    "conditional_factor",
                    "common_neighbours_percent",
                    "same_poses",
                    "edges",
                    "note",
                )
            }
            | {"order": " ".join(r.order)}
            for r in study.changes
        ],
        "departures.csv": [
            {"way": r.name, "end_speed_m_s": r.end_speed_m_s, "ratio": r.ratio} | r.travel
            for r in study.departures
        ],
        "trade_offs.csv": [
            {"point": p.name, "sequence": p.sequence, "time_weight": p.time_weight}
            | asdict(p.use)
            | {"on_front": int(p.on_front)}
            for p in study.trade_offs
        ],
        "shares.csv": [
            {"compared": s.from_, "part": part, "saved": value, "percent": s.percent(part)}
            for s in study.shares
            for part, value in s.parts.items()
        ],
    }
    return {
        name: csv_text(
            list(rows[0]), [["" if v is None else v for v in row.values()] for row in rows]
        )
        for name, rows in tables.items()
        if rows
    }
