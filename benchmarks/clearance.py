"""Boxes against half-spaces on 30 pairs of two stud-welding stations, from the same seed path.

The pairs are drawn once with a fixed seed: ten whose straight joint-space line is free, ten whose
line hits a clamp, ten whose gun goes in or out between tunnel, sills and walls of the part and
whose line hits the part. Prints a table and saves it with every figure behind it.

    python -m benchmarks.clearance [--per-class 10]
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from benchmarks.planning_common import machine_load
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.motion.trajectory import JointPath
from dmoc.physics.running_cost import trajectory_cost
from dmoc.refinement import RefineParams, RefineRecord, refine
from dmoc.refinement.iterate import iterate_from_path
from planning import CollisionWorld, alternatives, demo_station
from planning.collision.world import EdgeClearance
from planning.path.departure import line_through, with_departure
from planning.path.edge_motion import EdgeParams, seed_paths
from planning.welds.poses import weld_line

SEED = 20260101
STATIONS = ("stud_welding_a", "stud_welding_b")
CLASSES = ("free", "around a clamp", "gun in and out")
RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Pair:
    """One drawn edge."""

    kind: str
    name: str
    problem: MotionProblem
    clearance: EdgeClearance
    path: JointPath


def draw(per_class: int) -> list[Pair]:
    """The pairs, half of every class from each station, in the order in which they are met."""
    rng = np.random.default_rng(SEED)
    pairs: list[Pair] = []
    for index, name in enumerate(STATIONS):
        station = demo_station(name)
        world = CollisionWorld(station)
        studs = [s for s in alternatives(station, world) if s.alternatives]
        share = [per_class // 2 + (index < per_class % 2)] * len(CLASSES)
        while any(share):
            i, j = rng.choice(len(studs), 2, replace=False)
            start, goal = (
                s.alternatives[rng.integers(len(s.alternatives))] for s in (studs[i], studs[j])
            )
            problem = with_departure(
                MotionProblem(station.robot, start.q_rad, goal.q_rad, station.cost, 20),
                line_through(start.line_rad),
                line_through(goal.line_rad),
            )
            clearance = world.clearance(
                weld_line(station, studs[i].stud), weld_line(station, studs[j].stud)
            )
            kind = _kind(problem, clearance, {studs[i].stud.group, studs[j].stud.group})
            if kind is None or not share[CLASSES.index(kind)]:
                continue
            found = next(iter(seed_paths(problem, clearance, SEED, EdgeParams(num_paths=1))))
            if found.path is None:
                continue
            share[CLASSES.index(kind)] -= 1
            label = f"{name} {start.stud_id}.{start.index}-{goal.stud_id}.{goal.index}"
            pairs.append(Pair(kind, label, problem, clearance, found.path))
    return sorted(pairs, key=lambda pair: CLASSES.index(pair.kind))


def _kind(problem: MotionProblem, clearance: EdgeClearance, groups: set[str]) -> str | None:
    assert problem.depart_rad is not None
    assert problem.arrive_rad is not None
    share = np.linspace(0.0, 1.0, 200)[:, None]
    line = (1 - share) * problem.depart_rad[-1] + share * problem.arrive_rad[0]
    rows = clearance.rows(line, 0.002)
    hit = {body for pair in rows.pair for body in pair}
    if not hit:
        return "free"
    if groups & {"sill", "tunnel_side", "end"} and "underbody" in hit:
        return "gun in and out"
    if any(body.startswith("clamp") for body in hit):
        return "around a clamp"
    return None


def measure(pair: Pair, method: str, params: RefineParams) -> dict[str, Any]:
    """Refine once, after a first call has built and loaded what is kept."""
    records: list[RefineRecord] = []
    begin = time.process_time()
    motion = refine(
        pair.problem,
        pair.path,
        pair.clearance,
        method=method,
        params=params,
        trace=records.append,
        fallback=False,
    )
    cpu = time.process_time() - begin
    costs = [r.cost for r in records if r.accepted]
    return {
        "cost": motion.cost,
        "certified": bool(motion.certified),
        "cpu_s": cpu,
        "solves": len(records),
        "outers": len(costs),
        "outers_1_percent": _outers(costs, 0.01),
        "outers_0.1_percent": _outers(costs, 0.001),
        "max_defect": motion.max_defect,
        "solver_iterations": motion.iterations,
        "status": motion.status.value,
        "note": motion.note,
    }


def _outers(costs: list[float], fraction: float) -> int:
    """Outer iterations until J changes by less than `fraction`."""
    for k in range(1, len(costs)):
        if abs(costs[k] - costs[k - 1]) <= fraction * costs[k]:
            return k + 1
    return len(costs)


METHODS = {
    "boxes, knots only": ("boxes", RefineParams.paper()),
    "boxes, sub-points": ("boxes", RefineParams(stop_fraction=1e-3, max_outer=200)),
    "half-spaces 1 %": ("halfspaces", RefineParams.screening()),
    "half-spaces 0.3 %": ("halfspaces", RefineParams()),
}


def run(pairs: list[Pair]) -> list[dict[str, Any]]:
    """All methods on all pairs."""
    rows = []
    for method, params in METHODS.values():
        for pair in pairs[:: max(1, len(pairs) // 3)]:
            refine(pair.problem, pair.path, pair.clearance, method=method, params=params)
    for pair in pairs:
        free: Motion = refine(pair.problem, None, pair.clearance, method="none")
        seed = iterate_from_path(pair.problem, pair.path).trajectory(pair.problem)
        row: dict[str, Any] = {
            "kind": pair.kind,
            "pair": pair.name,
            "free": free.cost,
            "free_certified": bool(free.certified),
            "seed": trajectory_cost(seed, pair.problem.robot, pair.problem.cost),
        }
        for name, (method, params) in METHODS.items():
            row[name] = measure(pair, method, params)
        rows.append(row)
        print(pair.kind, pair.name, *(f"{row[m]['cost']:.1f}" for m in METHODS), flush=True)
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Medians by class, as markdown. Costs relative to the knot-only boxes of the paper."""
    lines = [
        "| class | method | J / paper's boxes | outers to 1 % / 0.1 % | CPU s | ms a solve "
        "| certified | largest defect |",
        "|---|---|---|---|---|---|---|---|",
    ]
    paper = "boxes, knots only"
    for kind in CLASSES:
        part = [r for r in rows if r["kind"] == kind]
        if not part:
            continue
        free = np.median([r["free"] / r[paper]["cost"] for r in part])
        seed = np.median([r["seed"] / r[paper]["cost"] for r in part])
        lines.append(
            f"| {kind} | obstacle-free optimum | {free:.3f} | | | | "
            f"{sum(r['free_certified'] for r in part)}/{len(part)} | |"
        )
        lines.append(f"| {kind} | time-scaled seed | {seed:.3f} | | | | | |")
        for name in METHODS:
            one = [r[name] for r in part]
            ratio = [r[name]["cost"] / r[paper]["cost"] for r in part]
            certified = sum(m["certified"] for m in one)
            defect = max((m["max_defect"] for m in one if m["certified"]), default=float("nan"))
            lines.append(
                f"| {kind} | {name} | {np.median(ratio):.3f} | "
                f"{np.median([m['outers_1_percent'] for m in one]):.0f} / "
                f"{np.median([m['outers_0.1_percent'] for m in one]):.0f} | "
                f"{np.median([m['cpu_s'] for m in one]):.2f} | "
                f"{np.median([1e3 * m['cpu_s'] / max(m['solves'], 1) for m in one]):.0f} | "
                f"{certified}/{len(one)} | {defect:.1e} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Draw, measure, print, save."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--per-class", type=int, default=10)
    arguments = parser.parse_args()
    rows = run(draw(arguments.per_class))
    text = table(rows)
    print(text)
    RESULTS.mkdir(exist_ok=True)
    facts = {
        "date": date.today().isoformat(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "casadi": casadi.__version__,
        "seed": SEED,
        "rows": rows,
    }
    (RESULTS / "clearance.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
    head = (
        f"Measured {facts['date']}, {facts['machine']}, Python {facts['python']}, CasADi "
        f"{facts['casadi']}; {len(rows)} pairs, N = 20, medians; {machine_load()}.\n\n"
    )
    (RESULTS / "clearance.md").write_text(head + text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
