"""The UR3 study: particle swarm over Bézier motions, against gradients and optimal control.

After Vysocký et al., Reduction in Robotic Arm Energy Consumption by Particle Swarm Optimization,
Applied Sciences 10 (2020) 8241: its parametrisation, swarm and metric on a model of a UR3e, with
limits and collisions enforced, beside the physical electrical energy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.physics.metrics import BUS_VOLTAGE_V
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import load_robot
from dmoc.swarm import SwarmParams
from sequencing.runs.archive import json_text, write_atomic
from sequencing.runs.result import package_versions
from studies.ur3.case import (
    ENERGIES,
    Setting,
    case_report,
    judge,
    saving,
    solve_case,
    viscous_floor_j,
)
from studies.ur3.export import export_motion
from studies.ur3.moves import CLASSES, Move, movej, paper_moves, random_moves
from studies.ur3.reference import free_form
from studies.ur3.sweeps import duration_sweep, obstacle_sweep, payload_sweep
from studies.ur3.world import tabletop_world

#: Table 2 of the paper.
PAPER_SAVING_PERCENT = {"A": 23.0, "B": 37.0, "C": 10.0, "D": 16.0}

WHAT_THE_METRIC_MEASURES = (
    "The paper's Eq. 6 multiplies motor currents by the bus voltage. A motor takes its current at "
    "its own voltage, a fraction of the bus voltage set by the chopper, so I·V is not electrical "
    "power: it prices torque, also that of holding still, at the bus voltage. Savings in it are "
    "savings of torque; the physical energy, printed beside it, is motor work plus losses, and "
    "the constant consumption of controller and fans, which no path changes, comes on top."
)

Progress = Callable[[str], None]


def run_ur3_study(
    seed: int,
    out: Path | None,
    reduced: bool = False,
    progress: Progress | None = None,
    solver: str = "ipopt",
) -> dict[str, Any]:
    """Run the study and return its figures; with `out` also write them there.

    `study.json` holds everything but times, which are in `timing.json`; `out/A` … `out/D` are run
    folders with the best motion in the paper's metric and its exports. `reduced` takes fewer
    seeds, pairs and iterations, to see that everything runs.
    """
    say = progress or (lambda text: None)
    robot = load_robot("ur3e_class")
    setting = Setting(robot, tabletop_world(robot), solver=solver)
    seeds = tuple(range(seed, seed + (2 if reduced else 10)))
    pairs = 2 if reduced else 20
    if reduced:
        setting = replace(setting, swarm=replace(setting.swarm, iterations=60))
    cpu: dict[str, float] = {}
    movements, best = [], {}
    for move in paper_moves():
        say(f"movement {move.name}")
        report, motions = _movement(move, setting, seeds, cpu)
        movements.append(report)
        best[move.name] = motions
    say("random pairs")
    classes = {kind: _class(kind, pairs, setting, seed, cpu, say) for kind in CLASSES}
    moves = paper_moves()
    say("payload, duration, obstacles")
    few = moves[:1] if reduced else moves
    durations, best_durations = duration_sweep(few, setting, (2.0, 3.0) if reduced else _DURATIONS)
    result: dict[str, Any] = {
        "name": "ur3",
        "seed": seed,
        "reduced": reduced,
        "versions": package_versions(),
        "settings": _settings(setting, seeds, pairs),
        "statement": WHAT_THE_METRIC_MEASURES,
        "movements": movements,
        "classes": classes,
        "payload": payload_sweep(few, setting, (0.0, 3.0) if reduced else _PAYLOADS),
        "duration": durations,
        "best_duration": best_durations,
        "obstacles": obstacle_sweep(few, setting, seed),
        "exports": [],
    }
    if out is not None:
        say("exports")
        for move in moves:
            motion, energy = best[move.name]["iv_absolute"]
            report = export_motion(
                f"ur3_{move.name}", motion, robot, energy, out / move.name, seed, setting.world
            )
            result["exports"].append({"move": move.name, **report})
    result["goals"] = _goals(result, cpu)
    if out is not None:
        write_atomic(out / "study.json", json_text(result))
        write_atomic(out / "timing.json", json_text({"cpu_s": cpu}))
    return {**result, "cpu_s": cpu}


_DURATIONS = (1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)
_PAYLOADS = (0.0, 1.0, 2.0, 3.0)


def _movement(
    move: Move, setting: Setting, seeds: tuple[int, ...], cpu: dict[str, float]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Report of one movement of the paper, and its best motion with its energy per metric."""
    baseline = judge(movej(move, setting.robot, setting.duration_s), setting)
    report: dict[str, Any] = {
        "name": move.name,
        "start_rad": move.start_rad.tolist(),
        "goal_rad": move.goal_rad.tolist(),
        "paper_saving_percent": PAPER_SAVING_PERCENT[move.name],
        "baseline": baseline,
        "viscous_floor_j": viscous_floor_j(move, setting),
        "metrics": {},
    }
    best = {}
    for metric in ENERGIES:
        found = solve_case(move, metric, setting, seeds)
        _add_cpu(cpu, f"{move.name}/{metric}", found.swarm_cpu_s / len(seeds), found)
        entry = case_report(found, setting)
        physical = found.best.motion
        entry["best"] = judge(physical, setting)
        with_base = baseline["energy_with_base_j"]
        entry["physical_saving_percent"] = saving(baseline["energy_j"], entry["best"]["energy_j"])
        entry["physical_saving_with_base_percent"] = saving(
            with_base, entry["best"]["energy_with_base_j"]
        )
        report["metrics"][metric] = entry
        best[metric] = (physical, entry["best"]["energy_j"])
        if metric == "energy":
            reference, _, seconds = free_form(move, found.best, setting)
            report["free_form"] = reference
            cpu[f"{move.name}/free_form"] = seconds
    return report, best


