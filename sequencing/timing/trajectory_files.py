"""Trajectories of one robot from a folder: `motions.npz`, or `waypoints.csv` for trapezoids."""

from __future__ import annotations

import csv
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmoc.errors import Fault, InputError
from dmoc.robot import Robot
from dmoc.trajectory import JointTrajectory
from dmoc.trapezoid import trapezoid_motion

__all__ = ["FolderMotions", "read_trajectories"]


@dataclass(frozen=True, eq=False)
class FolderMotions:
    """Trajectories in order, the robot with the load of each, and labels."""

    trajectories: tuple[JointTrajectory, ...]
    loaded: tuple[Robot, ...]
    labels: tuple[str, ...]


def read_trajectories(folder: Path, robot: Robot, payload_kg: float = 0.0) -> FolderMotions:
    """Read `folder`; `payload_kg` is carried where the folder does not say otherwise.

    `motions.npz` has keys `NAME/t_s`, `NAME/q_rad`, `NAME/velocity_rad_s` (`torque_nm` optional),
    in the order of the names. `waypoints.csv` has the columns label, q1_rad .. qn_rad and
    optionally payload_kg (carried on the way to that row); consecutive rows become the robot's
    fastest synchronised trapezoids. Each trajectory must begin where the last one ended.
    """
    archive, table = folder / "motions.npz", folder / "waypoints.csv"
    if archive.is_file():
        found = _from_archive(archive, robot, payload_kg)
    elif table.is_file():
        found = _from_waypoints(table, robot, payload_kg)
    else:
        raise InputError(
            Fault("motions-missing", str(folder), "trajectories", "neither file",
                  "a folder with motions.npz or waypoints.csv", "check the path")
        )  # fmt: skip
    _require_joined(folder, found)
    return found


def _loads(robot: Robot, payloads: list[float]) -> tuple[Robot, ...]:
    known = {payload: robot.with_payload(payload) for payload in sorted(set(payloads))}
    return tuple(known[payload] for payload in payloads)


def _from_archive(path: Path, robot: Robot, payload_kg: float) -> FolderMotions:
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {key: np.array(data[key]) for key in data.files}
    except (OSError, ValueError) as error:
        raise InputError(
            Fault("motions-damaged", str(path), "", str(error)[:100], "a NumPy archive",
                  "write it again")
        ) from error  # fmt: skip
    names = sorted({key.split("/")[0] for key in arrays})
    loaded = robot.with_payload(payload_kg)
    trajectories, faults = [], []
    for name in names:
        parts = [arrays.get(f"{name}/{part}") for part in ("t_s", "q_rad", "velocity_rad_s")]
        t, q, v = parts
        if t is None or q is None or v is None or q.ndim != 2 or q.shape[1] != robot.num_joints:
            faults.append(
                Fault("motions-arrays", str(path), name, "missing or wrong arrays",
                      f"t_s (N+1,), q_rad and velocity_rad_s (N+1, {robot.num_joints})",
                      "write all three")
            )  # fmt: skip
            continue
        torque = arrays.get(f"{name}/torque_nm", np.zeros((len(t) - 1, robot.num_joints)))
        trajectories.append(JointTrajectory(t, q, v, torque, loaded))
    if not names:
        faults.append(Fault("motions-empty", str(path), "", "no arrays", "at least one motion"))
    if faults:
        raise InputError(faults)
    return FolderMotions(tuple(trajectories), (loaded,) * len(names), tuple(names))


def _from_waypoints(path: Path, robot: Robot, payload_kg: float) -> FolderMotions:
    n = robot.num_joints
    columns = ["label", *[f"q{j + 1}_rad" for j in range(n)]]
    with path.open(newline="", encoding="utf-8") as stream:
        reader = csv.DictReader(stream)
        header = list(reader.fieldnames or [])
        rows = list(reader)
    missing = [name for name in columns if name not in header]
    if missing:
        raise InputError(
            Fault("csv-columns", str(path), ", ".join(missing), "missing", ", ".join(columns),
                  "add the columns", 1)
        )  # fmt: skip
    points, payloads, labels, faults = [], [], [], []
    for line, row in enumerate(rows, start=2):
        try:
            q = np.array([float(row[name]) for name in columns[1:]])
            payload = float(row.get("payload_kg") or payload_kg)
            if not np.isfinite(q).all() or not 0 <= payload <= 5000:
                raise ValueError("not finite, or a payload outside 0..5000 kg")
        except (TypeError, ValueError) as error:
            faults.append(
                Fault("csv-value", str(path), "", str(error), "finite numbers", "mend it", line)
            )
            continue
        out = (q < robot.q_lower_rad - 1e-9) | (q > robot.q_upper_rad + 1e-9)
        for j in np.flatnonzero(out):
            legal = f"{robot.q_lower_rad[j]:.4f} .. {robot.q_upper_rad[j]:.4f}"
            faults.append(
                Fault("joint-limit", str(path), columns[1 + j], f"{q[j]:.4f}", legal,
                      "move the waypoint", line)
            )  # fmt: skip
        points.append(q)
        payloads.append(payload)
        labels.append(row["label"])
    if len(rows) < 2:
        faults.append(Fault("csv-rows", str(path), "", f"{len(rows)} rows", "at least two"))
    if faults:
        raise InputError(faults)
    loaded = _loads(robot, payloads[1:])
    trajectories = tuple(
        trapezoid_motion(arm, a, b) for arm, a, b in zip(loaded, points, points[1:])
    )
    names = tuple(f"{a} -> {b}" for a, b in itertools.pairwise(labels))
    return FolderMotions(trajectories, loaded, names)


def _require_joined(folder: Path, found: FolderMotions) -> None:
    for k, (a, b) in enumerate(zip(found.trajectories, found.trajectories[1:])):
        gap = float(np.abs(a.q_rad[-1] - b.q_rad[0]).max())
        if gap > 1e-3:
            raise InputError(
                Fault("motions-gap", str(folder), f"trajectory {k + 1}", f"{gap:.4f} rad apart",
                      "<= 0.001 rad", "begin each trajectory where the last one ended")
            )  # fmt: skip
    for k, trajectory in enumerate(found.trajectories):
        speed = float(np.abs(trajectory.velocity_rad_s[[0, -1]]).max())
        if speed > 1e-3:
            raise InputError(
                Fault("motions-moving", str(folder), f"trajectory {k}", f"{speed:.4f} rad/s",
                      "at rest at both ends", "an override needs motions from rest to rest")
            )  # fmt: skip
