"""report.html: a finished run on one page that needs nothing beside it."""

from __future__ import annotations

import base64
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

from dmoc.robot.robot import Robot
from sequencing.report.curves import curves_png
from sequencing.report.markup import markdown_html
from sequencing.runs.archive import write_atomic
from sequencing.runs.folder import Run
from sequencing.runs.tables import markdown_table, number, tables_markdown


def write_report(run: Run, robot: Robot, path: Path) -> Path:
    """Write `report_html` to `path` in one step and return the path."""
    write_atomic(path, report_html(run, robot))
    return path


def report_html(run: Run, robot: Robot) -> str:
    """The page: tables, curves (embedded), order of welding, search rounds, inputs, versions.

    Where `scene.html` lies beside the page, its link opens the moving scene.
    """
    result = dict(run.result)
    style = (resources.files("sequencing.report") / "templates" / "report.css").read_text("utf-8")
    image = base64.b64encode(curves_png(run.timeline, robot)).decode("ascii")
    parts = [
        markdown_html(tables_markdown(result)),
        "<h2>The cycle</h2>" if run.planned else "<h2>The motions</h2>",
        f'<img alt="joint position, velocity and torque over the cycle" '
        f'src="data:image/png;base64,{image}">',
    ]
    if run.planned:
        parts.insert(2, f"<p>{escape(order_text(run))}</p>")
        parts += [
            '<p><a href="scene.html">Moving 3-D scene</a> (scene.html in the same folder)</p>',
            "<h2>Search</h2>",
            markdown_html(rounds_table(result)),
        ]
    parts += ["<h2>Inputs and versions</h2>", inputs_html(result)]
    title = escape(f"{run.name}: report")
    return (
        f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>\n{style}</style></head>\n<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def order_text(run: Run) -> str:
    """The studs in order with their alternatives."""
    order = " → ".join(f"{weld.stud} (alternative {weld.alternative})" for weld in run.welds)
    return f"Order: {order}. Shaded in the picture: the welds."


def rounds_table(result: dict[str, Any]) -> str:
    """The rounds of the search as a table; its columns are those the search recorded."""
    rounds = result["search"]["rounds"]
    if not rounds:
        return "No rounds were needed."
    names = list(rounds[0])
    rows = [[_cell(item.get(name)) for name in names] for item in rounds]
    return markdown_table([name.replace("_", " ") for name in names], rows)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return number(value, 3)
    return "–" if value is None else str(value).replace("|", "/")


def inputs_html(result: dict[str, Any]) -> str:
    """Fingerprints, checksums and versions: what must be equal for the same numbers."""
    lines = [f"seed {result['seed']}"]
    lines += [] if result["method"] is None else [f"method {result['method']}"]
    lines += [f"{k} {v}" for k, v in result["inputs"].items() if isinstance(v, str)]
    lines += [f"{name} sha256 {digest}" for name, digest in result["inputs"]["files"].items()]
    lines += [f"{name} {version}" for name, version in result["versions"].items()]
    return '<p class="dim">' + "<br>".join(escape(line) for line in lines) + "</p>"
