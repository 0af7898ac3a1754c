"""Robots as example-robot-data publishes them, without rotor inertia: dynamics and limits alone.

The URDFs are rewritten without pictures and collision shapes, grippers locked, into a folder.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from dmoc.robot.robot import Robot, load_robot

FILES = {
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
}
_FLANGES = {"panda": "panda_hand_tcp", "kinova": "j2s6s200_end_effector"}
_NOT_ARM = ("finger", "gripper", "knuckle", "drive_joint")


def source_folder() -> Path:
    """The robots of example-robot-data."""
    for folder in map(Path, sys.path):
        found = folder / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
        if found.is_dir():
            return found
    raise FileNotFoundError("example-robot-data is not installed: pip install 'dmoc[bench]'")


def published_robot(name: str, folder: Path) -> Robot:
    """One of `FILES`, rewritten into `folder`; acceleration limits are the default ones."""
    tree = ET.parse(source_folder() / FILES[name])
    root = tree.getroot()
    root.set("name", name)
    drop(root, "transmission", "gazebo", "material")
    for link in root.findall("link"):
        drop(link, "visual", "collision")
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if mass is not None and float(mass.get("value", "0")) == 0.0:
            drop(link, "inertial")
    for joint in root.findall("joint"):
        drop(joint, "mimic", "safety_controller", "calibration", "dynamics")
        label = joint.get("name", "").lower()
        if joint.get("type") == "prismatic" or any(part in label for part in _NOT_ARM):
            joint.set("type", "fixed")
            drop(joint, "axis", "limit")
    target = folder / name / f"{name}.urdf"
    target.parent.mkdir(parents=True, exist_ok=True)
    tree.write(target)
    if name in _FLANGES:
        (target.parent / "robot.yaml").write_text(f"flange: {_FLANGES[name]}\n")
    return load_robot(target)


def drop(element: ET.Element, *tags: str) -> None:
    """Remove the direct children with these tags."""
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)
