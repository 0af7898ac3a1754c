"""The UR3e-class robot against the published table and against the controller's own torques."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from authoring.robots.ur3e import DH
from dmoc.motion.trajectory import inverse_dynamics
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import Tool, load_robot

DATA = Path(os.environ.get("DMOC_DATA", Path(__file__).parents[3] / "shared" / "data"))


def forward(q_rad: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    for (a, d, alpha), q in zip(DH, q_rad, strict=True):
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return pose


def test_flange_pose_is_that_of_the_published_table() -> None:
    robot = load_robot("ur3e_class")
    for q in np.random.default_rng(3).uniform(-np.pi, np.pi, (20, 6)):
        np.testing.assert_allclose(robot.flange_pose(q).homogeneous, forward(q), atol=1e-9)


def test_drive_has_tags_and_fitted_current_constants() -> None:
    robot = load_robot("ur3e_class")
    drive = drive_from_mapping(robot.drive, 6, robot.provenance)
    np.testing.assert_allclose(
        (drive.gear_ratio * drive.torque_constant_nm_a)[:4], [10.5, 10.5, 7.3, 5.1], rtol=1e-3
    )
    assert drive.base_power_w == 36.0
    assert drive.tag("coulomb_nm").startswith("published")
    assert drive.tag("inverter_v") == "assumed"


@pytest.mark.data
@pytest.mark.skipif(not (DATA / "ur3e_power").is_dir(), reason="no benchmark data folder")
@pytest.mark.parametrize("move", ["L0L1", "L1L2", "L2L3", "L3L4", "L4L5"])
def test_torques_agree_with_the_controllers_model(move: str) -> None:
    text = (DATA / "ur3e_power" / f"{move}.csv").read_bytes().decode().replace("\r", "\n")
    rows = list(csv.DictReader(line for line in text.split("\n") if line))

    def column(name: str) -> np.ndarray:
        return np.array([[float(row[f"{name}_{j}"]) for j in range(6)] for row in rows])

    tool = Tool(float(rows[0]["payload"]), np.array([0.0, 0.0, float(rows[0]["payload_cog_2"])]))
    robot = load_robot("ur3e_class").with_tool(tool)
    torque = inverse_dynamics(
        robot.model, column("target_q"), column("target_qd"), column("target_qdd")
    )
    # Largest moment in the files: 19 Nm.
    assert np.abs(torque - column("target_moment")).max() < 0.1
