"""Electrical energy of a UR3e on moves that were not fitted to, against measured DC power.

Five measured moves (RAD data set, DSN 2022, 25 Hz), each predicted by a model fitted to the other
four. Predictors:

* `drive`: the product's drive model and inverse dynamics, from motion and payload alone; every
  parameter fitted to the other four moves by `fit_drive`;
* `robot.yaml`: the same with the shipped values, which are `fit_drive` of all five moves, rounded
  to two digits (three for R): not held out;
* `robot.yaml, R of a UR5e`: the same with the copper loss that was shipped before;
* `currents`: P = P_0 + sum_g (n k_t)_g i qd + R_g i^2, seven parameters, measured currents;
* `motion`: q(t) and payload only. P = P_0 + tau qd + a sum w|qd| + b sum w qd^2 + c sum tau^2/w,
  tau by inverse dynamics with the arm's published kinematics and masses. Friction is taken
  proportional, copper loss inversely proportional to a joint's rated torque w (published), so
  only four numbers are fitted;
* `constant`: the mean power of the other four moves.

The base load is 80-92 % of each move, so the error of what lies above it is shown too.

    python -m benchmarks.ur3e_energy
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from benchmarks.timing_common import data_folder, save_table
from dmoc.motion.trajectory import inverse_dynamics
from dmoc.robot.drive import DriveParams, drive_from_mapping, electrical_power_w
from dmoc.robot.robot import Tool, load_robot

RATED_NM = np.array([56.0, 56.0, 28.0, 12.0, 12.0, 12.0])
GROUPS = ((0, 1), (2,), (3, 4, 5))
"""Joints with the same motor: sizes 2, 1 and 0."""
MOVING_RAD_S = 0.02
UR5E_COPPER_OHM = 1.53


@dataclass(frozen=True, eq=False)
class Move:
    """One measured move: times (K,), joint positions, speeds, currents (K, 6), DC power (K,)."""

    name: str
    t_s: np.ndarray
    q_rad: np.ndarray
    velocity_rad_s: np.ndarray
    current_a: np.ndarray
    power_w: np.ndarray
    payload_kg: float
    payload_com_m: np.ndarray

    @property
    def duration_s(self) -> float:
        return float(self.t_s[-1] - self.t_s[0])

    def energy_j(self, power_w: np.ndarray | None = None) -> float:
        """Trapezoidal integral of the measured or a predicted power."""
        return float(np.trapezoid(self.power_w if power_w is None else power_w, self.t_s))


def read_moves(folder: Path) -> list[Move]:
    """All moves of the folder; some files end their lines with a bare carriage return."""
    moves = []
    for path in sorted(folder.glob("*.csv")):
        text = path.read_bytes().decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
        rows = [row for row in csv.DictReader(io.StringIO(text)) if row["timestamp"]]

        def column(key: str, rows: list[dict[str, str]] = rows) -> np.ndarray:
            return np.array([float(row[key]) for row in rows])

        def joints(key: str, column: Callable[[str], np.ndarray] = column) -> np.ndarray:
            return np.stack([column(f"{key}_{j}") for j in range(6)], axis=1)

        com = np.array([column(f"payload_cog_{k}")[0] for k in range(3)])
        moves.append(
            Move(
                path.stem,
                column("timestamp"),
                joints("actual_q"),
                joints("actual_qd"),
                joints("actual_current"),
                column("actual_robot_voltage") * column("actual_robot_current"),
                float(column("payload")[0]),
                com,
            )
        )
    return moves


def state(move: Move) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speeds, accelerations and joint torques (K, 6) of the measured motion."""
    robot = load_robot("ur3e_class").with_tool(Tool(move.payload_kg, move.payload_com_m))
    acceleration = np.gradient(move.velocity_rad_s, move.t_s, axis=0)
    torque = inverse_dynamics(robot.model, move.q_rad, move.velocity_rad_s, acceleration)
    return move.velocity_rad_s, acceleration, torque


def shipped_drive() -> DriveParams:
    robot = load_robot("ur3e_class")
    return drive_from_mapping(robot.drive, 6, robot.provenance)


def fit_drive(moves: list[Move]) -> DriveParams:
    """Base load, n k_t and R from measured power and currents; friction from what torque leaves.

    P = P_0 + sum_g (n k_t)_g i qd + R_g i^2 by non-negative least squares, one value a motor size.
    Then (n k_t) i - tau = f_c sgn qd + f_v qd over samples faster than `MOVING_RAD_S`, alike.
    """
    weights, _ = nnls(
        np.vstack([current_features(m)[0] for m in moves]),
        np.concatenate([m.power_w for m in moves]),
    )
    gear_constant, ohm, coulomb, viscous = np.zeros((4, 6))
    for g, joints in enumerate(GROUPS):
        gear_constant[list(joints)], ohm[list(joints)] = weights[1 + g], weights[4 + g]
        columns, left = [], []
        for move in moves:
            speed, _, torque = (x[:, list(joints)] for x in state(move))
            moving = np.abs(speed) > MOVING_RAD_S
            columns.append(np.stack([np.sign(speed[moving]), speed[moving]], axis=1))
            left.append((weights[1 + g] * move.current_a[:, list(joints)] - torque)[moving])
        (coulomb[list(joints)], viscous[list(joints)]), _ = nnls(
            np.vstack(columns), np.concatenate(left)
        )
    base = shipped_drive()
    return replace(
        base,
        torque_constant_nm_a=gear_constant / base.gear_ratio,
        copper_ohm=ohm,
        coulomb_nm=coulomb,
        viscous_nm_s=viscous,
        base_power_w=float(weights[0]),
    )


