"""Movements of the UR3 study as run folders and controller files, read back and compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dmoc.bezier import BezierMotion
from dmoc.cost import ElectricalCost
from dmoc.motion import Motion
from dmoc.robot import Robot
from dmoc.status import Status
from dmoc.trajectory import JointTrajectory
from planning.world import CollisionWorld
from sequencing.cycle_types import CycleMotion
from sequencing.export.exporting import export_run
from sequencing.export.readers import read_log, read_urscript
from sequencing.run_archive import json_text, npz_bytes, sha256_of, write_atomic
from sequencing.run_files import Run, read_run
from sequencing.run_result import SCHEMA_VERSION, motion_entry, package_versions, robot_entry

__all__ = ["SERVOJ_STEPS_S", "export_motion", "write_single_run"]

#: The paper's two update rates.
SERVOJ_STEPS_S = (0.008, 0.08)
# A knot every 20 ms: the Hermite curve through them is within 1e-9 rad of the Bézier curve.
KNOTS_PER_S = 50


def write_single_run(
    name: str, trajectory: JointTrajectory, robot: Robot, energy_j: float, folder: Path,
    seed: int, world: CollisionWorld | None = None,
) -> Run:  # fmt: skip
    """One motion as the folder of a run, which every command that takes a run understands.

    With a `world` the motion is certified in it (or marked as not certified).
    """
    certified, gap = None, None
    if world is not None:
        certificate = world.clearance(tracking_error_m=0.0).certify(trajectory)
        certified, gap = certificate.ok, certificate.min_clearance_m
    motion = Motion(
        status=Status.CONVERGED, source="refined", trajectory=trajectory, cost=energy_j,
        certified=certified, min_clearance_m=gap,
    )  # fmt: skip
    cost = ElectricalCost(time=0.0, torque_smoothing=0.0)
    item = CycleMotion("m000", "start", "goal", "travel", motion)
    arrays = {
        f"m000/{key}": getattr(trajectory, key)
        for key in ("t_s", "q_rad", "velocity_rad_s", "torque_nm")
    }
    write_atomic(folder / "motions.npz", npz_bytes(arrays))
    result = {
        "schema_version": SCHEMA_VERSION,
        "name": name,
        "seed": seed,
        "versions": package_versions(),
        "inputs": {"station_fingerprint": "none", "robot_fingerprint": robot.fingerprint,
                   "files": {}},
        "robot": robot_entry(robot),
        "cost": {"kind": "ElectricalCost", "time": cost.time, "energy": cost.energy,
                 "velocity": cost.velocity, "torque_smoothing": cost.torque_smoothing},
        "duration_s": trajectory.duration_s,
        "certified": int(certified is True),
        "welds": [],
        "motions": [motion_entry(item, cost)],
        "files": {"motions.npz": sha256_of(folder / "motions.npz")},
    }  # fmt: skip
    write_atomic(folder / "result.json", json_text(result))
    return read_run(folder, robot)


def export_motion(
    name: str, motion: BezierMotion, robot: Robot, energy_j: float, folder: Path, seed: int,
    world: CollisionWorld,
) -> dict[str, Any]:  # fmt: skip
    """Write a Bézier motion as run, URScript at 8 and 80 ms and RTDE-style CSV; read all back.

    `deviation_rad` is what sampling costs: the largest joint error of straight lines between the
    streamed points. `read_back_rad` is the largest difference of the points that were read from
    the curve at their times.
    """
    curve = motion.trajectory(robot, max(20, round(KNOTS_PER_S * motion.duration_s)))
    run = write_single_run(name, curve, robot, energy_j, folder, seed, world)
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
            {"step_s": step, "points": len(points), "deviation_rad": written.max_deviation_rad,
             "read_back_rad": float(error)}
        )  # fmt: skip
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
