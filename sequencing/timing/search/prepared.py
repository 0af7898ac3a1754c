"""Everything about a cell that no timing changes: power tables, swept paths, pair maps."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from planning.collision.kernels.layout import Solids
from planning.collision.packed import pack_solids
from sequencing.timing.cell.types import Cell
from sequencing.timing.clearance.arms import ArmShapes, arm_shapes, joint_frames
from sequencing.timing.clearance.coordination import (
    CELLS,
    CoordinationMap,
    ExactPair,
    coordination_map,
    solid_poses,
)
from sequencing.timing.clearance.crossing import Crossings, PairMaps
from sequencing.timing.clearance.swept import SweptPath, swept_path
from sequencing.timing.power.along_path import (
    PathPower,
    PowerTable,
    drive_of,
    exact_table,
    path_power,
    power_table,
)
from sequencing.timing.power.dc_link import simulate_hysteresis
from sequencing.timing.power.timeline import CellTimeline, drawn_j, make_timeline


@dataclass(frozen=True, eq=False)
class PreparedCell:
    """A cell with the torque terms and power tables of its S trajectories, in number order."""

    cell: Cell
    paths: tuple[PathPower, ...]
    tables: tuple[PowerTable, ...]

    def timeline(
        self,
        total_s: float,
        tables: Sequence[PowerTable] | None = None,
        step_s: float = 0.004,
    ) -> CellTimeline:
        """All trajectories of all robots over `total_s`, with other `tables` (S,) if given."""
        used = self.tables if tables is None else tables
        groups = [used[a:b] for a, b in itertools.pairwise(self.cell.first)]
        return make_timeline(groups, total_s, self.cell.links, self.cell.link_of, step_s)

    def window(
        self,
        numbers: Sequence[int],
        total_s: float,
        step_s: float = 0.004,
        standing: Sequence[tuple[int, bool]] = (),
    ) -> CellTimeline:
        """One trajectory for each robot, by number, then the robots that stand through it.

        `standing` has (trajectory, True at its end or False at its start) of each such robot; it
        counts as a trajectory as long as the window, at full speed, that draws its holding power.
        """
        tables = [[self.tables[k]] for k in numbers]
        for k, ended in standing:
            power = self.tables[k].hold_end_w if ended else self.tables[k].hold_start_w
            tables.append([_standing_table(power, total_s)])
        owners = [self.cell.owner(k)[0] for k in (*numbers, *(k for k, _ in standing))]
        link_of = [self.cell.link_of[r] for r in owners]
        return make_timeline(tables, total_s, self.cell.links, link_of, step_s)

    def evaluate(
        self, start_s: np.ndarray, override: np.ndarray, total_s: float, step_s: float = 0.001
    ) -> Evaluation:
        """Energy with the per-joint model at fine steps and the chopper's hysteresis.

        Each robot runs its trajectories by their starts, whatever their numbers.
        """
        start_s, override, exact = self.exact_tables(start_s, override)
        line = self.timeline(total_s, exact, step_s)
        drawn = drawn_j(line, start_s, override)
        runs = [
            simulate_hysteresis(drawn[m], line.step_s, link)
            for m, link in enumerate(self.cell.links)
        ]
        link_j = float(sum(run.energy_j for run in runs))
        grid_w = np.sum(
            [run.grid_j * link.grid_factor for run, link in zip(runs, self.cell.links)], axis=0
        )
        return Evaluation(
            link_j,
            link_j + self.base_load_w * total_s,
            grid_w / line.step_s,
            float(sum(run.chopper_j.sum() for run in runs)),
            line.step_s,
        )

    @property
    def base_load_w(self) -> float:
        """Constant consumption on the grid side: the cell's own and the robots' cabinets."""
        return self.cell.base_load_w + sum(drive_of(r.robot).base_power_w for r in self.cell.robots)

    def exact_tables(
        self, start_s: np.ndarray, override: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[PowerTable]]:
        """Starts, overrides and exact tables (S,), each robot's in the order of starts."""
        start, first = np.asarray(start_s, dtype=float), self.cell.first
        spans = itertools.pairwise(first)
        order = np.concatenate([a + np.argsort(start[a:b], kind="stable") for a, b in spans])
        speed = np.asarray(override, dtype=float)[order]
        tables = [exact_table(self.paths[k], float(d)) for k, d in zip(order, speed)]
        return start[order], speed, tables


@dataclass(frozen=True, eq=False)
class Evaluation:
    """`link_j`: grid energy for the DC links [J]; `total_j`: constant consumers included.

    `grid_w` (K,) is the power that the links draw from the grid in steps of `step_s`, `chopper_j`
    what the choppers burn.
    """

    link_j: float
    total_j: float
    grid_w: np.ndarray
    chopper_j: float
    step_s: float


