"""Figures 1 and 2 of the paper: clearance in configuration space and the boxes of three stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Rectangle

from dmoc.arrays import Array
from dmoc.refinement import RefineRecord

Distance = Callable[[Array], Array]


def draw_clearance(
    axis: Axes, distance: Distance, span_rad: Sequence[tuple[float, float]], points: int = 161
) -> None:
    """Contours of φ [m] over a two-joint slice; what collides is filled.

    `distance` takes rows of the slice (K, 2) and returns φ (K,); `span_rad` is the range of each
    joint.
    """
    first, second = (np.linspace(*span, points) for span in span_rad)
    grid = np.stack(np.meshgrid(first, second), axis=-1)
    phi = distance(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    axis.contourf(first, second, phi, levels=[-10.0, 0.0], colors=["0.75"])
    lines = axis.contour(
        first, second, phi, levels=[0.0, 0.02, 0.1, 0.2, 0.3, 0.4], colors="0.5", linewidths=0.7
    )
    axis.clabel(lines, fmt="%g m", fontsize=6)
    axis.set_xlabel("joint 1 [rad]")
    axis.set_ylabel("joint 2 [rad]")


def draw_curve(axis: Axes, record: RefineRecord, **style: object) -> None:
    """Knots and interpolant of one iterate in the slice of its first two joints."""
    q, v, h = record.q_rad, record.velocity_rad_s, record.step_s
    s = np.linspace(0.0, 1.0, 12, endpoint=False)[:, None, None]
    curve = (
        (1 + 2 * s) * (1 - s) ** 2 * q[:-1]
        + s * (1 - s) ** 2 * h * v[:-1]
        + s * s * (3 - 2 * s) * q[1:]
        + s * s * (s - 1) * h * v[1:]
    )
    line = np.vstack([curve.transpose(1, 0, 2).reshape(-1, q.shape[1]), q[-1:]])
    shown: dict[str, object] = {"color": "C0", "linewidth": 1.2} | style
    axis.plot(line[:, 0], line[:, 1], **shown)  # type: ignore[arg-type]
    axis.plot(q[:, 0], q[:, 1], ".", color=str(shown["color"]), markersize=4)


def draw_boxes(axis: Axes, record: RefineRecord) -> None:
    """The boxes in which the knots of this iterate were free to move."""
    boxes = [
        Rectangle((low[0], low[1]), high[0] - low[0], high[1] - low[1])
        for low, high in zip(record.lower_rad, record.upper_rad)
        if np.all(high > low)
    ]
    axis.add_collection(
        PatchCollection(boxes, facecolor=(0.12, 0.47, 0.71, 0.12), edgecolor="C0", linewidth=0.6)
    )


def three_stages(records: Sequence[RefineRecord]) -> tuple[RefineRecord, ...]:
    """First, middle and last accepted iterate: stages I, II and III."""
    accepted = [record for record in records if record.accepted]
    return accepted[0], accepted[len(accepted) // 2], accepted[-1]
