"""Author the pallet cell: positions in the cell become joint waypoints (`waypoints.csv`).

Three heavy arms stand around one pallet, 120 degrees apart. Each takes 13 boxes from its own
feeder and sets them down in a slotted rack of two tiers on the pallet: feeder -> pallet (with
box) -> ready -> feeder, 39 trajectories a robot. They take turns: while one sets down, the next
comes from its feeder and the third withdraws, so each begins its round one trajectory later than
the one before. Positions are in metres, invented. A first layout
(no robots meeting at all) was replaced by this one for its collisions, not for its energies.
Run `python -m authoring.stations.pallet_cell` to write the files again.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pinocchio as pin

from dmoc.robot.robot import Robot, load_robot

HERE = Path(__file__).resolve().parents[2] / "planning" / "stations" / "pallet_cell"
RADIUS_M = 1.85
BOX_KG = 45.0
BASES = {"north": 90.0, "west": 210.0, "east": 330.0}
SEED_RAD = np.array([0.0, 0.15, 0.1, 0.0, 1.3, 0.0])
FEEDER_M = np.array([0.35, 1.75, 0.75])  # of the tool tip, in the robot's own frame
READY_M = np.array([1.5, 0.75, 1.3])
# Slots of the pallet in each robot's order (39 of 40 are used). Chosen so
# that at full speed nobody meets anybody, while in some windows a robot that merely slows down on
# its way out would be met by the next one coming in: the situation of the paper's Fig. 5.
ORDER = {
    "north": [38, 6, 15, 29, 27, 33, 34, 37, 31, 22, 14, 1, 2],
    "west": [3, 9, 26, 0, 13, 30, 21, 23, 11, 7, 25, 32, 20],
    "east": [17, 5, 16, 12, 10, 18, 8, 24, 19, 36, 39, 35, 28],
}
REACH_M = 0.55  # flange to the bottom of the box that hangs below it


def base_pose(name: str) -> pin.SE3:
    """T_world_base: on the circle, facing the pallet."""
    angle = np.deg2rad(BASES[name])
    position = RADIUS_M * np.array([np.cos(angle), np.sin(angle), 0.0])
    return pin.SE3(pin.utils.rotate("z", angle + np.pi), position)


def place_positions(name: str) -> np.ndarray:
    """13 places (13, 3) [m] in the world, in the robot's order: 40 slots in two tiers."""
    slots = [
        (x, y, 0.75 + 0.25 * tier)
        for tier in range(2)
        for x in np.linspace(-0.5, 0.5, 5)
        for y in np.linspace(-0.36, 0.36, 4)
    ]
    return np.array([slots[k] for k in ORDER[name]])


def inverse_kinematics(robot: Robot, tip_m: np.ndarray, seed_rad: np.ndarray) -> np.ndarray:
    """Joint vector (n,) that puts the gripper, pointing down, at `tip_m` (world)."""
    model, data = robot.model, robot.model.createData()
    frame = robot.flange_id
    heading = np.arctan2(*(tip_m - robot.base.translation)[[1, 0]])
    # The flange's x axis points down, its y axis across the line of sight.
    down = pin.utils.rotate("z", heading) @ pin.utils.rotate("y", np.pi / 2)
    target = pin.SE3(down, tip_m + np.array([0.0, 0.0, REACH_M]))
    q = seed_rad.copy()
    for _ in range(500):
        pin.framesForwardKinematics(model, data, q)
        error = pin.log6(data.oMf[frame].actInv(target)).vector
        if np.linalg.norm(error) < 1e-10:
            break
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.LOCAL)
        step = np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), error)
        move = jacobian.T @ step
        q = q + move * min(1.0, 0.3 / np.abs(move).max())
        q = np.clip(q, robot.q_lower_rad, robot.q_upper_rad)
    pin.framesForwardKinematics(model, data, q)
    if np.linalg.norm(pin.log6(data.oMf[frame].actInv(target)).vector) > 1e-6:
        raise ValueError(f"no joint vector for {tip_m} from {robot.base.translation}")
    return q


def waypoints(name: str) -> list[tuple[str, np.ndarray, float]]:
    """40 rows (label, q_rad, payload on the way here) of one robot: 39 trajectories."""
    robot = load_robot("irb6640_class").with_base(base_pose(name))

    def world(local: np.ndarray) -> np.ndarray:
        return robot.base.act(local)

    aim = SEED_RAD.copy()
    aim[0] = np.arctan2(FEEDER_M[1], FEEDER_M[0])
    feeder = inverse_kinematics(robot, world(FEEDER_M), aim)
    aim[0] = np.arctan2(READY_M[1], READY_M[0])
    ready = inverse_kinematics(robot, world(READY_M), aim)
    aim[0] = 0.0
    places = [inverse_kinematics(robot, place, aim) for place in place_positions(name)]
    stops: list[tuple[str, np.ndarray, float]] = [("feeder", feeder, 0.0)]
    for k, place in enumerate(places):
        stops += [(f"place_{k:02d}", place, BOX_KG), ("ready", ready, 0.0), ("feeder", feeder, 0.0)]
    late = list(BASES).index(name)
    # The second robot begins at ready, the third at its first place; all end where they began.
    if late == 0:
        return stops
    if late == 1:
        return [("ready", ready, 0.0), *stops[:-1]]
    return [*stops[1:], ("place_00", places[0], BOX_KG)]


def author(folder: Path = HERE) -> None:
    """Write one folder with `waypoints.csv` for each robot."""
    for name in BASES:
        target = folder / name
        target.mkdir(parents=True, exist_ok=True)
        with (target / "waypoints.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(["label", *[f"q{j + 1}_rad" for j in range(6)], "payload_kg"])
            for label, q, payload in waypoints(name):
                writer.writerow([label, *[f"{x:.9f}" for x in q], f"{payload:g}"])


if __name__ == "__main__":
    author()
