"""Pictures of a cycle in its station: the studs with both ways of the tool, and a slice of φ."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dmoc.arrays import Array
from planning.collision.world import EdgeClearance
from sequencing.cycle_types import Cycle
from sequencing.report.curves import COLOURS
from sequencing.report.scene_frames import tip_path
from sequencing.runs.clock import timeline
from studies.stud_welding.paper_figures import draw_boxes, draw_clearance, draw_curve, three_stages
from studies.stud_welding.stages import Stages, projected, slice_through


def draw_tip_paths(axes: Any, cycle: Cycle, colour: str, label: str) -> None:
    """The tool tip's way through the cycle and the studs in their order; `axes` is a 3-D plot."""
    line, robot = timeline(cycle.welds, cycle.motions), cycle.station.robot
    segments, _ = tip_path(line, robot, samples=30)
    joined = np.full((len(segments), 3, 3), np.nan)
    joined[:, :2] = segments
    axes.plot(*joined.reshape(-1, 3).T, color=colour, lw=1.0, label=label)
    number = line.weld_number()
    places = np.array([stud.position_m for stud in cycle.station.studs])
    axes.scatter(*places.T, color="0.2", s=12, depthshade=False)
    for stud in cycle.station.studs:
        axes.text(*stud.position_m, f" {number[stud.id]}", fontsize=7, color=colour)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_aspect("equal")


def draw_slice(axes: Axes, clearance: EdgeClearance, q_rad: Array, points: int = 81) -> None:
    """Fig. 1: contours of φ [m] in the plane nearest to a motion's knots (K, n), and the motion."""
    middle, first, second = slice_through(q_rad)
    flat = (q_rad - middle) @ np.stack([first, second], axis=1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    margin = 0.25 * float(np.max(high - low))

    def distance(rows: Array) -> Array:
        return clearance.phi(middle + rows[:, :1] * first + rows[:, 1:] * second)

    draw_clearance(
        axes, distance, [(low[k] - margin, high[k] + margin) for k in (0, 1)], points=points
    )
    axes.plot(*flat.T, ".-", color=COLOURS[0], label="certified motion")
    axes.plot(*flat[[0, -1]].T, "o", color=COLOURS[1], label="welds")
    axes.set(xlabel="along the motion [rad]", ylabel="across [rad]")
    axes.legend(fontsize=8)


def draw_stages(axes: Any, stages: Stages) -> tuple[int, int]:
    """Fig. 2: boxes and iterates of three stages in the two joints that turn most."""
    turn = np.ptp(stages.records[-1].q_rad, axis=0)
    joints = (int(np.argsort(turn)[-1]), int(np.argsort(turn)[-2]))
    chosen = three_stages(stages.records)
    for axis, record, name in zip(axes, chosen, ("I", "II", "III")):
        shown = projected(record, joints)
        draw_boxes(axis, shown)
        axis.plot(*stages.seed_rad[:, list(joints)].T, ":", color="0.4")
        draw_curve(axis, shown)
        axis.set(
            title=f"stage {name}: J = {record.cost:.1f}", xlabel=f"joint {joints[0] + 1} [rad]"
        )
    axes[0].set_ylabel(f"joint {joints[1] + 1} [rad]")
    return joints
