"""`schedule(cell)`: time a cell to save energy without collisions, beside its baselines."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.motion.status import Status
from sequencing.timing.cell.read import load_cell
from sequencing.timing.cell.types import Cell
from sequencing.timing.clearance.verify import (
    Contact,
    check_fixtures,
    check_obstacles,
    check_schedule,
)
from sequencing.timing.power.along_path import drive_of, path_torque_nm
from sequencing.timing.search.jobs import in_given_numbers, in_order, rearranged
from sequencing.timing.search.levels import FirstLevel, first_level
from sequencing.timing.search.optimise import DEFAULT_SEARCH, SearchParams
from sequencing.timing.search.prepared import Geometry, PreparedCell, prepare_cell
from sequencing.timing.search.windows import (
    Timing,
    Windows,
    fast_timing,
    general_timing,
    make_windows,
    separated_timing,
    stretched_timing,
    window_timing,
)


@dataclass(frozen=True, eq=False)
class Case:
    """One way of timing the cell, evaluated with the per-joint model and the chopper's hysteresis.

    `energy_j` is grid energy for the links, `total_j` with constant consumers; `collisions` counts
    the separate stretches of time in which two robots overlap or cannot be proven apart (exact
    solids, continuous time). Savings are relative to the schedule's baseline: of `total_j`, and of
    `energy_j` alone.
    """

    name: str
    timing: Timing
    energy_j: float
    total_j: float
    saving_with_base_percent: float
    saving_percent: float
    collisions: int
    contacts: tuple[str, ...]
    chopper_j: float
    cpu_s: float


@dataclass(frozen=True, eq=False)
class Schedule:
    """Start and length [s] of every trajectory (S,), grid power (K,) [W], energy [J] and status.

    `cases` holds the baselines and the answers of each strategy; the schedule itself is the best
    of those without collision. `status` is converged, or in_collision if no strategy found one or
    if a path meets the part or fixtures of another robot's station (`fixture_contacts`), which no
    timing mends. `order` is what the first level chose, None where windows cannot be used.
    `torque_share` (R, 2) is each robot's largest joint torque over its limit, at full speed and as
    scheduled, with payloads and wrenches. Savings count from the case `baseline`: the first at full
    speed without collision of `free-running`, `as-fast-as-possible` and `separated`.
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
    baseline: str
    cases: tuple[Case, ...]
    preparation_cpu_s: float
    windows: Windows | None
    order: FirstLevel | None
    fixture_contacts: tuple[Contact, ...]
    obstacle_contacts: tuple[Contact, ...]
    torque_share: np.ndarray


