"""What an identification says, as tables and as one page with curves."""

from __future__ import annotations

import base64
import io
from html import escape
from importlib import resources
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dmoc.identification.identifying import Identification
from dmoc.identification.samples import samples_of
from sequencing.report.curves import COLOURS
from sequencing.report.markup import markdown_html
from sequencing.runs.archive import write_atomic
from sequencing.runs.tables import markdown_table, named, number


def identification_markdown(result: Identification) -> str:
    """Joints, runs and links; what was found doubtful, and what such logs cannot tell."""
    names = [named(name) for name in list(result.problem.robot.model.names)[1:]]
    judged = "held-out runs" if result.held_out else "the fitted runs (hold one out: --hold)"
    parts = [f"Status: {result.status}. Judged on {judged}, samples in motion."]
    rows = []
    for j, name in enumerate(names):
        row = [name]
        for block, digits in (("coulomb", 1), ("viscous", 1), ("armature", 2)):
            part = result.layout.block(block)
            tag = "" if result.measured[part][j] else " (not determined)"
            text = f"{number(result.parameters[part][j], digits)} ± "
            row.append(text + number(2 * result.std[part][j], digits) + tag)
        for run in result.scores:
            row.append(f"{number(run.rel_percent[j])} % / {number(run.rms_nm[j])} Nm")
        rows.append(row)
    head = ["joint", "Coulomb [Nm]", "viscous [Nms/rad]", "rotor [kg m²]"]
    parts.append(markdown_table([*head, *(named(run.name) for run in result.scores)], rows))
    energy = [
        [
            named(run.name),
            number(run.energy_j),
            f"{run.energy_percent:+.1f} %",
            f"{run.assumed_energy_percent:+.1f} %",
        ]
        for run in result.scores
    ]
    head = ["run", "mechanical energy [J]", "model", "robot file + assumed class"]
    parts.append(markdown_table(head, energy))
    links = []
    for j, name in enumerate(names):
        mass, old = result.parameters[10 * j], result.prior[10 * j]
        tag = "measured" if result.measured[10 * j] else "as the prior has it"
        links.append([name, number(old, 2), number(mass, 2), f"{mass / old:.2f}", tag])
    head = ["link of", "robot file [kg]", "fitted [kg]", "ratio", "mass is"]
    parts.append(markdown_table(head, links))
    doubts = [f"- {named(fault)}" for fault in (*result.faults, *result.warnings)]
    parts += ["\n".join(doubts)] if doubts else []
    parts.append("\n".join(f"- not identifiable: {text}" for text in result.unidentifiable))
    return "\n\n".join(parts)


def write_page(result: Identification, path: Path) -> Path:
    """report.html: the tables, and predicted against measured torque of every joint."""
    style = (resources.files("sequencing.report") / "templates" / "report.css").read_text("utf-8")
    image = base64.b64encode(_curves(result)).decode("ascii")
    title = escape(f"{result.problem.robot.name}: identified dynamics")
    page = (
        f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>\n{style}</style></head>\n<body>\n<h1>{title}</h1>\n"
        f"{markdown_html(identification_markdown(result))}\n"
        f'<img alt="torque and friction of every joint" src="data:image/png;base64,{image}">\n'
        "</body>\n</html>\n"
    )
    write_atomic(path, page)
    return path


def _curves(result: Identification) -> bytes:
    problem = result.problem
    log = (problem.held or problem.logs)[0]
    run = samples_of(log, problem.cutoff_hz, result.delay_s)
    predicted = result.torque_nm(run)
    time = run.step_s * np.arange(len(predicted))
    names = list(problem.robot.model.names)[1:]
    figure = Figure(figsize=(13, 2.2 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), 2, squeeze=False, width_ratios=(3, 1))
    covered = result.covered["velocity_rad_s"]
    for j, name in enumerate(names):
        left, right = grid[j]
        left.plot(time, run.torque_nm[:, j], color=COLOURS[0], lw=1.0, label="measured")
        left.plot(time, predicted[:, j], color=COLOURS[1], lw=1.0, label="predicted")
        left.plot(time, run.torque_nm[:, j] - predicted[:, j], color="0.6", lw=0.7, label="rest")
        left.set_ylabel(f"{name} [Nm]")
        speed = np.linspace(-covered[j], covered[j], 101)
        friction = result.named("coulomb")[j] * np.sign(speed) + result.named("viscous")[j] * speed
        right.plot(speed, friction, color=COLOURS[2])
        right.set_ylabel("friction [Nm]")
    grid[0, 0].legend(ncols=3, frameon=False)
    grid[-1, 0].set_xlabel(f"time in {log.name} [s]")
    grid[-1, 1].set_xlabel("speed [rad/s], as covered")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90, metadata={"Software": None})
    return buffer.getvalue()
