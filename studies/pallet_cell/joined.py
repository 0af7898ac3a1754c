"""The systems joined: finished runs of two stud-welding stations, timed on one DC link.

The stations face each other; each run keeps its order, configurations, certified motions and weld
times, and `schedule` chooses when and how fast each motion runs. This is what the DTO paper names
as future work: sequences from the one level, timing from the other.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from sequencing.runs.archive import write_atomic


def write_joined_cell(
    folder: Path | str,
    left_run: Path | str,
    right_run: Path | str,
    distance_m: float = 5.4,
) -> Path:
    """Write `cell.yaml` into `folder`: the right station turned round, `distance_m` in front.

    15 cm shift it sideways, so that the two homes do not point at each other. Each motion is
    certified against its own station's part and fixtures; `schedule` checks robots and tools
    against each other and against the other station's part and fixtures.
    """
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    paths = [os.path.relpath(Path(run).resolve(), out.resolve()) for run in (left_run, right_run)]
    place = np.array([distance_m, 0.15, 0.0]).tolist()
    text = f"""# Two planned stud-welding stations facing each other on one DC link.
schema_version: 1
name: joined_stations
clearance_m: 0.02
robots:
  - name: left
    run: {paths[0]}
  - name: right
    run: {paths[1]}
    base: {{position_m: {place}, quaternion_xyzw: [0.0, 0.0, 1.0, 0.0]}}
link: {{capacitance_f: 0.006, voltage_v: 560.0, chopper_v: 760.0, shared: true}}
"""
    write_atomic(out / "cell.yaml", text)
    return out / "cell.yaml"
