r"""Torque and electrical power along a fixed path, for any override, without inverse dynamics.

A trajectory q(s) over its nominal time s, run with speed profile s(t), needs the torque

    tau = a(s) s'' + b(s) s'^2 + c(s),   c = g(q) - J^T f,  b = C(q, q_s) q_s + M q_ss,  a = M q_s

(gravity and external wrench f, Coriolis, inertia). A uniform override delta (s' = delta, s'' = 0)
leaves tau = c + delta^2 (tau_0 - c), tau_0 being the torque at full speed: inverse dynamics runs
once per path. Electrical power is then a quartic in delta apart from the inverter's |i| and the
friction's root; `PowerTable` interpolates it through five Chebyshev points of delta, which keeps
the quartic part exact, and integrates it over s:

    E(s, delta) = Q(s, delta) / delta,   Q = sum_k delta^k Q_k(s).

Tabulating the *energy* makes a schedule's step energies exact sums whatever the step, and smooth
in start and override. `exact_power_w` is the per-joint model that it is checked against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dmoc.errors import ProblemError
from dmoc.jit import njit
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.drive import REST_RAD_S, DriveParams, drive_from_mapping, electrical_power_w
from dmoc.robot.robot import Robot

# mypy: disallow-untyped-defs=False


@njit(fastmath=True)
def exact_kernel(static, speed, velocity, acceleration, drive, override, out):
    """Fill out (P,) [W]: tau = static + override^2 speed, qd = override velocity, (P, n) each.

    `drive` (9, n): f_c, f_v, f_s, J_x, (R + r_0)/(n k_t)^2, k_e n^2, k_h n, v_0/(n k_t), P_0.
    """
    samples, joints = static.shape
    square = override * override
    root = np.sqrt(override)
    for p in range(samples):
        total = 0.0
        for j in range(joints):
            v = override * velocity[p, j]
            sign = 1.0 if v >= REST_RAD_S else (-1.0 if v <= -REST_RAD_S else 0.0)
            friction = drive[0, j] * sign + drive[1, j] * v
            if drive[2, j] > 0.0:
                friction += drive[2, j] * sign * root * np.sqrt(abs(velocity[p, j]))
            torque = static[p, j] + square * speed[p, j] + friction
            torque += drive[3, j] * square * acceleration[p, j]
            total += torque * v + drive[4, j] * torque * torque + drive[5, j] * v * v
            total += drive[6, j] * v * sign + drive[7, j] * abs(torque) + drive[8, j]
        out[p] = total


MIN_OVERRIDE = 0.05
_DEGREE = 4


@dataclass(frozen=True, eq=False)
class PathPower:
    """A path's torque terms at P samples of its nominal time, which is cut into M equal cells.

    A sample is the midpoint of a cell, or of each piece where a knot of the trajectory cuts a cell
    (the acceleration jumps there): `middle_s`, `width_s` (P,) [s] are its time and length, `cell`
    (P,) its cell. `q_rad`, `velocity_rad_s`, `acceleration_rad_s2` (P, n) are the motion at full
    speed; `static_nm` c, `inertia_nm` a, `speed_nm` b (P, n) the torque terms; `hold_start_w`,
    `hold_end_w` the electrical power of standing still at either end.
    """

    duration_s: float
    num_cells: int
    middle_s: np.ndarray
    width_s: np.ndarray
    cell: np.ndarray
    q_rad: np.ndarray
    velocity_rad_s: np.ndarray
    acceleration_rad_s2: np.ndarray
    static_nm: np.ndarray
    inertia_nm: np.ndarray
    speed_nm: np.ndarray
    hold_start_w: float
    hold_end_w: float
    drive: DriveParams

    @property
    def num_samples(self) -> int:
        """P."""
        return int(self.q_rad.shape[0])


@dataclass(frozen=True, eq=False)
class PowerTable:
    """Q_k(s) at the cell ends: `coefficients` (5, M+1) [J], and the powers at rest [W]."""

    duration_s: float
    cell_s: float
    coefficients: np.ndarray
    hold_start_w: float
    hold_end_w: float

    def energy_j(self, override: float) -> float:
        """Energy of the whole motion at a constant override, drawn from the link."""
        powers = override ** np.arange(_DEGREE + 1)
        return float(powers @ self.coefficients[:, -1] / override)


def drive_of(robot: Robot) -> DriveParams:
    """The robot's `drive` mapping as `DriveParams`; `RobotError` if it has none."""
    provenance = {key.removeprefix("drive."): tag for key, tag in robot.provenance.items()}
    drive = robot.drive
    if isinstance(drive, DriveParams):
        return drive
    return drive_from_mapping(drive, robot.num_joints, provenance)


def path_power(
    robot: Robot,
    trajectory: JointTrajectory,
    cell_s: float = 0.004,
    wrench: np.ndarray | None = None,
    drive: DriveParams | None = None,
) -> PathPower:
    """Torque terms of `trajectory` for `robot` (its payload included in `robot.model`).

    `wrench` (6,) is an external force and torque [N, Nm] acting on the flange, in world axes at
    the flange's origin, constant along the path. Costs three inverse-dynamics calls a sample.
    """
    n = robot.num_joints
    if trajectory.q_rad.shape[1] != n:
        raise ProblemError.of(
            "joint-count",
            "",
            "trajectory.q_rad",
            str(trajectory.q_rad.shape[1]),
            f"{n} joints, as {robot.name} has",
            "give each robot its own trajectories",
        )
    duration = trajectory.duration_s
    cells = max(8, int(np.ceil(duration / cell_s)))
    knots = trajectory.t_s - trajectory.t_s[0]
    middle, width, cell = _pieces(knots, duration, cells)
    q, qd, qdd, _ = trajectory.on(None).sample(trajectory.t_s[0] + middle)
    params = drive_of(robot) if drive is None else drive
    static, inertia, speed = _terms(robot, q, qd, qdd, wrench)
    ends = trajectory.q_rad[[0, -1]]
    zero = np.zeros_like(ends)
    hold_torque, _, _ = _terms(robot, ends, zero, zero, wrench)
    hold = electrical_power_w(zero, zero, hold_torque, params).sum(axis=1)
    for array in (middle, width, cell, q, qd, qdd, static, inertia, speed):
        array.setflags(write=False)
    return PathPower(
        duration,
        cells,
        middle,
        width,
        cell,
        q,
        qd,
        qdd,
        static,
        inertia,
        speed,
        float(hold[0]),
        float(hold[1]),
        params,
    )


