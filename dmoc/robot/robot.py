"""A robot: URDF and robot.yaml become a `pin.Model`, limits, tool and payload (frozen)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array, joint_vector, readonly
from dmoc.errors import RobotError
from dmoc.robot.controller import Controller, controller_from_mapping
from dmoc.robot.description import Description, LinkShape
from dmoc.robot.settings import (
    ACCELERATION_PER_SPEED,
    LOAD,
    LOAD_AT_M,
    RAMP_S,
    RESERVE,
    assumptions,
    mass_doubts,
    read_settings,
    settings_faults,
    torque_assumed,
)
from dmoc.robot.urdf import read_urdf

IDENTITY_QUATERNION = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Tool:
    """What hangs on the flange: inertial values and tip pose in the flange frame.

    `com_m` (3,), `inertia_kg_m2` (3, 3) about the centre of mass, `tip_position_m` (3,),
    `tip_quaternion_xyzw` (4,): the tip's +Z points into the work piece.
    """

    mass_kg: float = 0.0
    com_m: Array = field(default_factory=lambda: np.zeros(3))
    inertia_kg_m2: Array = field(default_factory=lambda: np.zeros((3, 3)))
    tip_position_m: Array = field(default_factory=lambda: np.zeros(3))
    tip_quaternion_xyzw: Array = field(default_factory=lambda: np.array(IDENTITY_QUATERNION))

    def __post_init__(self) -> None:
        for name, ndim in (
            ("com_m", 1),
            ("inertia_kg_m2", 2),
            ("tip_position_m", 1),
            ("tip_quaternion_xyzw", 1),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), f"tool.{name}", ndim))

    @property
    def tip(self) -> pin.SE3:
        """T_flange_tip."""
        quaternion = pin.Quaternion(np.array(self.tip_quaternion_xyzw)).normalized()
        return pin.SE3(quaternion.matrix(), np.array(self.tip_position_m))


@dataclass(frozen=True)
class PlacedShape:
    """A shape of `link` on joint number `joint` (0: the world), with `placement` T_joint_shape."""

    link: str
    joint: int
    placement: pin.SE3
    shape: LinkShape


@dataclass(frozen=True, eq=False)
class Robot:
    """A fixed-base serial arm with everything that a motion depends on.

    `model` holds the dynamics (tool and payload included, rotor armature in `model.armature`, base
    placement in the first joint); treat it as read-only. `description` is what was read from the
    URDF: links, shapes, doubts. All vectors are (n,): position limits
    [rad], velocity [rad/s], acceleration [rad/s²] and torque [N·m] limits (symmetric), armature
    [kg·m²]; jerk limits [rad/s³], None for none. `flange` is the frame that carries the tool.
    `drive` is the mapping of robot.yaml's `drive` section (read by `robot.drive`); `provenance`
    tags every value as measured, published or assumed. `controller` is how the real robot's
    controller counts the joints, None where nobody said. `allowed_collisions` are the pairs of
    links that may touch (neighbours in the chain).
    `fingerprint` changes with anything that changes a motion; robots of equal fingerprint are
    equal. Pickles carry the model itself, so a worker process needs no file for dynamics.
    """

    name: str
    model: pin.Model
    urdf: Path
    description: Description
    flange: str
    q_lower_rad: Array
    q_upper_rad: Array
    velocity_limit_rad_s: Array
    acceleration_limit_rad_s2: Array
    torque_limit_nm: Array
    armature_kg_m2: Array
    tool: Tool
    payload_kg: float
    base: pin.SE3
    drive: Mapping[str, Any]
    provenance: Mapping[str, str]
    allowed_collisions: tuple[tuple[str, str], ...]
    fingerprint: str
    mass_scale: float = 1.0
    jerk_limit_rad_s3: Array | None = None
    controller: Controller | None = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Robot) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        for name in ("drive", "provenance"):  # a mapping proxy cannot be pickled
            state[name] = dict(state[name])
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if name in ("drive", "provenance"):
                value = MappingProxyType(value)
            elif isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    @property
    def num_joints(self) -> int:
        """n."""
        return int(self.model.nv)

    @property
    def slides(self) -> npt.NDArray[np.bool_]:
        """Which joints (n,) slide: metres, newtons and kilograms stand where others have rad,
        N·m and kg·m². Only the first may: a track under the arm."""
        return self.description.slides

    @property
    def flange_id(self) -> int:
        """Number of the flange's frame in the model (a joint may share the link's name)."""
        return int(self.model.getFrameId(self.flange, pin.FrameType.BODY))

    def gravity_torque_nm(self, q_rad: Array) -> Array:
        """g(q) [N·m] for rows of q (K, n) or one q (n,)."""
        data = self.model.createData()
        rows = np.atleast_2d(np.asarray(q_rad, dtype=float))
        torque = np.array([pin.computeGeneralizedGravity(self.model, data, row) for row in rows])
        return torque[0] if np.ndim(q_rad) == 1 else torque

    def flange_pose(self, q_rad: Array) -> pin.SE3:
        """T_world_flange."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, np.asarray(q_rad, dtype=float))
        return data.oMf[self.flange_id].copy()

    def tip_pose(self, q_rad: Array) -> pin.SE3:
        """T_world_tip."""
        return self.flange_pose(q_rad) * self.tool.tip

    def link_shapes(self, visual: bool = False) -> tuple[PlacedShape, ...]:
        """The links' collision (or visual) shapes at their joints, the base's placement included.

        Tool and payload have no shape here.
        """
        return tuple(
            PlacedShape(
                link, joint, (pose if joint else self.base * pose) * shape.origin.pose, shape
            )
            for link, joint, pose in self.description.carried()
            for shape in getattr(self.description.links[link], "visual" if visual else "collision")
        )

    def with_tool(self, tool: Tool) -> Robot:
        """This robot with `tool` on its flange instead of the present one."""
        return _assemble(self, tool=tool)

    def with_payload(self, payload_kg: float) -> Robot:
        """This robot carrying a point mass `payload_kg` at the tool tip."""
        return _assemble(self, payload_kg=payload_kg)

    def with_base(self, base: pin.SE3) -> Robot:
        """This robot standing at T_world_base."""
        return _assemble(self, base=base)

    def with_mass_scale(self, mass_scale: float) -> Robot:
        """This robot with every link's mass and inertia multiplied (tool and payload are not)."""
        return _assemble(self, mass_scale=mass_scale)

    def with_limits(self, **limits: Array | float) -> Robot:
        """This robot with other limits (field names of this class, scalars repeat)."""
        vectors: dict[str, Any] = {
            key: joint_vector(value, key, self.num_joints) for key, value in limits.items()
        }
        changed = replace(self, **vectors)
        return replace(changed, fingerprint=_fingerprint(changed))


