"""`schedule(cell)`: time a cell to save energy without collisions, beside its baselines."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.status import Status
from sequencing.timing.cell import Cell, load_cell
from sequencing.timing.optimise import DEFAULT_SEARCH, SearchParams
from sequencing.timing.path_power import drive_of
from sequencing.timing.prepared import Geometry, PreparedCell, prepare_cell
from sequencing.timing.separate import separated_timing
from sequencing.timing.strategies import (
    Timing,
    Windows,
    fast_timing,
    general_timing,
    make_windows,
    stretched_timing,
    window_timing,
)
from sequencing.timing.verify import check_schedule

__all__ = ["Case", "Schedule", "run_schedule", "schedule"]


@dataclass(frozen=True, eq=False)
class Case:
    """One way of timing the cell, evaluated with the per-joint model and the chopper's hysteresis.

    `energy_j` is grid energy for the links, `total_j` with constant consumers; `collisions` counts
    the separate stretches of time in which two robots overlap or cannot be proven apart (exact
    solids, continuous time); `saving_percent` is relative to as-fast-as-possible.
    """

    name: str
    timing: Timing
    energy_j: float
    total_j: float
    saving_percent: float
    collisions: int
    contacts: tuple[str, ...]
    chopper_j: float
    cpu_s: float


@dataclass(frozen=True, eq=False)
class Schedule:
    """Start and length [s] of every trajectory (S,), grid power (K,) [W], energy [J] and status.

    `cases` holds the baselines and the answers of each strategy; the schedule itself is the best
    of those without collision. `status` is converged, or in_collision if no strategy found one.
    """

    cell: Cell
    start_s: np.ndarray
    override: np.ndarray
    duration_s: np.ndarray
    power_w: np.ndarray
    power_step_s: float
    energy_j: float
    status: Status
    best: str
    cases: tuple[Case, ...]
    preparation_cpu_s: float
    windows: Windows | None


def schedule(
    cell: Cell,
    seed: int = 0,
    params: SearchParams = DEFAULT_SEARCH,
    progress: Callable[[str], None] | None = None,
) -> Schedule:
    """Time `cell`: baselines, window by window, all at once; every answer is checked afresh.

    Cases: `as-fast-as-possible`, `stretched`, `windows-no-collision`, `windows`,
    `general-no-collision`, `general` (the window cases only where windows fit). Where the fast
    baseline itself collides, robots first wait for each other (`separated`).
    """
    say = progress or (lambda _: None)
    begin = time.process_time()
    prepared = prepare_cell(cell)
    geometry = Geometry(cell)
    windows = make_windows(prepared)
    preparation = time.process_time() - begin
    cases: list[Case] = []

    def add(name: str, make: Callable[[], Timing]) -> Timing:
        say(name)
        start = time.process_time()
        timing = make()
        spent = time.process_time() - start
        cases.append(_case(prepared, name, timing, cases[0].energy_j if cases else None, spent))
        return timing

    fast = add("as-fast-as-possible", lambda: fast_timing(prepared, windows))
    safe, safe_case = fast, cases[0]
    if cases[0].collisions:
        safe = add("separated", lambda: separated_timing(prepared, geometry, fast))
        safe_case = cases[-1]
    total = safe.total_s
    stretched = add("stretched", lambda: stretched_timing(prepared, windows, total))
    if windows is not None:
        loose = add(
            "windows-no-collision", lambda: window_timing(prepared, windows, seed, None, params)
        )
        tight = add("windows", lambda: window_timing(prepared, windows, seed, geometry, params))
        if cases[-1].collisions == 0:
            safe, safe_case = tight, cases[-1]
    else:
        loose = safe
    others = [stretched] if windows is None else [stretched, fast]
    relaxed = add(
        "general-no-collision", lambda: general_timing(prepared, loose, seed, None, others)
    )
    if safe_case.collisions == 0:
        others.append(relaxed)
        add("general", lambda: general_timing(prepared, safe, seed, geometry, others))
    allowed = [case for case in cases if case.collisions == 0]
    best = min(allowed or [safe_case], key=lambda case: case.energy_j)
    result = prepared.evaluate(best.timing.start_s, best.timing.override, best.timing.total_s)
    flat = np.array([t for row in cell.durations_s for t in row])
    return Schedule(
        cell, best.timing.start_s, best.timing.override, flat / best.timing.override,
        result.grid_w, result.step_s, best.energy_j,
        Status.CONVERGED if allowed else Status.IN_COLLISION, best.name, tuple(cases),
        preparation, windows,
    )  # fmt: skip


def _case(
    prepared: PreparedCell, name: str, timing: Timing, base_j: float | None, cpu_s: float
) -> Case:
    result = prepared.evaluate(timing.start_s, timing.override, timing.total_s)
    contacts = check_schedule(prepared.cell, timing.start_s, timing.override)
    # Neighbouring reports of one pair of robots are one collision.
    count = 0
    last: dict[tuple[str, str], float] = {}
    for contact in contacts:
        pair = (contact.first, contact.second)
        if contact.time_s - last.get(pair, -1.0) > 0.06:
            count += 1
        last[pair] = contact.time_s
    base = result.link_j if base_j is None else base_j
    words = tuple(
        f"{c.time_s:.3f} s: {c.first} {c.solids[0]} and {c.second} {c.solids[1]}" for c in contacts
    )
    return Case(
        name, timing, result.link_j, result.total_j, 100.0 * (1.0 - result.link_j / base), count,
        words[:20], result.chopper_j, cpu_s,
    )  # fmt: skip


def run_schedule(
    cell_path: str | Path,
    seed: int = 0,
    params: SearchParams = DEFAULT_SEARCH,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """The `--json` object of `dmoc schedule`: cases, starts and overrides of the best one."""
    return schedule_to_dict(schedule(load_cell(cell_path), seed, params, progress))


def schedule_to_dict(found: Schedule) -> dict[str, Any]:
    """Plain data of a schedule; `cpu_s` is the only entry that differs between equal runs."""
    fast = found.cases[0]
    stretched = next(case for case in found.cases if case.name == "stretched")
    names = [robot.name for robot in found.cell.robots]
    first = found.cell.first
    spans = {name: slice(first[r], first[r + 1]) for r, name in enumerate(names)}
    drives = {r.name: dict(drive_of(r.robot).provenance) for r in found.cell.robots}
    return {
        "cell": found.cell.name,
        "status": str(found.status),
        "advice": found.status.advice,
        "best": found.best,
        "energy_j": found.energy_j,
        "cases": [
            {
                "name": case.name,
                "energy_j": case.energy_j,
                "total_energy_j": case.total_j,
                "saving_percent": case.saving_percent,
                "saving_of_stretched_percent": 100.0 * (1 - case.energy_j / stretched.energy_j),
                "duration_s": case.timing.total_s,
                "process_time_unchanged": bool(
                    abs(case.timing.total_s - fast.timing.total_s) < 1e-9
                ),
                "collisions": case.collisions,
                "contacts": list(case.contacts),
                "chopper_j": case.chopper_j,
                "evaluations": case.timing.evaluations,
                "cpu_s": case.cpu_s,
            }
            for case in found.cases
        ],
        "start_s": {name: found.start_s[span].tolist() for name, span in spans.items()},
        "override": {name: found.override[span].tolist() for name, span in spans.items()},
        "length_s": {name: found.duration_s[span].tolist() for name, span in spans.items()},
        "preparation_cpu_s": found.preparation_cpu_s,
        "provenance": {
            "drive": drives,
            "robot": {r.name: dict(r.robot.provenance) for r in found.cell.robots},
            "link": "assumed, except voltages of published order",
        },
    }
