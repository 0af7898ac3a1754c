"""Random serial arms, as pinocchio models and as robots loaded from URDF files."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from dmoc.motion.motion import MotionProblem
from dmoc.robot.robot import Robot, load_robot


def random_inertia(rng: np.random.Generator) -> pin.Inertia:
    size = rng.uniform(0.05, 0.4, 3)
    mass = rng.uniform(0.5, 20.0)
    return pin.Inertia.FromBox(mass, *size).se3Action(
        pin.SE3(pin.SE3.Random().rotation, rng.normal(0, 0.2, 3))
    )


def random_model(rng: np.random.Generator, num_joints: int, tree: bool = True) -> pin.Model:
    """Revolute and prismatic joints about coordinate and oblique axes, random armature."""
    pin.seed(int(rng.integers(1 << 30)))
    model, parent = pin.Model(), 0
    for i in range(num_joints):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        kinds = (
            pin.JointModelRX(),
            pin.JointModelRY(),
            pin.JointModelRZ(),
            pin.JointModelPZ(),
            pin.JointModelRevoluteUnaligned(*axis),
            pin.JointModelPrismaticUnaligned(*axis),
        )
        joint = kinds[rng.integers(len(kinds))]
        # Branches grow depth first, the order that pinocchio's algorithms rely on.
        while tree and parent > 0 and rng.random() < 0.3:
            parent = int(model.parents[parent])
        placement = pin.SE3(pin.SE3.Random().rotation, rng.normal(0, 0.5, 3))
        parent = model.addJoint(parent, joint, placement, f"j{i}")
        model.appendBodyToJoint(parent, random_inertia(rng), pin.SE3.Identity())
    model.armature = rng.uniform(0, 2, num_joints)
    model.gravity.linear = rng.normal(size=3) * 9.81
    return model


def random_urdf(rng: np.random.Generator, folder: Path, num_joints: int) -> Path:
    """A serial arm with limits that hold it against gravity; `robot.yaml` beside it."""
    links = ["<link name='base'/>"]
    joints = []
    for i in range(num_joints):
        mass = 20.0 / (i + 1)
        xyz = " ".join(f"{x:.4f}" for x in rng.uniform(-0.1, 0.4, 3))
        rpy = " ".join(str(x) for x in rng.choice([0.0, 1.5707963267948966], 3))
        axis = ("1 0 0", "0 1 0", "0 0 1")[rng.integers(3)]
        diag = rng.uniform(0.02, 0.2) * mass
        links.append(
            f"<link name='l{i}'><inertial><origin xyz='{xyz}'/><mass value='{mass}'/>"
            f"<inertia ixx='{diag}' iyy='{diag}' izz='{diag}' ixy='0' ixz='0' iyz='0'/>"
            "</inertial></link>"
        )
        parent = "base" if i == 0 else f"l{i - 1}"
        joints.append(
            f"<joint name='j{i}' type='revolute'><parent link='{parent}'/><child link='l{i}'/>"
            f"<origin xyz='{xyz}' rpy='{rpy}'/><axis xyz='{axis}'/>"
            f"<limit lower='-3' upper='3' velocity='{rng.uniform(1, 4):.3f}' effort='"
            f"{800 / (i + 1):.1f}'/></joint>"
        )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "arm.urdf"
    path.write_text(f"<robot name='arm'>{''.join(links)}{''.join(joints)}</robot>")
    armature = ", ".join(f"{x:.4f}" for x in rng.uniform(0.05, 0.5, num_joints))
    (folder / "robot.yaml").write_text(f"armature_kg_m2: [{armature}]\n")
    return path


def random_robot(seed: int, folder: Path, num_joints: int) -> Robot:
    rng = np.random.default_rng(seed)
    return load_robot(random_urdf(rng, folder / f"arm{seed}", num_joints))


def random_pairs(
    robot: Robot, count: int, seed: int = 0, span: float = 2.0
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Start and goal within limits and `span`, with |g(q)| ≤ 0.9 u_max at both."""
    rng, out = np.random.default_rng(seed), []
    lower, upper = np.maximum(robot.q_lower_rad, -span), np.minimum(robot.q_upper_rad, span)
    while len(out) < count:
        pair = rng.uniform(lower, upper, (2, robot.num_joints))
        if np.all(np.abs(robot.gravity_torque_nm(pair)) <= 0.9 * robot.torque_limit_nm):
            out.append((pair[0], pair[1]))
    return out


def random_problems(robot: Robot, count: int, seed: int = 0, **fields) -> list[MotionProblem]:
    return [MotionProblem(robot, *pair, **fields) for pair in random_pairs(robot, count, seed)]