def _standing_table(power_w: float, length_s: float) -> PowerTable:
    coefficients = np.zeros((5, 3))
    coefficients[0] = power_w * np.linspace(0.0, length_s, 3)
    return PowerTable(length_s, 0.5 * length_s, coefficients, power_w, power_w)


def prepare_cell(cell: Cell) -> PreparedCell:
    """Inverse dynamics once along every path of the cell."""
    paths = tuple(
        path_power(loaded, trajectory, 0.004, wrench)
        for robot in cell.robots
        for loaded, trajectory, wrench in zip(robot.loaded, robot.trajectories, robot.wrench)
    )
    return PreparedCell(cell, paths, tuple(power_table(path) for path in paths))


class Geometry:
    """Swept paths and coordination maps of a cell, made when first asked for."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.shapes: list[ArmShapes] = [arm_shapes(r.robot, r.tool_bodies) for r in cell.robots]
        self._swept: dict[int, SweptPath] = {}
        self._poses: dict[int, np.ndarray] = {}
        self._solids: dict[tuple[int, int], Solids] = {}
        self._maps: dict[tuple[int, int], CoordinationMap] = {}
        self._sharp: set[tuple[int, int]] = set()

    def swept(self, number: int) -> SweptPath:
        """The path of a trajectory, in 2 `CELLS` pieces."""
        if number not in self._swept:
            r, k = self.cell.owner(number)
            item = self.cell.robots[r]
            self._swept[number] = swept_path(
                item.robot, self.shapes[r], item.trajectories[k], 2 * CELLS
            )
        return self._swept[number]

    def map(self, a: int, b: int) -> CoordinationMap:
        """The map of trajectories a and b (by number, of two robots, a < b).

        Made with capsules; `sharpen` replaces it by the one of the exact solids.
        """
        if (a, b) not in self._maps:
            self._maps[a, b] = coordination_map(self.swept(a), self.swept(b), self.cell.clearance_m)
        return self._maps[a, b]

    def sharpen(self, pairs: Iterable[tuple[int, int]]) -> bool:
        """Remake these maps with the exact solids; True if any map was not exact before."""
        changed = False
        for a, b in pairs:
            if (a, b) in self._sharp or self.map(a, b).all_free:
                continue
            self._sharp.add((a, b))
            changed = True
            self._maps[a, b] = coordination_map(
                self.swept(a), self.swept(b), self.cell.clearance_m, self._exact(a, b)
            )
        return changed

    def crossings(self, total_s: float) -> Crossings:
        """Check of whole schedules, all trajectories of all robots."""
        first = self.cell.first
        spans = list(itertools.pairwise(first))
        pairs = [
            PairMaps(spans[i], spans[j], self.map)
            for i in range(len(spans))
            for j in range(i + 1, len(spans))
        ]
        durations = np.array([t for row in self.cell.durations_s for t in row])
        return Crossings(pairs, durations, total_s)

    def window(
        self, numbers: Sequence[int], total_s: float, standing: Sequence[tuple[int, bool]] = ()
    ) -> Crossings:
        """Check of one window: one trajectory for each robot, by number.

        `standing` as in `PreparedCell.window`; those robots are met at where they stand.
        """
        every = [*numbers, *(k for k, _ in standing)]

        def build(i: int, j: int) -> CoordinationMap:
            # A map belongs to two robots in the order of the cell.
            if every[i] < every[j]:
                return self.map(every[i], every[j])
            return self.map(every[j], every[i]).turned()

        size, moving = len(every), len(numbers)
        pairs = [
            PairMaps((i, i + 1), (j, j + 1), build)
            for i in range(moving)
            for j in range(i + 1, size)
        ]
        flat = np.array([t for row in self.cell.durations_s for t in row])[every]
        held = {
            moving + m: (-2.0 * flat[moving + m] if ended else 2.0 * total_s)
            for m, (_, ended) in enumerate(standing)
        }
        return Crossings(pairs, flat, total_s, held)

    def _exact(self, a: int, b: int) -> ExactPair:
        key = self.cell.owner(a)[0], self.cell.owner(b)[0]
        if key not in self._solids:
            first, second = (self.shapes[r].pieces for r in key)
            self._solids[key] = pack_solids([*first, *second])
        return ExactPair(self._solids[key], self._posed(a), self._posed(b))

    def _posed(self, number: int) -> np.ndarray:
        if number not in self._poses:
            r, k = self.cell.owner(number)
            item = self.cell.robots[r]
            bare = item.trajectories[k].on(None)
            t = np.linspace(0.0, bare.duration_s, 2 * CELLS + 1) + bare.t_s[0]
            frames = joint_frames(item.robot, bare.sample(t).q_rad)
            self._poses[number] = solid_poses(self.shapes[r], *frames)
        return self._poses[number]
