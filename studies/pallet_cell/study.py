"""The pallet-cell study: the paper's Table 2 and Figs. 4 to 6 on our own cell, as plain data."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import planning
from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.robot.robot import load_robot
from sequencing.timing.cell.read import Cell, CellRobot, load_cell
from sequencing.timing.clearance.verify import check_schedule
from sequencing.timing.power.dc_link import LinkParams
from sequencing.timing.power.timeline import cost_batch, drawn_j, make_timeline
from sequencing.timing.scheduling import schedule, schedule_to_dict
from sequencing.timing.search.jobs import rearranged
from sequencing.timing.search.levels import first_level
from sequencing.timing.search.optimise import DEFAULT_SEARCH
from sequencing.timing.search.prepared import Geometry, PreparedCell, prepare_cell
from sequencing.timing.search.slack import decode_batch, slack_graph
from sequencing.timing.search.windows import (
    Timing,
    fast_timing,
    general_timing,
    make_windows,
    stretched_timing,
    window_timing,
)

_FREE_ORDER = 10  # trajectories of each robot, so that all orders can be enumerated


def pallet_cell() -> Cell:
    """The authored cell of three robots around one pallet, 39 trajectories each."""
    return load_cell(Path(planning.__file__).parent / "stations" / "pallet_cell")


def crossing_cell() -> Cell:
    """Two arms face to face, as in the paper's Fig. 4: a quick one swings through a slow one's way.

    It may pass before the slow (critical) arm comes or after it has gone: a collision divides the
    solution space of its compression and delay.
    """
    robots = []
    for name, x, angle, swing, scale in (
        ("quick", 0.0, 0.0, 1.3, 1.0),
        ("slow", 2.2, np.pi, -1.3, 0.15),
    ):
        place = pin.SE3(pin.utils.rotate("z", angle), np.array([x, 0.0, 0.0]))
        arm = load_robot("ur10e_class").with_base(place)
        begin = np.array([np.pi - swing, -0.25, 0.0, 0.0, 0.0, 0.0])
        end = begin + np.array([2.0 * swing, 0.0, 0.0, 0.0, 0.0, 0.0])
        motion = trapezoid_motion(arm, begin, end, scale=scale)
        robots.append(CellRobot(name, arm, (), (motion,), (arm,), ("swing",), (0.0,)))
    link = LinkParams(capacitance_f=1e-3)
    return Cell("crossing", tuple(robots), (), (), (link,), (0, 0), 0.0, 0.02)


def run_pallet_cell_study(
    seed: int = 0,
    trajectories: int | None = None,
    capacities_f: Sequence[float] = (1e-3, 3e-3, 6e-3, 12e-3, 30e-3, 100e-3),
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """The `--json` object of `dmoc study pallet-cell`.

    `cases` as in `run_schedule`; `paper` the published numbers beside them; `traces` grid and robot
    powers of one window as in Fig. 5; `capacity` the sweep that tells when matching braking to
    acceleration pays; `free_order` what the first level would save on the first ten trajectories of
    each robot if their turns stayed and the order of their boxes were free. `trajectories` keeps
    only that many of each robot (reduced mode).
    """
    cell = (
        pallet_cell() if trajectories is None else first_trajectories(pallet_cell(), trajectories)
    )
    found = schedule(cell, seed, DEFAULT_SEARCH, progress)
    data = schedule_to_dict(found)
    data["paper"] = {
        "source": "DTO paper, Table 2: three smaller arms, 39 trajectories each, 45.585 s",
        "cases": [
            {"name": "as-fast-as-possible", "energy_j": 60018.0, "saving_percent": 0.0},
            {"name": "windows-no-collision", "energy_j": 54461.0, "saving_percent": 9.26},
            {"name": "windows", "energy_j": 54538.0, "saving_percent": 9.13},
        ],
    }
    if progress is not None:
        progress("capacity sweep")
    data["capacity"] = capacity_sweep(cell, seed, capacities_f)
    if progress is not None:
        progress("free order")
    few = min(_FREE_ORDER, max(len(robot.trajectories) for robot in cell.robots))
    part = first_trajectories(cell, few)
    data["free_order"] = {"trajectories": few, **free_order(part, seed)}
    return data


def free_order(cell: Cell, seed: int) -> dict[str, Any]:
    """The first level on `cell` if each robot could run its jobs in any order.

    Turns stay: a hand-over from a robot's k-th trajectory is one from whatever it runs k-th. The
    process time stays. Energies are of the windows, timed with collisions, and of the general
    problem from there, beside those windows in the given order.
    """
    robots = tuple(replace(item, free_order=True) for item in cell.robots)
    prepared = prepare_cell(replace(cell, robots=robots, handovers=()))
    given = make_windows(prepare_cell(cell))
    if given is None:
        return {"method": "none"}
    total = float(given.edges_s[-1])
    geometry = Geometry(prepared.cell)
    before = window_timing(prepared, given, seed, geometry)
    rows: dict[str, Any] = {"given_windows_j": _energy_j(prepared, before)}
    level = first_level(prepared, total, seed, geometry)
    if level is None or not level.changed:
        return {**rows, "method": "none" if level is None else level.method, "changed": False}
    turned = rearranged(prepared, level.order)
    turned = replace(turned, cell=replace(turned.cell, handovers=cell.handovers))
    windows = make_windows(turned, None, total)
    if windows is None or float(windows.edges_s[-1]) > total * (1.0 + 1e-9):
        return {**rows, "method": level.method, "changed": False}
    its = Geometry(turned.cell)
    after = window_timing(turned, windows, seed, its)
    rows["windows_j"] = _energy_j(turned, after)
    rows["windows_collisions"] = len(check_schedule(turned.cell, after.start_s, after.override))
    if rows["windows_collisions"] == 0:
        whole = general_timing(turned, after, seed, its)
        rows["general_j"] = _energy_j(turned, whole)
        rows["general_collisions"] = len(check_schedule(turned.cell, whole.start_s, whole.override))
    return {
        **rows,
        "method": level.method,
        "changed": True,
        "orders": level.orders,
        "windows_valued": level.valued,
        "estimate_j": level.estimate_j,
        "sequence": {item.name: list(own) for item, own in zip(cell.robots, level.order)},
    }


def _energy_j(prepared: PreparedCell, timing: Timing) -> float:
    return prepared.evaluate(timing.start_s, timing.override, timing.total_s).link_j


def first_trajectories(cell: Cell, count: int) -> Cell:
    """The cell with the first `count` trajectories of each robot, hand-overs among them kept."""
    robots = tuple(
        replace(
            item,
            trajectories=item.trajectories[:count],
            loaded=item.loaded[:count],
            labels=item.labels[:count],
            pause_s=item.pause_s[:count],
            wrench=item.wrench[:count],
        )
        for item in cell.robots
    )
    kept = replace(cell, robots=robots, handovers=())
    renumber = []
    for a, b in cell.handovers:
        (ra, ka), (rb, kb) = cell.owner(a), cell.owner(b)
        if ka < count and kb < count:
            renumber.append((kept.first[ra] + ka, kept.first[rb] + kb))
    return replace(kept, handovers=tuple(renumber))


def capacity_sweep(cell: Cell, seed: int, capacities_f: Sequence[float]) -> list[dict[str, float]]:
    """Energy of fast, stretched and window-optimised timing against the link's capacitance.

    `saving_percent` counts from free-running full speed, `fast_j` is that of the windows.
    `matching_percent` is what the optimiser saves beyond stretching: the worth of making braking
    meet acceleration. Collisions are left out (it is about the link).
    """
    rows = []
    prepared = prepare_cell(cell)
    windows = make_windows(prepared)
    for capacitance in capacities_f:
        links = tuple(replace(link, capacitance_f=capacitance) for link in cell.links)
        changed = PreparedCell(replace(cell, links=links), prepared.paths, prepared.tables)
        fast = fast_timing(changed, windows)
        free = fast_timing(changed, None, fast.total_s)
        stretched = stretched_timing(changed, windows, fast.total_s)
        timings = {"free_running_j": free, "fast_j": fast, "stretched_j": stretched}
        if windows is not None:
            timings["optimised_j"] = window_timing(changed, windows, seed, None)
        row = {
            name: changed.evaluate(t.start_s, t.override, t.total_s).link_j
            for name, t in timings.items()
        }
        best = row.get("optimised_j", row["stretched_j"])
        row["capacitance_f"] = float(capacitance)
        row["saving_percent"] = 100.0 * (1.0 - best / row["free_running_j"])
        row["matching_percent"] = 100.0 * (1.0 - best / row["stretched_j"])
        rows.append(row)
    return rows


def solution_space(
    cell: Cell, window: int, robot: int, points: int = 61
) -> dict[str, np.ndarray | float]:
    """The paper's Fig. 4: energy over (compression x, delay y) of one robot, NaN where it collides.

    The other robots of the window run at full speed from its start. `override` (points,) and
    `delay_s` follow from x and y; `energy_j` is (points, points), rows x.
    """
    prepared = prepare_cell(cell)
    windows = make_windows(prepared)
    if windows is None:
        raise ValueError("the cell has no windows")
    numbers = list(windows.numbers[window])
    length = float(windows.edges_s[window + 1] - windows.edges_s[window])
    flat = np.array([t for row in cell.durations_s for t in row])[numbers]
    graph = slack_graph([[t] for t in flat], (), length)
    axis = np.linspace(0.0, 1.0, points)
    z = np.zeros((points * points, 2, len(numbers)))
    z[:, 0, robot] = np.repeat(axis, points)
    z[:, 1, robot] = np.tile(axis, points)
    timing = decode_batch(graph, z)
    geometry = Geometry(cell)
    geometry.sharpen([(a, b) for k, a in enumerate(numbers) for b in numbers[k + 1 :]])
    free = geometry.window(numbers, length).free(timing)
    energy = cost_batch(prepared.window(numbers, length), timing[:, 0], timing[:, 1])
    shape = (points, points)
    return {
        "energy_j": np.where(free, energy, np.nan).reshape(shape),
        "override": timing[:, 1, robot].reshape(shape),
        "delay_s": timing[:, 0, robot].reshape(shape),
        "blocked_share": float(1.0 - free.mean()),
    }


def _robot_power_w(
    prepared: PreparedCell, start_s: np.ndarray, override: np.ndarray, total_s: float
) -> np.ndarray:
    """Power of each robot on its link (R, K) [W]."""
    start, speed, exact = prepared.exact_tables(start_s, override)
    cell = prepared.cell
    tables = [exact[a:b] for a, b in itertools.pairwise(cell.first)]
    links = [cell.links[m] for m in cell.link_of]
    line = make_timeline(tables, total_s, links, range(len(tables)))
    return drawn_j(line, start, speed) / line.step_s


def traces(
    prepared: PreparedCell, start_s: np.ndarray, override: np.ndarray, total_s: float
) -> dict[str, np.ndarray]:
    """Fig. 5: time (K,), grid power (K,), power of each robot (R, K) [W], relative speeds (R, K).

    The relative speed is the sum of absolute joint speeds over the largest value that the slowest
    robot (the one with the longest trajectory) reaches.
    """
    result = prepared.evaluate(start_s, override, total_s, 0.004)
    power = _robot_power_w(prepared, start_s, override, total_s)
    cell = prepared.cell
    steps = power.shape[1]
    t = (np.arange(steps) + 0.5) * total_s / steps
    speed = np.zeros((len(cell.robots), steps))
    for number, path in enumerate(prepared.paths):
        r, _ = cell.owner(number)
        s = (t - start_s[number]) * override[number]
        inside = (s > 0) & (s < path.duration_s)
        total = np.abs(path.velocity_rad_s).sum(axis=1)
        speed[r, inside] = override[number] * np.interp(s[inside], path.middle_s, total)
    slowest = int(np.argmax([max(t.duration_s for t in r.trajectories) for r in cell.robots]))
    return {
        "t_s": t,
        "grid_w": result.grid_w,
        "robot_w": power,
        "relative_speed": speed / max(float(speed[slowest].max()), 1e-9),
    }