def _class(
    kind: str, count: int, setting: Setting, seed: int, cpu: dict[str, float], say: Progress
) -> dict[str, Any]:
    """Random pairs of a class: one swarm each, the gradient and the free-form reference."""
    pairs = []
    for k, move in enumerate(random_moves(setting.robot, setting.world, kind, count, seed)):
        say(f"pair {move.name}")
        row: dict[str, Any] = {
            "name": move.name,
            "start_rad": move.start_rad.tolist(),
            "goal_rad": move.goal_rad.tolist(),
            "baseline": judge(movej(move, setting.robot, setting.duration_s), setting),
        }
        for metric in ("iv_absolute", "energy"):
            found = solve_case(move, metric, setting, (seed + k,), gradient_seed=seed + k)
            _add_cpu(cpu, f"{move.name}/{metric}", found.swarm_cpu_s, found)
            entry = case_report(found, setting)
            physical = judge(found.best.motion, setting)["energy_with_base_j"]
            entry["physical_saving_with_base_percent"] = saving(
                row["baseline"]["energy_with_base_j"], physical
            )
            row[metric] = entry
            if metric == "energy":
                row["free_form"], _, seconds = free_form(move, found.best, setting)
                cpu[f"{move.name}/free_form"] = seconds
        pairs.append(row)
    return {"pairs": pairs, "median": _medians(pairs)}


def _add_cpu(cpu: dict[str, float], name: str, swarm_s: float, found: Any) -> None:
    cpu[f"{name}/swarm"], cpu[f"{name}/gradient"] = swarm_s, found.gradient_cpu_s


def _medians(pairs: list[dict[str, Any]]) -> dict[str, Any]:
    """Class medians of savings [%] and of physical joules."""
    report: dict[str, Any] = {}
    for metric in ("iv_absolute", "energy"):
        for kind, key in (("swarm", "median_saving_percent"), ("gradient", "saving_percent")):
            known = [p[metric][kind][key] for p in pairs if p[metric][kind][key] is not None]
            report[f"{metric}/{kind}_percent"] = float(np.median(known)) if known else None
        key = "physical_saving_with_base_percent"
        report[f"{metric}/physical_with_base_percent"] = float(
            np.median([p[metric][key] for p in pairs])
        )
    for kind in ("bezier_j", "free_form_j"):
        report[kind] = float(np.median([p["free_form"].get(kind, np.nan) for p in pairs]))
    return report


def _settings(setting: Setting, seeds: tuple[int, ...], pairs: int) -> dict[str, Any]:
    robot, swarm = setting.robot, setting.swarm
    assert isinstance(swarm, SwarmParams)
    drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
    return {
        "robot": robot.name,
        "duration_s": setting.duration_s,
        "bus_voltage_v": BUS_VOLTAGE_V,
        "base_power_w": drive.base_power_w,
        "seeds": list(seeds),
        "pairs_per_class": pairs,
        "particles": swarm.particles,
        "iterations": swarm.iterations,
        "inertia": swarm.inertia,
        "cognitive": swarm.cognitive,
        "social": swarm.social,
        "starts": setting.descent.starts,
        "drive": drive.to_dict(),
        "provenance": dict(sorted(robot.provenance.items())),
    }


def _goals(result: dict[str, Any], cpu: dict[str, float]) -> dict[str, Any]:
    """The goals of the study in numbers; CPU ratios are in `cpu_s` only, as they vary."""
    rows = [pair for group in result["classes"].values() for pair in group["pairs"]]
    cases = [p[m] for p in rows for m in ("iv_absolute", "energy")]
    references = [p["free_form"] for p in (*rows, *result["movements"])]
    moves = result["movements"]
    metrics = [entry for move in moves for entry in move["metrics"].values()]
    swarm = sum(v for k, v in cpu.items() if k.endswith("/swarm"))
    cpu["gradient_to_swarm_ratio"] = (
        sum(v for k, v in cpu.items() if k.endswith("/gradient")) / swarm
    )
    return {
        "swarm_median_percent": {
            m["name"]: m["metrics"]["iv_absolute"]["swarm"]["median_saving_percent"] for m in moves
        },
        "paper_percent": PAPER_SAVING_PERCENT,
        "gradient_below_swarm_share": float(
            np.mean([c["gradient_below_swarm_median"] for c in cases])
        ),
        "gradient_below_swarm_on_movements": all(
            m["metrics"][k]["gradient_below_swarm_median"]
            for m in moves
            for k in ("iv_absolute", "energy")
        ),
        "limits_and_collisions_respected": all(
            c["gradient"]["feasible"] and all(c["swarm"]["feasible"]) for c in (*cases, *metrics)
        ),
        "free_form_converged_share": float(
            np.mean([r["status"] == "converged" for r in references])
        ),
        "bezier_below_free_form": sum(bool(r.get("bezier_below", True)) for r in references),
        "bezier_below_optimal_control": sum(
            bool(r["bezier_j"] < r.get("optimal_control_j", np.inf)) for r in references
        ),
        "references": len(references),
    }
