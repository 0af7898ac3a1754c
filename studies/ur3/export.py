"""Movements of the UR3 study as run folders and controller files, read back and compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dmoc.motion.cost import ElectricalCost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.robot.robot import Robot
from planning.collision.world import CollisionWorld
from sequencing.cycle_types import CycleMotion
from sequencing.export.exporting import export_run
from sequencing.export.readers import read_log, read_urscript
from sequencing.runs.folder import write_motions
from studies.ur3.bezier_motion import BezierMotion

#: The paper's two update rates.
SERVOJ_STEPS_S = (0.008, 0.08)
# A knot every 20 ms: the Hermite curve through them is within 1e-9 rad of the Bézier curve.
KNOTS_PER_S = 50


def export_motion(
    name: str,
    motion: BezierMotion,
    robot: Robot,
    energy_j: float,
    folder: Path,
    seed: int,
    world: CollisionWorld,
) -> dict[str, Any]:
    """Certify a Bézier motion in `world`; write run, URScript (8, 80 ms) and RTDE-style CSV.

    All are read back. `deviation_rad` is what sampling costs: the largest joint error of straight
    lines between the streamed points. `read_back_rad` is the largest difference of the points
    that were read from the curve at their times.
    """
    curve = motion.trajectory(robot, max(20, round(KNOTS_PER_S * motion.duration_s)))
    certificate = world.clearance(tracking_error_m=0.0).certify(curve)
    made = Motion(
        status=Status.CONVERGED,
        source="refined",
        trajectory=curve,
        cost=energy_j,
        certified=certificate.ok,
        min_clearance_m=certificate.min_clearance_m,
    )
    item = CycleMotion("m000", "start", "goal", "travel", made)
    cost = ElectricalCost(time=0.0, torque_smoothing=0.0)
    run = write_motions(name, robot, [item], cost, folder, seed)
    report: dict[str, Any] = {"run": folder.name, "certified": run.motions[0].motion.certified}
    if run.motions[0].motion.certified is False:
        return report | {"servoj": [], "rtde": None}
    rows = []
    for step in SERVOJ_STEPS_S:
        place = folder / f"servoj_{round(1000 * step):02d}ms"
        written = export_run(run, "urscript", place, step)
        points = read_urscript(written.files[0])["m000"]
        times = np.minimum(step * np.arange(1, len(points) + 1), motion.duration_s)
        error = np.abs(points - motion.derivative(times, 0)).max()
        rows.append(
            {
                "step_s": step,
                "points": len(points),
                "deviation_rad": written.max_deviation_rad,
                "read_back_rad": float(error),
            }
        )
    log = export_run(run, "rtde", folder, 0.008).files[0]
    table = read_log(log)
    n = robot.num_joints
    q, v = (
        np.column_stack([table[f"{key}_{j}"] for j in range(n)])
        for key in ("target_q", "target_qd")
    )
    report["servoj"] = rows
    report["rtde"] = {
        "rows": len(q),
        "read_back_rad": float(np.abs(q - motion.derivative(table["timestamp"], 0)).max()),
        "read_back_rad_s": float(np.abs(v - motion.derivative(table["timestamp"], 1)).max()),
    }
    return report