def _robot_root() -> Path:
    return Path(str(resources.files("dmoc"))) / "robots"


def available_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return tuple(sorted(p.parent.name for p in _robot_root().glob("*/robot.yaml")))


def load_robot(
    name_or_path: str | Path,
    package_path: Sequence[str | Path] = (),
    settings: Mapping[str, Any] = MappingProxyType({}),
) -> Robot:
    """A robot of the package by name, or from a URDF or xacro file with `robot.yaml` beside it.

    `package_path` are folders where packages are looked for besides the usual places; `settings`
    are entries that robot.yaml does not give.
    Errors: `RobotError` with every fault found (file, line, field, value, legal range, fix).
    """
    text = str(name_or_path)
    if text in available_robots():
        urdf = _robot_root() / text / f"{text}.urdf"
    else:
        urdf = Path(text)
        if urdf.is_dir():
            candidates = sorted(urdf.glob("*.urdf"))
            urdf = candidates[0] if len(candidates) == 1 else urdf / f"{urdf.name}.urdf"
        if not urdf.is_file():
            raise RobotError.of(
                "robot-missing",
                file=text,
                field="robot",
                value=text,
                legal="one of " + ", ".join(available_robots()) + ", or the path of a URDF",
                fix="check the name or the path",
            )
    tree = read_settings(urdf)
    tree.data = settings = {**settings, **tree.data}
    description = read_urdf(urdf, settings, package_path)
    model = description.build_model()
    faults = settings_faults(urdf, tree, model, description)
    if faults:
        raise RobotError(faults)
    n = model.nv

    def vector(key: str, default: Array) -> Array:
        value = settings.get(key)
        return joint_vector(default if value is None else value, key, n)

    velocity = vector("velocity_limit_rad_s", model.velocityLimit)
    torque = vector("torque_limit_nm", model.effortLimit)
    lower, upper = (
        vector(key, getattr(model, f"{end}PositionLimit"))
        for key, end in (("q_lower_rad", "lower"), ("q_upper_rad", "upper"))
    )
    doubts, controller = [*description.warnings, *mass_doubts(urdf, model)], None
    if settings.get("controller") is not None:
        controller = controller_from_mapping(settings["controller"], n, description.slides)
        doubts += controller.doubts(str(urdf.with_name("robot.yaml")), lower, upper)
    robot = Robot(
        name=str(settings.get("name", urdf.stem)),
        model=model,
        urdf=urdf.resolve(),
        description=replace(
            description, warnings=(*doubts, *assumptions(urdf, tree, velocity, torque))
        ),
        flange=description.flange,
        q_lower_rad=lower,
        q_upper_rad=upper,
        velocity_limit_rad_s=velocity,
        acceleration_limit_rad_s2=vector(
            "acceleration_limit_rad_s2", ACCELERATION_PER_SPEED * velocity
        ),
        torque_limit_nm=torque,
        armature_kg_m2=vector("armature_kg_m2", np.zeros(n)),
        tool=Tool(),
        payload_kg=0.0,
        base=pin.SE3.Identity(),
        drive=MappingProxyType(dict(settings.get("drive", {}))),
        provenance=MappingProxyType(dict(settings.get("provenance", {}))),
        allowed_collisions=tuple(
            (str(first), str(second)) for first, second in settings.get("allowed_collisions", ())
        ),
        fingerprint="",
        jerk_limit_rad_s3=vector("jerk_limit_rad_s3", np.zeros(n))
        if "jerk_limit_rad_s3" in settings
        else None,
        controller=controller,
    )
    robot, missing = _assemble(robot), np.flatnonzero(torque == 0)
    if not len(missing):
        return robot
    torque = np.where(torque == 0, estimated_torque_nm(robot), torque)
    joints = list(model.names)[1:]
    warning = torque_assumed(urdf, [joints[i] for i in missing], torque)
    doubts += [*assumptions(urdf, tree, velocity, torque), warning]
    return _assemble(
        robot,
        torque_limit_nm=readonly(torque, "torque_limit_nm", 1),
        description=replace(description, warnings=tuple(doubts)),
        provenance=MappingProxyType({**robot.provenance, "torque_limit_nm": "assumed"}),
    )