def drive_power_w(move: Move, drive: DriveParams) -> np.ndarray:
    """DC power (K,) that the drive model predicts from the motion."""
    speed, acceleration, torque = state(move)
    power = electrical_power_w(speed, acceleration, torque, drive).sum(axis=1)
    return np.asarray(power + drive.base_power_w)


def motion_features(move: Move) -> tuple[np.ndarray, np.ndarray]:
    """Columns (K, 4) to be weighted, and what is taken as it is (K,), from motion and payload."""
    speed, _, torque = state(move)
    share = RATED_NM / RATED_NM[0]
    columns = np.stack(
        [
            np.ones(len(speed)),
            (share * np.abs(speed)).sum(axis=1),
            (share * speed**2).sum(axis=1),
            (torque**2 / share).sum(axis=1),
        ],
        axis=1,
    )
    return columns, (torque * speed).sum(axis=1)


def current_features(move: Move) -> tuple[np.ndarray, np.ndarray]:
    """Columns (K, 7) from measured currents."""
    power, square = move.current_a * move.velocity_rad_s, move.current_a**2
    columns = [np.ones(len(power))]
    columns += [power[:, list(g)].sum(axis=1) for g in GROUPS]
    columns += [square[:, list(g)].sum(axis=1) for g in GROUPS]
    return np.stack(columns, axis=1), np.zeros(len(power))


def constant_features(move: Move) -> tuple[np.ndarray, np.ndarray]:
    """A constant."""
    return np.ones((len(move.t_s), 1)), np.zeros(len(move.t_s))


def leave_one_out(
    moves: list[Move],
    features: Callable[[Move], tuple[np.ndarray, np.ndarray]],
    base_w: float | None,
) -> list[dict[str, float | str]]:
    """Errors of each move predicted from the others; `base_w` None takes the fitted constant."""
    made = {move.name: features(move) for move in moves}
    rows = []
    for move in moves:
        others = [m for m in moves if m is not move]
        matrix = np.vstack([made[m.name][0] for m in others])
        target = np.concatenate([m.power_w - made[m.name][1] for m in others])
        weights, _ = nnls(matrix, target)
        columns, fixed = made[move.name]
        base = float(weights[0]) if base_w is None else base_w
        rows.append(errors(move, columns @ weights + fixed, base))
    return rows


def errors(move: Move, predicted_w: np.ndarray, base_w: float) -> dict[str, float | str]:
    """Errors of a predicted power (K,), of the whole energy and of what lies above the base."""
    error = move.energy_j(predicted_w) - move.energy_j()
    above = move.energy_j() - base_w * move.duration_s
    return {
        "move": move.name,
        "measured_j": move.energy_j(),
        "error_total_percent": 100.0 * error / move.energy_j(),
        "above_base_j": above,
        "error_above_base_percent": 100.0 * error / above,
        "rmse_w": float(np.sqrt(np.mean((predicted_w - move.power_w) ** 2))),
        "base_w": base_w,
    }


def main() -> None:
    moves = read_moves(data_folder("ur3e_power"))
    base_w = float(np.mean([r["base_w"] for r in leave_one_out(moves, motion_features, None)]))
    shipped = shipped_drive()
    held_out = [drive_power_w(m, fit_drive([o for o in moves if o is not m])) for m in moves]
    old = replace(shipped, copper_ohm=np.full(6, UR5E_COPPER_OHM))
    predictors = {
        "drive": [errors(m, power, base_w) for m, power in zip(moves, held_out, strict=True)],
        "robot.yaml": [errors(move, drive_power_w(move, shipped), base_w) for move in moves],
        "robot.yaml, R of a UR5e": [errors(m, drive_power_w(m, old), base_w) for m in moves],
        "currents": leave_one_out(moves, current_features, base_w),
        "motion": leave_one_out(moves, motion_features, base_w),
        "constant": leave_one_out(moves, constant_features, base_w),
    }
    table: list[dict[str, float | str]] = []
    for name, rows in predictors.items():
        table += [{"predictor": name, **row} for row in rows]
        for word, take in (("mean size", np.mean), ("largest", np.max)):
            sizes = {
                key: float(take([abs(float(row[key])) for row in rows]))
                for key in ("error_total_percent", "error_above_base_percent", "rmse_w")
            }
            table.append({"predictor": name, "move": word, **sizes, "base_w": base_w})
        measured = sum(float(row["above_base_j"]) for row in rows)
        error = sum(float(row["error_total_percent"]) * float(row["measured_j"]) for row in rows)
        table.append(
            {
                "predictor": name,
                "move": "all together",
                "above_base_j": measured,
                "error_above_base_percent": error / measured,
            }
        )
    save_table("ur3e_energy", table, "UR3e: energy of moves not fitted to (leave one move out)")
    fitted = fit_drive(moves)
    print(f"All five moves: base load {fitted.base_power_w:.2f} W")
    constant = fitted.gear_ratio * fitted.torque_constant_nm_a
    for text, values in (
        ("n k_t [Nm/A]", constant),
        ("copper [ohm]", fitted.copper_ohm),
        ("Coulomb friction [Nm]", fitted.coulomb_nm),
        ("viscous friction [Nm s]", fitted.viscous_nm_s),
    ):
        print(f"{text}, joints 1-2, 3, 4-6: " + ", ".join(f"{values[g[0]]:.3f}" for g in GROUPS))


if __name__ == "__main__":
    main()
