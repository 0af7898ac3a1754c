"""MotionBenchMaker problems: scene and request files as worlds, starts and goals."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dmoc.robot.robot import Robot
from planning.collision.pairs import checked_pairs
from planning.collision.robot_bodies import link_bodies, tool_mounts
from planning.collision.world import CollisionWorld, world_for
from planning.geometry.shapes import Body, Shape, pose_matrix

__all__ = ["SETS", "Problem", "data_folder", "problems"]

SETS = {
    "panda": ("bookshelf_thin_panda", "box_panda", "table_pick_panda"),
    "ur5": ("bookshelf_small_ur5", "box_ur5", "table_pick_ur5"),
}
GRIPPER = {"sensor": "fts_toolside", "gripper": "robotiq_85_base_link"}


@dataclass(frozen=True)
class Problem:
    """One planning problem: a world, start and goal (n,)."""

    name: str
    world: CollisionWorld
    start_rad: np.ndarray
    goal_rad: np.ndarray


def data_folder() -> Path:
    """The benchmark data: DMOC_DATA, else ../shared/data beside the project."""
    default = Path(__file__).resolve().parents[1].parent / "shared" / "data"
    return Path(os.environ.get("DMOC_DATA", default)) / "motionbenchmaker"


def problems(
    robot: Robot,
    tool: tuple[Body, ...],
    folder: Path,
    engine: str = "native",
    srdf: Path | None = None,
) -> Iterator[Problem]:
    """All problems of one set, in order; with `srdf` it says what may touch, not the scene."""
    for request_file in sorted(folder.glob("request*.yaml")):
        number = request_file.stem.removeprefix("request")
        scene = _load(folder / f"scene{number}.yaml")
        request = _load(request_file)
        allowed = () if srdf else _allowed(robot, tool, scene["allowed_collision_matrix"])
        world = world_for(
            robot, tool, tuple(_obstacles(scene)), allowed, 0.0, srdf=srdf, engine=engine
        )
        state = request["start_state"]["joint_state"]
        start = dict(zip(state["name"], state["position"]))
        goals = request["goal_constraints"][0]["joint_constraints"]
        goal = {g["joint_name"]: g["position"] for g in goals}
        names = list(robot.model.names)[1:]
        yield Problem(
            f"{folder.name}/{number}",
            world,
            np.array([start[n] for n in names], dtype=float),
            np.array([goal[n] for n in names], dtype=float),
        )


def _load(path: Path) -> Any:
    with path.open(encoding="utf-8") as file:
        return yaml.load(file, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def _obstacles(scene: dict[str, Any]) -> Iterator[Body]:
    for item in scene["world"]["collision_objects"]:
        pose = np.eye(4)
        if "pose" in item:
            pose = pose_matrix(item["pose"]["position"], item["pose"]["orientation"])
        shapes = []
        for primitive, place in zip(item["primitives"], item["primitive_poses"]):
            local = pose_matrix(place["position"], place["orientation"])
            size = [float(x) for x in primitive["dimensions"]]
            if primitive["type"] == "box":
                shapes.append(Shape("box", tuple(size), pose=local))
            elif primitive["type"] == "sphere":
                shapes.append(Shape("sphere", (size[0],), pose=local))
            else:  # the files give height before radius
                shapes.append(Shape("cylinder", (size[1], size[0]), pose=local))
        yield Body(item["id"], tuple(shapes), pose=pose)


def _allowed(robot: Robot, tool: tuple[Body, ...], matrix: dict[str, Any]) -> list[tuple[str, str]]:
    """Pairs that the scene's matrix allows, for those of our bodies that it names."""
    entry = {name: i for i, name in enumerate(matrix["entry_names"])}
    links, tools = link_bodies(robot), tool_mounts(robot, tool)
    allowed = []
    for a, b in checked_pairs(robot.model, links, tools, (), ()):
        i, k = entry.get(GRIPPER.get(a, a)), entry.get(GRIPPER.get(b, b))
        if i is not None and k is not None and matrix["entry_values"][i][k]:
            allowed.append((a, b))
    return allowed
