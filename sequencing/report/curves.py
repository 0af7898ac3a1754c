"""Pictures of the cycle: position, velocity and torque of every joint as shares of their limits."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from sequencing.runs.archive import write_atomic
from sequencing.runs.clock import CycleTimeline, trajectory_of

# Okabe and Ito's palette: told apart with any kind of colour vision.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31")
_WELD = "#e8e4d8"


def write_curves(line: CycleTimeline, robot: Robot, path: Path, title: str = "") -> Path:
    """Write the picture of `plot_cycle` as PNG; the bytes depend on the arguments only."""
    write_atomic(path, curves_png(line, robot, title))
    return path


def curves_png(line: CycleTimeline, robot: Robot, title: str = "", dpi: int = 110) -> bytes:
    """PNG bytes of `plot_cycle`."""
    figure = plot_cycle(line, robot, title)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def plot_cycle(line: CycleTimeline, robot: Robot, title: str = "") -> Figure:
    """Three panels over the cycle: joints between their limits, velocity, torque.

    Lines are the common interpolant; in the torque panel the transcription's torque, constant on
    every interval, stands behind it as a pale line. Shaded: welds, with the studs' names.
    """
    figure = Figure(figsize=(13, 8.5), layout="constrained")
    position, velocity, torque = figure.subplots(3, 1, sharex=True)
    times = _sample_times(line)
    state = line.at(times, robot)
    middle = (robot.q_upper_rad + robot.q_lower_rad) / 2
    half = (robot.q_upper_rad - robot.q_lower_rad) / 2
    assert state.torque_nm is not None
    panels = [
        (position, (state.q_rad - middle) / half, "joint position\n(−1, 1: limits)"),
        (velocity, state.velocity_rad_s / robot.velocity_limit_rad_s, "velocity / limit"),
        (torque, state.torque_nm / robot.torque_limit_nm, "torque / limit"),
    ]
    names = list(robot.model.names)[1:]
    for axes, values, label in panels:
        _shade_welds(axes, line)
        for j, name in enumerate(names):
            axes.plot(times, values[:, j], color=COLOURS[j % len(COLOURS)], lw=1.1, label=name)
        axes.set_ylabel(label)
        axes.axhline(0.0, color="0.6", lw=0.6)
        reach = max(1.0, float(np.max(np.abs(values))))
        for limit in (-1.0, 1.0):
            axes.axhline(limit, color="0.3", lw=0.8, ls="--")
        axes.set_ylim(-1.06 * reach, 1.06 * reach)
        axes.grid(axis="x", color="0.92", lw=0.5)
    _controls(torque, line, robot)
    _name_welds(position, line)
    torque.set_xlabel("time in the cycle [s]")
    torque.set_xlim(0.0, max(line.duration_s, 1e-9))
    figure.legend(*position.get_legend_handles_labels(), loc="outside right upper", frameon=False)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def _sample_times(line: CycleTimeline) -> Array:
    """Times of every knot and three between, and both ends of every segment."""
    parts: list[Any] = []
    for segment in line.segments:
        if segment.kind == "weld":
            parts.append([segment.start_s, segment.end_s - 1e-9])
            continue
        curve = trajectory_of(line.motions[segment.index])
        knots = curve.t_s - curve.t_s[0] + segment.start_s
        inner = knots[:-1, None] + np.diff(knots)[:, None] * np.array([0.0, 0.25, 0.5, 0.75])
        parts += [inner.ravel(), [segment.end_s - 1e-9]]
    return np.concatenate(parts) if parts else np.zeros(1)


def _shade_welds(axes: Axes, line: CycleTimeline) -> None:
    for segment in line.segments:
        if segment.kind == "weld":
            axes.axvspan(segment.start_s, segment.end_s, color=_WELD, lw=0, zorder=0)


def _name_welds(axes: Axes, line: CycleTimeline) -> None:
    for segment in line.segments:
        if segment.kind == "weld":
            middle = 0.5 * (segment.start_s + segment.end_s)
            axes.annotate(
                segment.label,
                (middle, 1.0),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize=7,
                color="0.35",
                annotation_clip=False,
                rotation=90 if len(line.welds) > 12 else 0,
            )


def _controls(axes: Axes, line: CycleTimeline, robot: Robot) -> None:
    for segment in line.segments:
        if segment.kind != "motion":
            continue
        curve = trajectory_of(line.motions[segment.index])
        edges = curve.t_s - curve.t_s[0] + segment.start_s
        for j in range(curve.q_rad.shape[1]):
            axes.stairs(
                curve.torque_nm[:, j] / robot.torque_limit_nm[j],
                edges,
                baseline=None,
                color=COLOURS[j % len(COLOURS)],
                lw=2.2,
                alpha=0.28,
            )
