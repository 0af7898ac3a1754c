"""The whole cycle on an even clock: plain CSV, and CSV with the names that UR's RTDE logs use."""

from __future__ import annotations

import numpy as np

from sequencing.export.wording import STREAMED, header_lines
from sequencing.runs.archive import csv_text
from sequencing.runs.folder import Run


def csv_log(run: Run, step_s: float) -> tuple[str, float]:
    """CSV with units in the header and a column that names the motion or weld; deviation [rad]."""
    header = ["t_s", "segment"]
    for unit in ("q{}_rad", "velocity{}_rad_s", "acceleration{}_rad_s2", "torque{}_nm"):
        header += [unit.format(j) for j in range(1, len(run.joint_names) + 1)]
    return _log(run, step_s, header, with_segment=True)


def rtde_log(run: Run, step_s: float) -> tuple[str, float]:
    """CSV with RTDE's names: timestamp, target_q_0 …, target_qd, target_qdd, target_moment."""
    header = ["timestamp"]
    for name in ("target_q", "target_qd", "target_qdd", "target_moment"):
        header += [f"{name}_{j}" for j in range(len(run.joint_names))]
    return _log(run, step_s, header, with_segment=False)


def _log(run: Run, step_s: float, header: list[str], with_segment: bool) -> tuple[str, float]:
    line = run.timeline
    count = int(np.ceil(line.duration_s / step_s - 1e-9))
    times = np.minimum(np.arange(count + 1) * step_s, line.duration_s)
    state = line.at(times, run.robot)
    torque = state.torque_nm
    if torque is None:
        # Without the robot model there is no inverse dynamics: the column says so by being empty.
        torque = np.full_like(state.q_rad, np.nan)
    values = np.hstack([state.q_rad, state.velocity_rad_s, state.acceleration_rad_s2, torque])
    rows = []
    for t, row in zip(times.tolist(), values.tolist()):
        cells: list[object] = [t]
        if with_segment:
            segment = line.segments[line.segment_at(t)]
            key = line.motions[segment.index].key if segment.kind == "motion" else segment.label
            cells.append(f"{segment.kind}:{key}")
        rows.append([*cells, *("" if x != x else x for x in row)])
    fine = np.linspace(0.0, line.duration_s, 4 * count + 1)
    curve = line.at(fine).q_rad
    lines = np.column_stack(
        [np.interp(fine, times, state.q_rad[:, j]) for j in range(curve.shape[1])]
    )
    comments = "".join(f"# {text}\n" for text in header_lines(run, STREAMED))
    return comments + csv_text(header, rows), float(np.max(np.abs(lines - curve)))
