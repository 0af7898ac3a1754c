"""Electrical energy of a UR3e on moves that were not fitted to, against measured DC power.

Five measured moves (RAD data set, DSN 2022, 25 Hz), each predicted by a model fitted to the other
four. Three predictors:

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
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.optimize import nnls

from benchmarks.timing_common import data_folder, save_table

__all__ = ["Move", "leave_one_out", "read_moves", "ur3e_model"]

# Universal Robots: DH parameters for calculations of kinematics and dynamics, and the data sheet.
D_M = (0.15185, 0.0, 0.0, 0.13105, 0.08535, 0.0921)
A_M = (0.0, -0.24355, -0.2132, 0.0, 0.0, 0.0)
ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
MASS_KG = (1.98, 3.4445, 1.437, 0.871, 0.805, 0.261)
COM_M = (
    (0, -0.02, 0),
    (0.13, 0, 0.1157),
    (0.05, 0, 0.0238),
    (0, 0, 0.01),
    (0, 0, 0.01),
    (0, 0, -0.02),
)
INERTIA_KG_M2 = (  # about the centre of mass; assumed, slender bodies of these masses
    (0.0081, 0.0076, 0.0081),
    (0.0069, 0.0334, 0.0311),
    (0.0017, 0.0070, 0.0072),
    (0.0008, 0.0007, 0.0007),
    (0.0006, 0.0006, 0.0005),
    (0.0001, 0.0001, 0.0002),
)
RATED_NM = np.array([56.0, 56.0, 28.0, 12.0, 12.0, 12.0])
GROUPS = ((0, 1), (2,), (3, 4, 5))


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


def ur3e_model(payload_kg: float, com_m: np.ndarray) -> pin.Model:
    """The arm from its published DH table and masses, with a point payload in the tool frame."""
    model = pin.Model()
    joint, placement = 0, pin.SE3.Identity()
    for k in range(6):
        joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"joint_{k + 1}")
        link = pin.SE3(pin.utils.rotate("x", ALPHA[k]), np.array([A_M[k], 0.0, D_M[k]]))
        inertia = pin.Inertia(
            MASS_KG[k], np.array(COM_M[k], dtype=float), np.diag(INERTIA_KG_M2[k])
        )
        model.appendBodyToJoint(joint, inertia, link)
        placement = link
    point = pin.Inertia(payload_kg, np.asarray(com_m, dtype=float), np.zeros((3, 3)))
    model.appendBodyToJoint(joint, point, placement)
    return model


def torque_nm(move: Move) -> np.ndarray:
    """Joint torques (K, 6) of the measured motion, by inverse dynamics."""
    model = ur3e_model(move.payload_kg, move.payload_com_m)
    data = model.createData()
    acceleration = np.gradient(move.velocity_rad_s, move.t_s, axis=0)
    rows = zip(move.q_rad, move.velocity_rad_s, acceleration)
    return np.array([pin.rnea(model, data, *row) for row in rows])


def motion_features(move: Move) -> tuple[np.ndarray, np.ndarray]:
    """Columns (K, 4) to be weighted, and what is taken as it is (K,), from motion and payload."""
    torque, speed = torque_nm(move), move.velocity_rad_s
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
        predicted = columns @ weights + fixed
        error = move.energy_j(predicted) - move.energy_j()
        base = float(weights[0]) if base_w is None else base_w
        above = move.energy_j() - base * move.duration_s
        rows.append(
            {
                "move": move.name,
                "measured_j": move.energy_j(),
                "error_total_percent": 100.0 * error / move.energy_j(),
                "above_base_j": above,
                "error_above_base_percent": 100.0 * error / above,
                "rmse_w": float(np.sqrt(np.mean((predicted - move.power_w) ** 2))),
                "base_w": base,
            }
        )
    return rows


def main() -> None:
    moves = read_moves(data_folder("ur3e_power"))
    table = []
    base_w = float(np.mean([r["base_w"] for r in leave_one_out(moves, motion_features, None)]))
    for name, features in (
        ("currents", current_features),
        ("motion", motion_features),
        ("constant", constant_features),
    ):
        rows = leave_one_out(moves, features, base_w)
        table += [{"predictor": name, **row} for row in rows]
        worst = {
            key: max(abs(float(row[key])) for row in rows)
            for key in ("error_total_percent", "error_above_base_percent", "rmse_w")
        }
        table.append({"predictor": name, "move": "largest", **worst, "base_w": base_w})
    save_table("ur3e_energy", table, "UR3e: energy of moves not fitted to (leave one move out)")


if __name__ == "__main__":
    main()
