"""Panda and UR5 of example-robot-data as `dmoc.Robot`s, for the MotionBenchMaker problems.

The package's URDFs are rewritten into a folder of our own: collision meshes copied beside the
file, visuals dropped, the Panda's fingers locked open, the UR5's joints limited to ±π, and a
convex stand-in of our own for the FT 300 sensor and Robotiq 85 gripper at the UR5's flange.
"""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
from published_robots import drop, source_folder

from dmoc.robot.robot import Robot, Tool, load_robot
from planning.geometry.shapes import Body, Shape, pose_matrix

__all__ = ["panda", "srdf_of", "ur5", "ur5_gripper"]

FINGER_OPEN_M = 0.04
ARMATURE = {"panda": 0.1, "ur5": 0.1}


def srdf_of(robot: Robot) -> Path:
    """The SRDF that example-robot-data has for one of these robots."""
    files = {"panda": "panda_description/srdf/panda.srdf", "ur5": "ur_description/srdf/ur5.srdf"}
    return source_folder() / files[robot.name]


def _rewrite(urdf: Path, out: Path, name: str) -> ET.ElementTree:
    tree = ET.parse(urdf)
    root = tree.getroot()
    root.set("name", name)
    drop(root, "transmission", "gazebo", "material")
    (out / "meshes").mkdir(parents=True, exist_ok=True)
    for link in root.findall("link"):
        drop(link, "visual")
        inertial = link.find("inertial")
        if inertial is not None and float(inertial.find("mass").get("value")) == 0.0:
            link.remove(inertial)
        for mesh in link.iter("mesh"):
            relative = mesh.get("filename").split("example-robot-data/robots/")[1]
            target = out / "meshes" / f"{name}_{Path(relative).name}"
            shutil.copyfile(source_folder() / relative, target)
            mesh.set("filename", f"meshes/{target.name}")
    for joint in root.findall("joint"):
        drop(joint, "mimic", "safety_controller", "calibration", "dynamics")
    return tree


def _write(tree: ET.ElementTree, out: Path, name: str, flange: str, joints: int) -> Robot:
    path = out / f"{name}.urdf"
    tree.write(path)
    armature = [ARMATURE[name]] * joints
    (out / "robot.yaml").write_text(
        f"name: {name}\nflange: {flange}\narmature_kg_m2: {armature}\n"
        "provenance: {armature_kg_m2: assumed}\n"
    )
    return load_robot(path)


def panda(out: Path) -> Robot:
    """The Panda with its hand, fingers locked open; base at the origin."""
    tree = _rewrite(source_folder() / "panda_description/urdf/panda.urdf", out / "panda", "panda")
    for joint in tree.getroot().findall("joint"):
        if "finger" in joint.get("name"):
            joint.set("type", "fixed")
            axis = np.array([float(x) for x in joint.find("axis").get("xyz").split()])
            origin = joint.find("origin")
            at = np.array([float(x) for x in origin.get("xyz").split()]) + axis * FINGER_OPEN_M
            origin.set("xyz", " ".join(f"{x:.9g}" for x in at))
            for tag in ("axis", "limit"):
                joint.remove(joint.find(tag))
    return _write(tree, out / "panda", "panda", "panda_hand", 7)


def ur5(out: Path) -> Robot:
    """The UR5 as the problems mount it: base at (0, 0, 0.9144) m, turned by 1.57 rad."""
    tree = _rewrite(source_folder() / "ur_description/urdf/ur5_robot.urdf", out / "ur5", "ur5")
    for joint in tree.getroot().findall("joint"):
        limit = joint.find("limit")
        if limit is not None:
            limit.set("lower", "-3.1415926536")
            limit.set("upper", "3.1415926536")
    robot = _write(tree, out / "ur5", "ur5", "ee_link", 6)
    base = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 1.57), np.array([0.0, 0.0, 0.9144]))
    weight = Tool(mass_kg=1.3, com_m=np.array([0.08, 0, 0]), inertia_kg_m2=np.eye(3) * 3e-3)
    return robot.with_base(base).with_tool(weight)


def ur5_gripper() -> tuple[Body, ...]:
    """Stand-in for FT 300 and Robotiq 85, open: x of `ee_link` points out of the flange."""
    along_x = (0.0, np.sin(np.pi / 4), 0.0, np.cos(np.pi / 4))
    sensor = Shape("cylinder", (0.0375, 0.0375), pose=pose_matrix((0.019, 0, 0), along_x))
    palm = Shape("box", (0.085, 0.085, 0.065), pose=pose_matrix((0.081, 0, 0)))
    fingers = tuple(
        Shape("box", (0.08, 0.03, 0.025), pose=pose_matrix((0.16, side * 0.0575, 0)))
        for side in (1, -1)
    )
    return (Body("sensor", (sensor,)), Body("gripper", (palm, *fingers)))
