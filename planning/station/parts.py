"""Robot, tool and obstacles of a station from their entries in station.yaml."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import Fault, MeshError, RobotError
from dmoc.input_file import Refuse, confined
from dmoc.robot.robot import Robot, Tool, available_robots, load_robot
from planning.geometry.convex import cover_gap_m, read_pieces, sample_surface
from planning.geometry.decompose import cached_pieces, split_by_plane
from planning.geometry.mesh import UNITS, Mesh, load_link_mesh, load_mesh
from planning.geometry.shapes import Body, Shape, pose_matrix
from planning.station.schema import ObstacleEntry, PoseEntry, RobotEntry, ShapeEntry, ToolEntry

#: Declared padding of pieces: no sampled point of a mesh may lie further outside them [m].
COVER_TOLERANCE_M = 1e-4


def pose_of(entry: PoseEntry, refuse: Refuse, *field: str) -> Array:
    norm = float(np.linalg.norm(entry.quaternion_xyzw))
    if abs(norm - 1.0) > 1e-3:
        refuse(
            "quaternion",
            str(entry.quaternion_xyzw),
            "four numbers (x, y, z, w) of norm 1",
            "normalise it; w stands last",
            *field,
            "quaternion_xyzw",
        )
        return pose_matrix(entry.position_m)
    return pose_matrix(entry.position_m, entry.quaternion_xyzw)


def build_robot(
    entry: RobotEntry, folder: Path, refuse: Refuse, kept: Path | None = None
) -> Robot | None:
    """The robot at its base, with the what-if scales applied; `kept` takes its file's place."""
    if (entry.model is None) == (entry.urdf is None):
        refuse(
            "robot-choice",
            "both" if entry.model else "neither",
            "model or urdf",
            "name a robot of the package (model) or a URDF beside this file (urdf)",
        )
        return None
    if kept is None and entry.model is not None and entry.model not in available_robots():
        refuse(
            "robot-missing",
            entry.model,
            ", ".join(available_robots()),
            "mend the name, or give urdf: PATH",
            "model",
        )
        return None
    base = pose_of(entry.base, refuse, "base")
    if kept is not None:
        robot = load_robot(kept)
    elif entry.model is not None:
        robot = load_robot(entry.model)
    else:
        robot = load_robot(confined(str(entry.urdf), folder, "", "robot.urdf"))
    check_link_meshes(robot)
    if entry.mass_scale != 1.0:
        robot = robot.with_mass_scale(entry.mass_scale)
    if entry.torque_scale != 1.0:
        robot = robot.with_limits(torque_limit_nm=entry.torque_scale * robot.torque_limit_nm)
    robot = _narrowed(robot, entry, refuse)
    return robot.with_base(pin.SE3(base[:3, :3].copy(), base[:3, 3].copy()))


def check_link_meshes(robot: Robot) -> None:
    """Read every collision mesh of the robot. Errors: `RobotError` with the faults of all."""
    faults: list[Fault] = []
    for item in robot.link_shapes():
        if item.shape.kind == "mesh":
            try:
                load_link_mesh(item.shape, str(robot.urdf), f"link {item.link}.collision")
            except MeshError as error:
                faults += error.faults
    if faults:
        raise RobotError(faults)


def _narrowed(robot: Robot, entry: RobotEntry, refuse: Refuse) -> Robot:
    """The robot with the station's joint limits, which may not exceed its own."""
    limits = {"q_lower_rad": robot.q_lower_rad, "q_upper_rad": robot.q_upper_rad}
    for name, own in limits.items():
        given = getattr(entry, name)
        if given is None:
            continue
        values = np.array(given, dtype=float)
        if values.shape != own.shape:
            refuse(
                "limit-size",
                f"{len(values)} numbers",
                f"{len(own)} numbers",
                "one angle per joint",
                name,
            )
            return robot
        wider = (robot.q_lower_rad - values > 1e-5) | (values - robot.q_upper_rad > 1e-5)
        for i in np.flatnonzero(wider):
            refuse(
                "limit-range",
                f"{values[i]:g}",
                f"{robot.q_lower_rad[i]:.4f} to {robot.q_upper_rad[i]:.4f} rad",
                "a station can only narrow the robot's limits",
                name,
                int(i),
            )
        limits[name] = np.clip(values, robot.q_lower_rad, robot.q_upper_rad)
    for i in np.flatnonzero(limits["q_lower_rad"] >= limits["q_upper_rad"]):
        refuse(
            "limit-inverted",
            f"{limits['q_lower_rad'][i]:g} >= {limits['q_upper_rad'][i]:g}",
            "lower < upper",
            "swap the limits",
            "q_lower_rad",
            int(i),
        )
        return robot
    if entry.q_lower_rad is None and entry.q_upper_rad is None:
        return robot
    return robot.with_limits(**limits)