def schedule(
    cell: Cell,
    seed: int = 0,
    params: SearchParams = DEFAULT_SEARCH,
    progress: Callable[[str], None] | None = None,
) -> Schedule:
    """Time `cell`: baselines, window by window, all at once; every answer is checked afresh.

    Cases: `as-fast-as-possible`, `stretched`, `windows-no-collision`, `windows`,
    `general-no-collision`, `general` (the window cases only where windows fit; there
    as-fast-as-possible stops all robots at the end of each window, and `free-running` and
    `free-running-stretched` are the same two without that stop, with the same end of the process).
    Where as-fast-as-possible itself collides, robots first wait for each other (`separated`). Where
    the first level finds other windows, or another order of the jobs, that promise less energy in
    the same time: `order` (those windows, timed with collisions) and `order-general` (all at once
    from there).
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
        cases.append(_case(prepared, name, timing, spent))
        return timing

    if windows is not None:
        end = float(windows.edges_s[-1])
        add("free-running", lambda: fast_timing(prepared, None, end))
        add("free-running-stretched", lambda: stretched_timing(prepared, None, end))
    fast = add("as-fast-as-possible", lambda: fast_timing(prepared, windows))
    safe, safe_case = fast, cases[-1]
    if safe_case.collisions:
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
    say("order")
    begin = time.process_time()
    level = first_level(prepared, fast.total_s, seed, geometry, params)
    spent = time.process_time() - begin
    ordered, ordered_case = None, cases[-1]
    if level is not None and level.changed:
        ordered = add(
            "order", lambda: window_timing(prepared, level.windows, seed, geometry, params)
        )
        ordered_case = cases[-1] = replace(cases[-1], cpu_s=cases[-1].cpu_s + spent)
    others = [stretched] if windows is None else [stretched, fast]
    relaxed = add(
        "general-no-collision", lambda: general_timing(prepared, loose, seed, None, others)
    )
    if safe_case.collisions == 0:
        others.append(relaxed)
        add("general", lambda: general_timing(prepared, safe, seed, geometry, others))
    if level is not None and ordered is not None and ordered_case.collisions == 0:
        add("order-general", lambda: _general_in_order(prepared, level, ordered, seed))
    baseline = _baseline(cases)
    cases = [_with_savings(case, baseline) for case in cases]
    allowed = [case for case in cases if case.collisions == 0]
    # Among equals one that was made with the collision check.
    best = min(
        allowed or [safe_case],
        key=lambda case: case.energy_j * (1.0 + 1e-9 * case.name.endswith("no-collision")),
    )
    fixtures, obstacles = check_fixtures(cell), check_obstacles(cell)
    result = prepared.evaluate(best.timing.start_s, best.timing.override, best.timing.total_s)
    flat = np.array([t for row in cell.durations_s for t in row])
    return Schedule(
        cell,
        best.timing.start_s,
        best.timing.override,
        flat / best.timing.override,
        result.grid_w,
        result.step_s,
        best.energy_j,
        Status.CONVERGED if allowed and not fixtures else Status.IN_COLLISION,
        best.name,
        baseline.name,
        tuple(cases),
        preparation,
        windows,
        level,
        tuple(fixtures),
        tuple(obstacles),
        _torque_share(prepared, best.timing.override),
    )


def _torque_share(prepared: PreparedCell, override: np.ndarray) -> np.ndarray:
    """(R, 2), see `Schedule`."""
    cell = prepared.cell
    out = np.zeros((len(cell.robots), 2))
    for k, path in enumerate(prepared.paths):
        r, _ = cell.owner(k)
        limit = np.asarray(cell.robots[r].robot.torque_limit_nm)
        for m, rate in enumerate((1.0, float(override[k]))):
            out[r, m] = max(out[r, m], float((np.abs(path_torque_nm(path, rate)) / limit).max()))
    return out


def _general_in_order(
    prepared: PreparedCell, level: FirstLevel, start: Timing, seed: int
) -> Timing:
    """The general problem with the first level's order of jobs, from its windows' timing."""
    numbers = in_order(prepared.cell, level.order)
    arranged = rearranged(prepared, level.order)
    begin = replace(start, start_s=start.start_s[numbers], override=start.override[numbers])
    found = general_timing(arranged, begin, seed, Geometry(arranged.cell))
    return in_given_numbers(found, numbers)


def _baseline(cases: list[Case]) -> Case:
    """What robots at full speed cost, see `Schedule`."""
    names = ("free-running", "as-fast-as-possible", "separated")
    full_speed = [case for name in names for case in cases if case.name == name]
    return next((case for case in full_speed if case.collisions == 0), full_speed[0])


def _with_savings(case: Case, baseline: Case) -> Case:
    return replace(
        case,
        saving_with_base_percent=100.0 * (1.0 - case.total_j / baseline.total_j),
        saving_percent=100.0 * (1.0 - case.energy_j / baseline.energy_j),
    )


def _case(prepared: PreparedCell, name: str, timing: Timing, cpu_s: float) -> Case:
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
    return Case(
        name,
        timing,
        result.link_j,
        result.total_j,
        0.0,
        0.0,
        count,
        tuple(map(str, contacts[:20])),
        result.chopper_j,
        cpu_s,
    )


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
    fast = next(case for case in found.cases if case.name == "as-fast-as-possible")
    stretched = next(case for case in found.cases if case.name == "stretched")
    names = [robot.name for robot in found.cell.robots]
    first = found.cell.first
    spans = {name: slice(first[r], first[r + 1]) for r, name in enumerate(names)}
    drives = {r.name: dict(drive_of(r.robot).provenance) for r in found.cell.robots}
    return {
        "cell": found.cell.name,
        "status": str(found.status),
        "advice": _advice(found),
        "best": found.best,
        "baseline": found.baseline,
        "energy_j": found.energy_j,
        "cases": [
            {
                "name": case.name,
                "energy_j": case.energy_j,
                "total_energy_j": case.total_j,
                "saving_with_base_percent": case.saving_with_base_percent,
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
        "order": _order_to_dict(found),
        "torque_share": {
            name: {"full_speed": float(row[0]), "scheduled": float(row[1])}
            for name, row in zip(names, found.torque_share)
        },
        "fixture_contacts": [str(contact) for contact in found.fixture_contacts[:20]],
        "obstacle_contacts": [str(contact) for contact in found.obstacle_contacts[:20]],
        "preparation_cpu_s": found.preparation_cpu_s,
        "provenance": {
            "drive": drives,
            "robot": {r.name: dict(r.robot.provenance) for r in found.cell.robots},
            "link": "assumed, except voltages of published order",
        },
    }


def _advice(found: Schedule) -> str:
    """What to do with the answer."""
    if found.fixture_contacts:
        return (
            "A path meets the part or fixtures of another station (fixture_contacts); no timing "
            "mends that: move the stations apart, or plan again."
        )
    if found.status is Status.IN_COLLISION:
        return (
            "Every timing collides (contacts name who and when): give the robots other paths, "
            "hand-overs or places."
        )
    return "A local optimum, free of collisions in continuous time; use it."


def _order_to_dict(found: Schedule) -> dict[str, Any]:
    """What the first level chose; `sequence` is the order of the best case, by given numbers."""
    first = found.cell.first
    spans = {robot.name: slice(first[r], first[r + 1]) for r, robot in enumerate(found.cell.robots)}
    sequence = {
        name: np.argsort(found.start_s[span], kind="stable").tolist()
        for name, span in spans.items()
    }
    level = found.order
    if level is None:
        return {
            "method": "none",
            "reason": "no windows fit (standstill, time or collisions)",
            "sequence": sequence,
        }
    names = [f"{robot.name}/{k}" for robot in found.cell.robots for k in range(len(robot.labels))]
    return {
        "method": level.method,
        "proven": level.proven,
        "orders": level.orders,
        "alignments": level.alignments,
        "windows_valued": level.valued,
        "changed": level.changed,
        "estimate_j": level.estimate_j,
        "given_estimate_j": level.given_j if np.isfinite(level.given_j) else None,
        "windows": [[names[k] for k in group] for group in level.windows.numbers],
        "sequence": sequence,
    }