def _pieces(
    knots_s: np.ndarray, duration: float, cells: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Midpoints, widths and cell numbers of the cells, cut where a knot falls inside one."""
    edges = np.linspace(0.0, duration, cells + 1)
    inner = knots_s[1:-1]
    clear = np.abs(inner - np.rint(inner * cells / duration) * duration / cells) > 1e-9 * duration
    all_edges = np.sort(np.concatenate([edges, inner[clear]]))
    middle = 0.5 * (all_edges[1:] + all_edges[:-1])
    cell = np.minimum((middle * cells / duration).astype(np.int64), cells - 1)
    return middle, np.diff(all_edges), cell


def _terms(
    robot: Robot, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, wrench: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    model = robot.model
    data = model.createData()
    zero = np.zeros(robot.num_joints)
    static, inertia, speed = (np.empty_like(q) for _ in range(3))
    frame = robot.flange_id
    for k in range(len(q)):
        gravity = pin.rnea(model, data, q[k], zero, zero)
        inertia[k] = pin.rnea(model, data, q[k], zero, qd[k]) - gravity
        speed[k] = pin.rnea(model, data, q[k], qd[k], qdd[k]) - gravity
        static[k] = gravity
        if wrench is not None:
            jacobian = pin.computeFrameJacobian(
                model, data, q[k], frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
            static[k] -= jacobian.T @ np.asarray(wrench, dtype=float)
    return static, inertia, speed


def path_torque_nm(
    path: PathPower, rate: np.ndarray | float = 1.0, rate_change: np.ndarray | float = 0.0
) -> np.ndarray:
    """tau = a s'' + b s'^2 + c (P, n) for s' = `rate`, s'' = `rate_change` [1/s]."""
    r = np.broadcast_to(np.asarray(rate, dtype=float), (path.num_samples,))[:, None]
    rr = np.broadcast_to(np.asarray(rate_change, dtype=float), (path.num_samples,))[:, None]
    return path.inertia_nm * rr + path.speed_nm * r**2 + path.static_nm


def exact_power_w(path: PathPower, override: float) -> np.ndarray:
    """Electrical power of the robot at every sample (P,) [W] at a constant override, per joint.

    The same model as `dmoc.robot.drive.electrical_power_w`, in one pass without temporaries.
    """
    out = np.empty(path.num_samples)
    exact_kernel(
        path.static_nm,
        path.speed_nm,
        path.velocity_rad_s,
        path.acceleration_rad_s2,
        drive_rows(path.drive),
        float(override),
        out,
    )
    return out


def drive_rows(drive: DriveParams) -> np.ndarray:
    """The drive's coefficients (9, n) as `exact_kernel` wants them."""
    n_kt = drive.gear_ratio * drive.torque_constant_nm_a
    return np.array(
        [
            drive.coulomb_nm,
            drive.viscous_nm_s,
            drive.root_friction_nm_s,
            drive.extra_inertia_kg_m2,
            (drive.copper_ohm + drive.inverter_ohm) / n_kt**2,
            drive.eddy_w_s2 * drive.gear_ratio**2,
            drive.hysteresis_w_s * drive.gear_ratio,
            drive.inverter_v / n_kt,
            drive.idle_w,
        ]
    )


def power_table(path: PathPower) -> PowerTable:
    """Integrate the quartic that meets `exact_power_w` at five overrides in [MIN_OVERRIDE, 1]."""
    k = np.arange(_DEGREE + 1)
    nodes = 0.5 * (1 + MIN_OVERRIDE) + 0.5 * (1 - MIN_OVERRIDE) * np.cos(
        np.pi * (2 * k + 1) / (2 * (_DEGREE + 1))
    )
    powers = np.array([exact_power_w(path, delta) for delta in nodes])
    quartic = np.linalg.solve(nodes[:, None] ** k, powers)
    return _table(path, quartic)


def exact_table(path: PathPower, override: float) -> PowerTable:
    """A table that is right at one override only, where it holds the per-joint model's energy."""
    quartic = np.zeros((_DEGREE + 1, path.num_samples))
    quartic[0] = exact_power_w(path, override)
    return _table(path, quartic)


def _table(path: PathPower, quartic: np.ndarray) -> PowerTable:
    starts = np.searchsorted(path.cell, np.arange(path.num_cells))
    coefficients = np.zeros((_DEGREE + 1, path.num_cells + 1))
    cells = np.add.reduceat(quartic * path.width_s, starts, axis=1)
    np.cumsum(cells, axis=1, out=coefficients[:, 1:])
    coefficients.setflags(write=False)
    return PowerTable(
        path.duration_s,
        path.duration_s / path.num_cells,
        coefficients,
        path.hold_start_w,
        path.hold_end_w,
    )
