"""ROS: one trajectory_msgs/JointTrajectory per motion, as JSON."""

from __future__ import annotations

from typing import Any

from dmoc.motion.trajectory import JointTrajectory
from sequencing.cycle_types import Weld
from sequencing.export.wording import header_lines, steps
from sequencing.runs.archive import json_text
from sequencing.runs.folder import Run, motion_file_name

ROS_STATEMENT = (
    "Points carry positions and velocities and no accelerations, so that a controller with cubic "
    "splines follows the planned curve exactly. Point-to-point execution of the same points does "
    "not preserve the torque timing."
)


def ros_files(run: Run) -> dict[str, str]:
    """File name → text: every motion, and `cycle.json` with the order of motions and welds."""
    files, order = {}, []
    head = header_lines(run, ROS_STATEMENT)
    for step in steps(run):
        if isinstance(step, Weld):
            order.append({"weld": step.stud, "hold_s": step.time_s})
            continue
        item, trajectory = step
        name = motion_file_name(item).removesuffix(".csv") + ".json"
        message = joint_trajectory(run.joint_names, trajectory)
        files[name] = json_text({"comment": head, "key": item.key, "joint_trajectory": message})
        order.append({"motion": name})
    files["cycle.json"] = json_text({"comment": head, "order": order})
    return files


def joint_trajectory(names: tuple[str, ...], trajectory: JointTrajectory) -> dict[str, Any]:
    """The message: one point a knot, time from the start in whole nanoseconds."""
    points = []
    for t, q, v in zip(trajectory.t_s, trajectory.q_rad, trajectory.velocity_rad_s):
        nanoseconds = round(float(t - trajectory.t_s[0]) * 1e9)
        points.append(
            {
                "positions": q.tolist(),
                "velocities": v.tolist(),
                "accelerations": [],
                "effort": [],
                "time_from_start": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9},
            }
        )
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(names),
        "points": points,
    }
