"""A probabilistic roadmap of a station: built once, shared by all its edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import networkx as nx
import numpy as np

from dmoc.arrays import Array, readonly
from dmoc.status import Status
from dmoc.trajectory import JointPath
from planning.certificate import prove_path
from planning.edge_clearance import EdgeClearance
from planning.roadmap import PathResult, plan_path
from planning.shortcut import shortcut
from planning.world import CollisionWorld

__all__ = ["Roadmap", "build_roadmap", "plan_on_roadmap"]


@dataclass(frozen=True)
class Roadmap:
    """Free configurations `q_rad` (K, n) and, as a graph on their numbers, free segments.

    `graph` has the segments' lengths as `length` [m] (joint steps scaled by the joints' mean
    reach); nodes and segments keep `inflation_m` from everything (a quarter of it between bodies
    of the robot). Departure lines play no role here: they matter at the ends, which a query adds.
    """

    q_rad: Array
    graph: nx.Graph
    inflation_m: float
    step_m: float


def build_roadmap(
    world: CollisionWorld,
    *,
    seed: int,
    num_nodes: int = 300,
    neighbours: int = 8,
    inflation_m: float = 0.02,
    step_m: float = 0.07,
    near_rad: Array | None = None,
    spread_rad: float = 0.8,
) -> Roadmap:
    """Sample `num_nodes` free configurations and join each to its nearest `neighbours`.

    Kavraki et al. (1996). Half of the samples are uniform within the limits; the other half lie
    around the rows of `near_rad` (M, n), the ends of the station's edges, if given, with a
    normal spread. Same seed, same roadmap. Fewer nodes come out where free space is rare: at most
    fifty samples a node are tried.
    """
    robot, scene = world.robot, world.scene
    rng = np.random.default_rng(seed)
    growth = _growth(world, inflation_m)
    scope = scene.everything.grown(growth)
    nodes: list[Array] = []
    for _ in range(50):
        count = num_nodes - len(nodes)
        if count <= 0:
            break
        q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (count, robot.num_joints))
        if near_rad is not None and len(near_rad):
            around = near_rad[rng.integers(0, len(near_rad), count // 2)]
            q[: count // 2] = around + rng.normal(scale=spread_rad, size=around.shape)
            q = np.clip(q, robot.q_lower_rad, robot.q_upper_rad)
        nodes += list(q[scene.first_contacts(np.ascontiguousarray(q), 0.0, scope) < 0])
    points = np.array(nodes[:num_nodes]).reshape(-1, robot.num_joints)
    graph = nx.Graph()
    graph.add_nodes_from(range(len(points)))
    for i in range(len(points)):
        length = np.linalg.norm((points - points[i]) * scene.lever_m, axis=1)
        for k in np.argsort(length, kind="stable")[1 : neighbours + 1]:
            if graph.has_edge(i, int(k)):
                continue
            if scene.segment_contact(points[i], points[k], step_m, 0.0, scope) < 0:
                graph.add_edge(i, int(k), length=float(length[k]))
    return Roadmap(readonly(points, "roadmap", 2), graph, inflation_m, step_m)


def plan_on_roadmap(
    roadmap: Roadmap,
    clearance: EdgeClearance,
    start_rad: Array,
    goal_rad: Array,
    *,
    seed: int,
    links: int = 12,
    shortcut_tries: int = 80,
) -> PathResult:
    """A path over the roadmap, shortened and proven; by `plan_path` where the roadmap has none.

    Start and goal are joined to their nearest `links` nodes. The straight line comes first.
    """
    world = clearance.world
    scene = world.scene
    ends = scene.rows_of(np.stack([np.asarray(start_rad), np.asarray(goal_rad)])).copy()
    scope = clearance.scope.grown(0.5 * _growth(world, roadmap.inflation_m))
    checks = 0

    def is_free(q0: Array, q1: Array) -> bool:
        nonlocal checks
        checks += 1
        return scene.segment_contact(q0, q1, roadmap.step_m, 0.0, scope) < 0

    if np.any(scene.first_contacts(ends, 0.0, scope) >= 0):
        return plan_path(clearance, start_rad, goal_rad, seed=seed)
    found = ends if is_free(*ends) else _over(roadmap, ends, scene.lever_m, links, is_free)
    if found is not None:
        short = shortcut(
            found, is_free, scale=scene.lever_m, tries=shortcut_tries, seed=seed
        )  # fmt: skip
        for path in (short, found):
            if prove_path(clearance, path):
                return PathResult(
                    Status.CONVERGED, JointPath(path), note="roadmap", checks=checks
                )  # fmt: skip
    return plan_path(clearance, start_rad, goal_rad, seed=seed)


def _over(
    roadmap: Roadmap, ends: Array, scale: Array, links: int, is_free: Callable[[Array, Array], bool]
) -> Array | None:
    """The shortest way from ends[0] over the roadmap to ends[1], or None."""
    graph = roadmap.graph.copy()
    for name, q in zip(("start", "goal"), ends):
        length = np.linalg.norm((roadmap.q_rad - q) * scale, axis=1)
        graph.add_node(name)
        for k in np.argsort(length, kind="stable")[:links]:
            if is_free(q, roadmap.q_rad[k]):
                graph.add_edge(name, int(k), length=float(length[k]))
    try:
        nodes = nx.dijkstra_path(graph, "start", "goal", weight="length")
    except nx.NetworkXNoPath:
        return None
    return np.vstack([ends[0], *(roadmap.q_rad[k] for k in nodes[1:-1]), ends[1]])


def _growth(world: CollisionWorld, inflation_m: float) -> Array:
    joint = world.scene.solids.info[world.scene.pairs.piece, 0]
    return np.where(joint.min(axis=1) > 0, 0.25 * inflation_m, inflation_m)
