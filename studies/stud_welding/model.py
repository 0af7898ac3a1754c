"""A station under given assumptions: its nodes, its edges, and what a change of them leaves equal.

Masses, torque limits and cost weights change what poses and motions cost, not which poses there
are: all such models share the nodes, so that sequences can be priced under each of them.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import Motion
from dmoc.refinement.params import Method
from dmoc.robot.robot import Robot
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from sequencing.cycle.plan import PlanEvent
from sequencing.cycle_types import CycleCost
from sequencing.edges.nodes import StationNodes
from sequencing.edges.oracle import StationEdges
from sequencing.edges.store import EdgeStore


@dataclass(frozen=True, eq=False)
class StudyBench:
    """What all parts of the study share: seed, store, executor, progress, who solves."""

    seed: int
    store: EdgeStore
    executor: Executor | None
    progress: Callable[[PlanEvent], None]
    solver: str = DEFAULT_SOLVER
    method: Method = "halfspaces"

    def tell(self, phase: str) -> None:
        """Name the part of the study that begins."""
        self.progress(PlanEvent(phase))


class Edges(Protocol):
    """What the study asks of a model's edges; `StationEdges` is one.

    `costs` are the solved ones by (from, to); `symmetric` says that (i, j), i < j, stands for both
    directions.
    """

    symmetric: bool
    seed: int
    costs: dict[tuple[int, int], float]

    def evaluate(self, pairs: np.ndarray) -> Array: ...

    def motions(self, pairs: np.ndarray) -> list[Motion]: ...


@dataclass(frozen=True, eq=False)
class Model:
    """A station with its nodes and edges; `rough` (V, V) are the straight lines' costs."""

    name: str
    station: Station
    nodes: StationNodes
    edges: Edges
    rough: Array

    def cost_of(self, nodes: tuple[int, ...]) -> CycleCost | None:
        """Cost of a cycle at screening quality; None where a travel has no certified motion."""
        travel = self.edges.evaluate(travels(nodes))
        if not np.all(np.isfinite(travel)):
            return None
        return CycleCost(float(np.sum(travel)), float(np.sum(self.nodes.weld_cost[list(nodes)])))

    def studs_of(self, nodes: tuple[int, ...]) -> tuple[str, ...]:
        """Stud ids of a cycle without home, in order."""
        return tuple(self.nodes.stud[v] for v in nodes if v != self.nodes.home)


def travels(nodes: tuple[int, ...]) -> np.ndarray:
    """(K, 2) travels of a cycle of nodes."""
    here = np.array(nodes, dtype=np.int64)
    return np.stack([here, np.roll(here, -1)], axis=1)


def open_model(
    name: str, station: Station, nodes: StationNodes, world: CollisionWorld, bench: StudyBench
) -> Model:
    """Edges of `station` between `nodes`, before anything is trained; close `edges` when done."""
    edges = StationEdges(
        station,
        world,
        nodes,
        bench.store,
        seed=bench.seed,
        method=bench.method,
        solver=bench.solver,
        executor=bench.executor,
        progress=lambda event: bench.progress(PlanEvent("edges", event)),
    )
    return Model(name, station, nodes, edges, square(nodes, edges.estimate))


def square(nodes: StationNodes, values: Callable[[np.ndarray], Array]) -> Array:
    """(V, V) symmetric table of a function of pairs; inf within a stud."""
    pairs = nodes.usable_pairs()
    table = np.full((nodes.num_nodes, nodes.num_nodes), np.inf)
    table[pairs[:, 0], pairs[:, 1]] = table[pairs[:, 1], pairs[:, 0]] = values(pairs)
    return table


def priced_nodes(nodes: StationNodes, station: Station) -> StationNodes:
    """The same nodes with the weld costs of another robot or other weights."""
    times = {stud.id: stud.weld_time_s for stud in station.studs}
    held = np.array([0.0 if v == nodes.home else times[stud] for v, stud in enumerate(nodes.stud)])
    rate = station.cost.holding_rate(station.robot.gravity_torque_nm(nodes.q_rad))
    return replace(nodes, weld_cost=held * rate)


def scaled_masses(robot: Robot, factor: float) -> Robot:
    """Links and tool `factor` times as heavy, inertia included."""
    tool = replace(
        robot.tool,
        mass_kg=factor * robot.tool.mass_kg,
        inertia_kg_m2=factor * robot.tool.inertia_kg_m2,
    )
    return robot.with_tool(tool).with_mass_scale(factor * robot.mass_scale)