def estimated_torque_nm(robot: Robot) -> Array:
    """Torque limits (n,) for an arm of which nobody gave any.

    1.5 times what holding the arm and a tenth of its mass at the flange takes in the worst of 500
    random poses, and reaching the speed in 0.3 s on top.
    """
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    loaded = robot.with_tool(Tool(LOAD * mass, np.array([LOAD_AT_M, 0.0, LOAD_AT_M])))
    rng, data = np.random.default_rng(0), loaded.model.createData()
    q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (500, robot.num_joints))
    hold = np.abs(loaded.gravity_torque_nm(q)).max(axis=0)
    inertia = np.max([np.diag(pin.crba(loaded.model, data, row)) for row in q], axis=0)
    return np.asarray(RESERVE * (hold + inertia * robot.velocity_limit_rad_s / RAMP_S))


def _assemble(robot: Robot, **changes: Any) -> Robot:
    """Rebuild the model with tool, payload and base, and refresh the fingerprint."""
    changed = replace(robot, **changes)
    model = changed.description.build_model()
    # Exact 0/±1 in the placements keep the symbolic dynamics small: a quarter turn written with
    # six digits would otherwise leave terms of 1e-7 everywhere.
    for i in range(model.njoints):
        model.jointPlacements[i] = _snap(model.jointPlacements[i])
    model.jointPlacements[1] = changed.base * model.jointPlacements[1]
    for i, frame in enumerate(model.frames):
        if frame.parentJoint == 0 and i > 0:
            model.frames[i].placement = changed.base * frame.placement
    if changed.mass_scale != 1.0:
        for i in range(model.njoints):
            link, scale = model.inertias[i], changed.mass_scale
            model.inertias[i] = pin.Inertia(scale * link.mass, link.lever, scale * link.inertia)
    model.armature = np.array(changed.armature_kg_m2)
    frame = model.frames[model.getFrameId(changed.flange, pin.FrameType.BODY)]
    tool = changed.tool
    if tool.mass_kg > 0:
        inertia = pin.Inertia(tool.mass_kg, np.array(tool.com_m), np.array(tool.inertia_kg_m2))
        model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    if changed.payload_kg > 0:
        point = pin.Inertia(changed.payload_kg, np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(frame.parentJoint, point, frame.placement * tool.tip)
    changed = replace(changed, model=model)
    return replace(changed, fingerprint=_fingerprint(changed))


def _snap(placement: pin.SE3) -> pin.SE3:
    rotation, translation = placement.rotation.copy(), placement.translation.copy()
    for block in (rotation, translation):
        nearest = np.round(block)
        block[np.abs(block - nearest) < 1e-5] = nearest[np.abs(block - nearest) < 1e-5]
    left, _, right = np.linalg.svd(rotation)
    exact = (
        rotation if np.array_equal(np.abs(rotation), np.round(np.abs(rotation))) else left @ right
    )
    return pin.SE3(exact, translation)


def _fingerprint(robot: Robot) -> str:
    """sha256 over everything that changes dynamics or limits, independent of file paths."""
    model = robot.model
    digest = hashlib.sha256()
    for i in range(model.njoints):
        digest.update(model.joints[i].shortname().encode())
        if hasattr(joint := model.joints[i].extract(), "axis"):  # the name says it of the others
            digest.update(np.ascontiguousarray(joint.axis, dtype=float).tobytes())
        digest.update(np.ascontiguousarray(model.jointPlacements[i].homogeneous).tobytes())
        inertia = model.inertias[i]
        digest.update(np.float64(inertia.mass).tobytes() + inertia.lever.tobytes())
        digest.update(np.ascontiguousarray(inertia.inertia).tobytes())
    for vector in (
        model.armature,
        model.gravity.vector,
        robot.q_lower_rad,
        robot.q_upper_rad,
        robot.velocity_limit_rad_s,
        robot.acceleration_limit_rad_s2,
        robot.torque_limit_nm,
        robot.tool.tip.homogeneous,
    ):
        digest.update(np.ascontiguousarray(vector, dtype=np.float64).tobytes())
    flange = model.frames[robot.flange_id]
    digest.update(np.ascontiguousarray(flange.placement.homogeneous).tobytes())
    if flange.parentJoint != model.njoints - 1:  # where it nearly always is
        digest.update(f"flange on joint {flange.parentJoint}".encode())
    if robot.jerk_limit_rad_s3 is not None:
        digest.update(np.ascontiguousarray(robot.jerk_limit_rad_s3).tobytes())
    digest.update(json.dumps(dict(robot.drive), sort_keys=True, default=str).encode())
    return digest.hexdigest()
