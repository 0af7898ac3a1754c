"""A controller's log beside the plan, for a person."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sequencing.runs.tables import markdown_table, number

# Farther off than this a log is of another motion, or of another robot program.
STRANGE_RAD = 0.1


def measured_markdown(data: Mapping[str, Any]) -> str:
    """Tables of `measured_against_plan`: time, joints, energy; a warning if they do not fit."""
    time, position, current = data["time"], data["position"], data["current"]
    parts = [
        f"{data['run']}: {data['samples']} samples of {data['source']} positions, shifted by "
        f"{number(data['shift_s'], 3)} s; planned {number(time['planned_s'], 3)} s, logged "
        f"{number(time['logged_s'], 3)} s"
    ]
    if max(position["largest_rad"]) > STRANGE_RAD:
        parts.append(
            f"warning: positions differ by up to {max(position['largest_rad']):.2f} rad: is this "
            "the log of this run?"
        )
    header = ["joint", "largest position error [mrad]", "rms [mrad]"]
    rows = [
        [str(j + 1), number(1e3 * largest, 2), number(1e3 * rms, 2)]
        for j, (largest, rms) in enumerate(zip(position["largest_rad"], position["rms_rad"]))
    ]
    if current is not None:
        header += ["planned rms current [A]", "logged [A]", "rms difference [A]"]
        for j, row in enumerate(rows):
            row += [
                number(current[key][j], 2)
                for key in ("planned_rms_a", "logged_rms_a", "difference_rms_a")
            ]
    parts.append(markdown_table(header, rows))
    energy = data["energy"]
    names = (
        ("DC energy, base load included [J]", "planned_with_base_j", "logged_dc_j"),
        ("sum of I·V [J]", "planned_iv_signed_j", "logged_iv_signed_j"),
        ("sum of abs(I)·V [J]", "planned_iv_absolute_j", "logged_iv_absolute_j"),
    )
    table = [[name, number(energy[plan]), number(energy[log])] for name, plan, log in names]
    parts.append(markdown_table(["energy", "planned", "logged"], table))
    return "\n\n".join(parts)
