"""Tables and map of a search for the robot's place."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from planning.station.station import Station
from sequencing.cycle.placement import Placement, moved_station
from sequencing.runs.tables import markdown_table, number

BEST_SHOWN = 10


def placement_entry(station: Station, item: Placement) -> dict[str, Any]:
    """A placement as plain values; `base_m` is where the base stands in the world."""
    place = item.place
    base = moved_station(station, place).robot.base.translation
    return {
        "shift_m": [place.x_m, place.y_m, place.z_m],
        "yaw_rad": place.yaw_rad,
        "base_m": base.tolist(),
        "estimated_cost": item.cost,
        "alternatives": item.alternatives,
        "fewest_alternatives": item.fewest,
        "unreached": list(item.unreached),
        "reason": item.reason,
    }


def placement_markdown(found: Sequence[Placement]) -> str:
    """The best places and the present one."""
    present = next((k for k, item in enumerate(found) if _is_present(item)), None)
    shown = list(range(min(BEST_SHOWN, len(found))))
    if present is not None and present not in shown:
        shown.append(present)
    rows = [
        [
            str(k + 1) + (" (present)" if k == present else ""),
            *(f"{value:+.3f}" for value in (found[k].place.x_m, found[k].place.y_m)),
            f"{math.degrees(found[k].place.yaw_rad):+.0f}",
            number(found[k].cost if math.isfinite(found[k].cost) else None),
            str(found[k].alternatives),
            str(found[k].fewest),
            _remark(found[k]),
        ]
        for k in shown
    ]
    header = (
        "rank",
        "x [m]",
        "y [m]",
        "turn [°]",
        "estimated J",
        "alternatives",
        "fewest of a stud",
        "remark",
    )
    return markdown_table(header, rows)


def _is_present(item: Placement) -> bool:
    place = item.place
    return (place.x_m, place.y_m, place.z_m, place.yaw_rad) == (0.0, 0.0, 0.0, 0.0)


def _remark(item: Placement) -> str:
    if item.reason:
        return item.reason
    if item.unreached:
        return f"{len(item.unreached)} studs unreached: {', '.join(item.unreached[:4])}" + (
            " …" if len(item.unreached) > 4 else ""
        )
    return ""


def base_block(station: Station, item: Placement) -> str:
    """The lines of station.yaml that put the robot there."""
    base = moved_station(station, item.place).robot.base
    # + 0.0 turns −0 into 0.
    x, y, z, w = (float(value) + 0.0 for value in pin.Quaternion(base.rotation).coeffs())
    position = ", ".join(f"{value:.6g}" for value in base.translation)
    return (
        "robot:\n"
        f"  base: {{position_m: [{position}], "
        f"quaternion_xyzw: [{x:.9g}, {y:.9g}, {z:.9g}, {w:.9g}]}}"
    )


def placement_png(found: Sequence[Placement], name: str) -> bytes:
    """Map of the places at their best turn: colour is the estimated J, crosses miss studs."""
    best: dict[tuple[float, float], Placement] = {}
    for item in found:  # best first
        best.setdefault((item.place.x_m, item.place.y_m), item)
    figure = Figure(figsize=(7.5, 6), layout="constrained")
    axes = figure.subplots()
    good = [item for item in best.values() if math.isfinite(item.cost)]
    poor = [item for item in best.values() if not math.isfinite(item.cost)]
    size = 2.2e4 / max(len(best), 1)
    if good:
        marks = axes.scatter(
            [item.place.x_m for item in good],
            [item.place.y_m for item in good],
            c=[item.cost for item in good],
            s=size,
            marker="s",
            cmap="viridis_r",
        )
        figure.colorbar(marks, ax=axes, label="estimated J of the cycle")
    axes.scatter(
        [item.place.x_m for item in poor],
        [item.place.y_m for item in poor],
        c="#b00020",
        s=60,
        marker="x",
    )
    for item in poor:
        text = "blocked" if item.reason else str(len(item.unreached))
        axes.annotate(
            text,
            (item.place.x_m, item.place.y_m),
            xytext=(4, 4),
            textcoords="offset points",
            fontsize=8,
        )
    axes.plot(
        0.0,
        0.0,
        marker="o",
        markersize=9,
        markerfacecolor="none",
        markeredgecolor="k",
        linestyle="none",
        label="present place",
    )
    if good:
        first = min(good, key=lambda item: item.cost).place
        axes.plot(
            first.x_m,
            first.y_m,
            marker="*",
            markersize=15,
            color="#D55E00",
            linestyle="none",
            label="best place",
        )
    axes.set(
        xlabel="shift of the base in x [m]",
        ylabel="shift in y [m]",
        aspect="equal",
        title=f"{name}: where to stand the robot (× : studs not reached)",
    )
    axes.legend(loc="upper left")
    spread = np.ptp([[item.place.x_m, item.place.y_m] for item in best.values()], axis=0).max()
    axes.margins(0.02 + 0.08 * (spread == 0))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()