def build_tool(
    entry: ToolEntry, folder: Path, refuse: Refuse
) -> tuple[tuple[Body, ...], Tool] | None:
    """The tool's bodies in the flange frame, and its inertial values and tip."""
    tip = pose_of(entry.tip, refuse, "tip")
    inertia = np.array(entry.inertia_kg_m2, dtype=float)
    moments = np.linalg.eigvalsh(0.5 * (inertia + inertia.T))
    if not np.allclose(inertia, inertia.T, atol=1e-9):
        refuse(
            "inertia", str(entry.inertia_kg_m2), "a symmetric matrix", "mend it", "inertia_kg_m2"
        )
    elif moments[0] < -1e-12 or moments[2] > moments[0] + moments[1] + 1e-9:
        refuse(
            "inertia",
            f"principal moments {moments.round(6)}",
            "not negative, the largest at most the sum of the others",
            "give the inertia about the centre of mass, in kg m²",
            "inertia_kg_m2",
        )
    inertial = Tool(
        mass_kg=entry.mass_kg,
        com_m=np.array(entry.com_m),
        inertia_kg_m2=inertia,
        tip_position_m=tip[:3, 3],
        tip_quaternion_xyzw=np.array(entry.tip.quaternion_xyzw, dtype=float),
    )
    if entry.mesh is not None and entry.shapes is not None:
        refuse("tool-choice", "both", "mesh or shapes", "keep one of them")
        return None
    if entry.mesh is not None:
        return _mesh_tool(entry, folder, tip, refuse), inertial
    if entry.shapes is None:
        refuse(
            "tool-shape",
            "neither mesh nor shapes",
            "mesh or shapes",
            "give the tool's solid: what has none is never seen to collide (shapes: [] says "
            "that nothing hangs on the flange)",
        )
    bodies = []
    for index, shape in enumerate(entry.shapes or []):
        solid = _primitive(shape, refuse, "shapes", index)
        pose = pose_of(shape.pose, refuse, "shapes")
        if solid is not None:
            bodies.append(Body(shape.name, (solid,), pose=pose, touches=shape.touches))
    return tuple(bodies), inertial


def _mesh_tool(entry: ToolEntry, folder: Path, tip: Array, refuse: Refuse) -> tuple[Body, ...]:
    """Two bodies: what lies within `tip_length_m` of the tip may touch, the rest may not."""
    if entry.unit is None:
        refuse("unit-missing", "nothing", "m or mm", "say in which unit the mesh is drawn", "unit")
        return ()
    mesh = load_mesh(str(entry.mesh), folder, entry.unit, field="tool.mesh")
    normal = tip[:3, 2]
    behind, front = split_by_plane(mesh, normal, float(normal @ tip[:3, 3]) - entry.tip_length_m)
    bodies = []
    for name, part, touches in (("tool", behind, False), ("tool_tip", front, True)):
        if part is not None:
            bodies.append(Body(name, cached_pieces(part), mesh=_mesh_shape(part), touches=touches))
    return tuple(bodies)


def _mesh_shape(mesh: Mesh) -> Shape:
    return Shape("mesh", vertices_m=mesh.vertices_m, faces=mesh.faces)


def _primitive(
    entry: ShapeEntry | ObstacleEntry, refuse: Refuse, *field: str | int
) -> Shape | None:
    given = [name for name in ("box_m", "cylinder_m", "sphere_m") if getattr(entry, name)]
    if len(given) != 1:
        refuse(
            "shape-choice",
            ", ".join(given) or "none",
            "one of box_m, cylinder_m, sphere_m",
            "give exactly one shape",
            *field,
        )
        return None
    if entry.box_m:
        return Shape("box", tuple(float(v) for v in entry.box_m))
    if entry.cylinder_m:
        return Shape("cylinder", tuple(float(v) for v in entry.cylinder_m))
    return Shape("sphere", (float(entry.sphere_m or 0.0),))


def build_obstacle(entry: ObstacleEntry, folder: Path, refuse: Refuse) -> Body | None:
    """An obstacle in the world: a primitive, or a mesh with convex pieces that cover it."""
    pose = pose_of(entry.pose, refuse, "pose")
    if entry.mesh is None:
        solid = _primitive(entry, refuse)
        return None if solid is None else Body(entry.name, (solid,), pose=pose)
    if entry.box_m or entry.cylinder_m or entry.sphere_m:
        refuse("shape-choice", "mesh and a primitive", "one of them", "keep one of them")
        return None
    if entry.unit is None:
        refuse("unit-missing", "nothing", "m or mm", "say in which unit the mesh is drawn", "unit")
        return None
    mesh = load_mesh(entry.mesh, folder, entry.unit, field="")
    if entry.pieces is None:
        pieces = cached_pieces(mesh)
    else:
        path = confined(entry.pieces, folder, "", "pieces")
        pieces = read_pieces(path, UNITS[entry.unit], "", "pieces")
    gap = float(cover_gap_m(pieces, sample_surface(mesh, 20_000, seed=0)).max())
    if gap > COVER_TOLERANCE_M:
        refuse(
            "pieces-cover",
            f"a point of the mesh lies {1e3 * gap:.2f} mm outside them",
            f"<= {1e3 * COVER_TOLERANCE_M:g} mm",
            "enlarge the pieces, or leave pieces out to have them computed",
            "pieces",
        )
        return None
    return Body(entry.name, pieces, mesh=_mesh_shape(mesh), pose=pose)
