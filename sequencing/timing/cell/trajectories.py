"""Trajectories of one robot from a folder: `motions.npz`, or `waypoints.csv` for trapezoids."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmoc.arrays import arrays_of
from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.errors import DmocError, Fault, InputError
from dmoc.input_file import Refuse, content_of
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.robot.robot import Robot
from dmoc.table_file import number_of, read_table
from sequencing.timing.cell.schema import LoadEntry
from sequencing.timing.cell.types import CellRobot


def with_loads(robot: CellRobot, loads: Sequence[LoadEntry], refuse: Refuse) -> CellRobot:
    """`robot` with the payloads and wrenches of `loads`; later entries override earlier ones."""
    loaded, wrench = list(robot.loaded), list(robot.wrench)
    trajectories = list(robot.trajectories)
    size = len(trajectories)
    arms: dict[float, Robot] = {}
    for m, load in enumerate(loads):
        if load.payload_kg is None and load.force_n is None and load.torque_nm is None:
            refuse(
                "load-empty",
                "no load",
                "payload_kg, force_n or torque_nm",
                "say what these trajectories carry",
                "loads",
                m,
            )
        for at, k in enumerate(load.trajectories):
            if k >= size:
                refuse(
                    "load-trajectory",
                    str(k),
                    f"0 .. {size - 1}",
                    "count trajectories from 0",
                    "loads",
                    m,
                    "trajectories",
                    at,
                )
                continue
            if load.payload_kg is not None:
                arm = arms.setdefault(load.payload_kg, robot.robot.with_payload(load.payload_kg))
                loaded[k], trajectories[k] = arm, _carried(trajectories[k], arm)
            if load.force_n is not None or load.torque_nm is not None:
                wrench[k] = np.array([*(load.force_n or [0.0] * 3), *(load.torque_nm or [0.0] * 3)])
    return replace(
        robot, loaded=tuple(loaded), wrench=tuple(wrench), trajectories=tuple(trajectories)
    )


def _carried(trajectory: JointTrajectory, arm: Robot) -> JointTrajectory:
    """The same motion with the torques of `arm` at the middles of its intervals."""
    t = trajectory.t_s
    state = trajectory.on(None).sample(0.5 * (t[1:] + t[:-1]))
    torque = inverse_dynamics(
        arm.model, state.q_rad, state.velocity_rad_s, state.acceleration_rad_s2
    )
    return replace(trajectory, torque_nm=torque, robot=arm)


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
        raise InputError.of(
            "motions-missing",
            str(folder),
            "trajectories",
            "neither file",
            "a folder with motions.npz or waypoints.csv",
            "check the path",
        )
    _require_joined(folder, found)
    return found


def _loads(robot: Robot, payloads: list[float]) -> tuple[Robot, ...]:
    known = {payload: robot.with_payload(payload) for payload in sorted(set(payloads))}
    return tuple(known[payload] for payload in payloads)


def _from_archive(path: Path, robot: Robot, payload_kg: float) -> FolderMotions:
    try:
        arrays = arrays_of(content_of(path))
    except (OSError, ValueError) as error:
        raise InputError.of(
            "motions-damaged",
            str(path),
            "motions.npz",
            str(error)[:100],
            "a NumPy archive of numbers",
            "write it again with numpy.savez",
        ) from error
    names = sorted({key.split("/")[0] for key in arrays})
    loaded = robot.with_payload(payload_kg)
    trajectories, faults = [], []
    for name in names:
        made = _archived(path, name, arrays, loaded)
        if isinstance(made, JointTrajectory):
            trajectories.append(made)
        else:
            faults += made
    if not names:
        faults.append(
            Fault(
                "motions-empty",
                str(path),
                "motions.npz",
                "no arrays",
                "at least one motion",
                "write NAME/t_s, NAME/q_rad, NAME/velocity_rad_s",
            )
        )
    if faults:
        raise InputError(faults)
    return FolderMotions(tuple(trajectories), (loaded,) * len(names), tuple(names))


def _archived(
    path: Path, name: str, arrays: dict[str, np.ndarray], robot: Robot
) -> JointTrajectory | list[Fault]:
    """One motion of an archive, or what is wrong with it."""
    n = robot.num_joints
    parts = [arrays.get(f"{name}/{part}") for part in ("t_s", "q_rad", "velocity_rad_s")]
    t, q, v = parts
    knots = 0 if q is None or q.ndim != 2 else len(q)
    wanted = ((knots,), (knots, n), (knots, n))
    torque = arrays.get(f"{name}/torque_nm", np.zeros((max(knots - 1, 0), n)))
    real = all(a is not None and a.dtype.kind in "fiu" for a in (*parts, torque))
    if (
        not real
        or t is None
        or q is None
        or v is None
        or knots < 2
        or (t.shape, q.shape, v.shape) != wanted
        or torque.shape != (knots - 1, n)
    ):
        shapes = ", ".join("none" if a is None else f"{a.dtype}{a.shape}" for a in (*parts, torque))
        return [
            Fault(
                "motions-arrays",
                str(path),
                name,
                f"t_s, q, v, torque: {shapes}",
                f"numbers of shapes (N+1,), (N+1, {n}), (N+1, {n}), torque_nm (N, {n}) or absent",
                "write all three for every motion, N >= 1",
            )
        ]
    try:
        made = JointTrajectory(t, q, v, torque, robot)
    except DmocError as error:
        return [
            Fault(
                fault.code, str(path), f"{name}/{fault.field}", fault.value, fault.legal, fault.fix
            )
            for fault in error.faults
        ]
    return _limits(path, name, made, robot) or made


def _limits(path: Path, name: str, motion: JointTrajectory, robot: Robot) -> list[Fault]:
    """What the robot cannot do of a motion: duration, angles and speeds, at and between knots."""
    if not 1e-3 <= motion.duration_s <= 3600.0:
        return [
            Fault(
                "motions-duration",
                str(path),
                name,
                f"{motion.duration_s:g} s",
                "0.001 .. 3600 s",
                "give times in seconds",
            )
        ]
    middle = 0.5 * (motion.t_s[1:] + motion.t_s[:-1])
    q, v, *_ = motion.on(None).sample(np.concatenate([motion.t_s, middle]))
    faults = []
    for j in range(robot.num_joints):
        low, high = float(robot.q_lower_rad[j]), float(robot.q_upper_rad[j])
        worst = max(q[:, j], key=lambda x: max(low - x, x - high))
        if not low - 1e-4 <= worst <= high + 1e-4:
            faults.append(
                Fault(
                    "joint-limit",
                    str(path),
                    f"{name}/q_rad[:, {j}]",
                    f"{worst:.4f} rad",
                    f"{low:.4f} .. {high:.4f} rad",
                    "plan the motion within the joint's limits",
                )
            )
        speed, limit = float(np.abs(v[:, j]).max()), float(robot.velocity_limit_rad_s[j])
        if speed > 1.01 * limit:
            faults.append(
                Fault(
                    "velocity-limit",
                    str(path),
                    f"{name}/velocity_rad_s[:, {j}]",
                    f"{speed:.4f} rad/s",
                    f"<= {limit:.4f} rad/s",
                    "plan a slower motion",
                )
            )
    return faults


def _from_waypoints(path: Path, robot: Robot, payload_kg: float) -> FolderMotions:
    n = robot.num_joints
    columns = ["label", *[f"q{j + 1}_rad" for j in range(n)]]
    table = read_table(path, ("label",), 100_000_000)
    header = table.header
    wrong = [name for name in columns if header.count(name) != 1]
    if wrong:
        raise InputError.of(
            "csv-columns",
            str(path),
            ", ".join(wrong),
            "missing" if not set(wrong) & set(header) else "missing or twice",
            ", ".join(columns),
            "give each column once",
            1,
        )
    points: list[np.ndarray] = []
    payloads: list[float] = []
    labels: list[str] = []
    faults: list[Fault] = []

    def refuse(
        field: str, code: str, value: str, legal: str, fix: str, line: int | None = None
    ) -> None:
        faults.append(Fault(code, str(path), field, value, legal, fix, line))

    for line, cells in table.rows:
        row = dict(zip(header, cells))
        q = np.array([_number(row.get(name), -np.inf, np.inf) for name in columns[1:]])
        given = row.get("payload_kg")
        payload = _number(given, 0.0, 5000.0) if given else payload_kg
        if len(cells) > len(header):
            value = f"{len(cells) - len(header)} cells too many"
            legal = f"{len(header)} cells"
            refuse("row", "csv-value", value, legal, "take the extra separators out", line)
        for name, value in zip((*columns[1:], "payload_kg"), (*q, payload)):
            if not np.isfinite(value):
                legal = "0 .. 5000 kg" if name == "payload_kg" else "a finite number of radians"
                shown = "nothing" if not row.get(name) else repr(row[name])[:60]
                refuse(name, "csv-value", shown, legal, "write a number", line)
        out = (q < robot.q_lower_rad - 1e-9) | (q > robot.q_upper_rad + 1e-9)
        for j in np.flatnonzero(out):
            legal = f"{robot.q_lower_rad[j]:.4f} .. {robot.q_upper_rad[j]:.4f} rad"
            refuse(
                columns[1 + j],
                "joint-limit",
                f"{q[j]:.4f}",
                legal,
                "move the waypoint; angles are in radians",
                line,
            )
        if points and np.abs(q - points[-1]).max() <= 1e-12:
            refuse(
                "q1_rad ..",
                "no-motion",
                "the joint vector of the row before",
                "a different one",
                "leave this row out",
                line,
            )
        points.append(q)
        payloads.append(payload)
        labels.append(row.get("label", ""))
    if len(table.rows) < 2:
        faults.append(
            Fault(
                "csv-rows",
                str(path),
                "waypoints.csv",
                f"{len(table.rows)} rows",
                "at least two",
                "give the joint vectors that the robot visits",
            )
        )
    if faults:
        raise InputError(faults)
    loaded = _loads(robot, payloads[1:])
    trajectories = tuple(
        trapezoid_motion(arm, a, b) for arm, a, b in zip(loaded, points, points[1:])
    )
    names = tuple(f"{a} -> {b}" for a, b in itertools.pairwise(labels))
    return FolderMotions(trajectories, loaded, names)


def _number(text: str | None, low: float, high: float) -> float:
    """The number, NaN if it is none or outside [low, high]."""
    value = number_of(text or "")
    return value if low <= value <= high else float("nan")


def _require_joined(folder: Path, found: FolderMotions) -> None:
    for k, (a, b) in enumerate(zip(found.trajectories, found.trajectories[1:])):
        gap = float(np.abs(a.q_rad[-1] - b.q_rad[0]).max())
        if gap > 1e-3:
            raise InputError.of(
                "motions-gap",
                str(folder),
                f"trajectory {k + 1}",
                f"{gap:.4f} rad apart",
                "<= 0.001 rad",
                "begin each trajectory where the last one ended",
            )
    for k, trajectory in enumerate(found.trajectories):
        speed = float(np.abs(trajectory.velocity_rad_s[[0, -1]]).max())
        if speed > 1e-3:
            raise InputError.of(
                "motions-moving",
                str(folder),
                f"trajectory {k}",
                f"{speed:.4f} rad/s",
                "at rest at both ends",
                "an override needs motions from rest to rest",
            )
