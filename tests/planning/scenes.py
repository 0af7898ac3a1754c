"""Small scenes for the tests of planning: an arm among boxes, arms with many joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot, load_robot
from planning.geometry.shapes import Body, Shape, pose_matrix


def box(name: str, size: tuple[float, ...], at: tuple[float, ...]) -> Body:
    return Body(name, (Shape("box", size, pose=pose_matrix(at)),))


def clutter(seed: int, count: int = 6) -> tuple[Body, ...]:
    """Boxes, spheres, cylinders and random hulls around an arm at the origin."""
    rng = np.random.default_rng(seed)
    bodies = []
    for i in range(count):
        at = np.append(
            rng.uniform(0.35, 1.0) * _circle(rng.uniform(0, 2 * np.pi)), rng.uniform(-0.2, 1.2)
        )
        turn = rng.normal(size=4)
        pose = pose_matrix(at, turn / np.linalg.norm(turn))
        shape = (
            Shape("box", tuple(rng.uniform(0.05, 0.4, 3)), pose=pose),
            Shape("sphere", (rng.uniform(0.05, 0.2),), pose=pose),
            Shape("cylinder", tuple(rng.uniform(0.05, 0.3, 2)), pose=pose),
            Shape("convex", vertices_m=rng.normal(scale=0.12, size=(25, 3)), pose=pose),
        )[i % 4]
        bodies.append(Body(f"thing_{i}", (shape,)))
    return tuple(bodies)


def _circle(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def snake(folder: Path, joints: int, limit: float = 3.0) -> Robot:
    """An arm of `joints` links of 0.2 m: turns about z up to ±limit, bends about y to ±2.2."""
    parts = ['<robot name="snake">', _link(0)]
    for i in range(1, joints + 1):
        axis, most = ("0 0 1", limit) if i % 2 else ("0 1 0", min(limit, 2.2))
        parts.append(
            f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="0 0 0.2"/><axis xyz="{axis}"/>'
            f'<limit lower="{-most}" upper="{most}" velocity="2" effort="100"/></joint>'
        )
        parts.append(_link(i))
    path = folder / "snake.urdf"
    path.write_text("\n".join([*parts, "</robot>"]))
    (folder / "robot.yaml").write_text(f"name: snake\nflange: l{joints}\n")
    return load_robot(path)


def _link(i: int) -> str:
    return (
        f'<link name="l{i}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.12"/>'
        "</geometry></collision></link>"
    )


def random_q(robot: Robot, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (count, robot.num_joints))


def quintic(a: np.ndarray, b: np.ndarray, knots: int = 11, duration: float = 2.0):
    """A rest-to-rest trajectory on the straight joint-space line from a to b."""
    t = np.linspace(0, duration, knots)
    s = (t / duration)[:, None]
    q = a + (10 * s**3 - 15 * s**4 + 6 * s**5) * (b - a)
    v = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration * (b - a)
    return JointTrajectory(t, q, v, np.zeros((knots - 1, len(a))))
