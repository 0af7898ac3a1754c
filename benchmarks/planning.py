"""MotionBenchMaker: how many problems are solved, refined and certified, and how fast.

    python -m benchmarks.planning [--robots panda,ur5] [--limit N] [--refine N] [--peer N]

Each problem whose ends are free is planned once (seed 1): the search and its proof alone, and with
shortcuts. The first `--refine` problems of a set are made into motions (half-spaces, N = 20) and
certified. Every problem is also planned by OMPL's RRTConnect on our segment checks, and the first
`--peer` of a set by OMPL with fcl's checks, and by pyroboplan where that is installed.
`--allowed srdf` takes the allowed collisions from the SRDF of example-robot-data instead of the
scenes' own matrices (it permits more). Saves `results/planning.json` and `.md`; with `--sets` those
of the other sets stay.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.mbm import SETS, Problem, data_folder, problems
from benchmarks.mbm_robots import panda, srdf_of, ur5, ur5_gripper
from benchmarks.planning_common import merged, save, table
from benchmarks.planning_peers import has_pyroboplan, pyroboplan_ms
from dmoc.motion.motion import MotionProblem
from dmoc.refinement import RefineParams, refine
from planning.path.rrt_connect import plan_path

GROWTH_M = 0.01
END_GAP_M = 0.002
WANTED_M = 0.005  # the goals of these sets lie nearer than the 2 cm of a welding station


def end_fault(problem: Problem) -> str:
    """Why a problem's ends are not valid, or ''."""
    robot, world = problem.world.robot, problem.world
    for name, q in (("start", problem.start_rad), ("goal", problem.goal_rad)):
        if np.any(q < robot.q_lower_rad - 1e-9) or np.any(q > robot.q_upper_rad + 1e-9):
            return f"{name} outside the joint limits"
        pair = world.collide(q, END_GAP_M)
        if pair is not None:
            return f"{name}: {pair[0]} and {pair[1]} nearer than {1e3 * END_GAP_M:.0f} mm"
    return ""


def plan(problem: Problem, **options: Any) -> tuple[Any, float]:
    """The planner's result and its CPU time [ms]."""
    begin = time.process_time()
    result = plan_path(
        problem.world, problem.start_rad, problem.goal_rad, seed=1, inflation_m=GROWTH_M, **options
    )
    return result, 1e3 * (time.process_time() - begin)


def refined(problem: Problem, path: Any) -> tuple[Any, float]:
    """The refined motion along a path and its CPU time [s]."""
    begin = time.process_time()
    task = MotionProblem(problem.world.robot, problem.start_rad, problem.goal_rad, num_intervals=20)
    params = RefineParams.screening(clearance_m=WANTED_M)
    motion = refine(task, path, problem.world.clearance(), params=params)
    return motion, time.process_time() - begin


def run_set(name: str, robot: Any, tool: Any, folder: Path, options: Any) -> dict[str, Any]:
    """Figures of one set."""
    faults: Counter[str] = Counter()
    search, whole, motion_s, unsolved, not_certified = [], [], [], [], []
    peer: list[float] = []
    ompl_ms, ompl_solved = [], 0
    ours: list[float] = []
    other: list[tuple[bool, float]] = []
    count = valid = solved = refinements = certified = fallbacks = 0
    srdf = srdf_of(robot) if options.allowed == "srdf" else None
    for problem in problems(robot, tool, folder, srdf=srdf):
        if count == options.limit:
            break
        count += 1
        fault = end_fault(problem)
        if fault:
            faults[fault] += 1
            continue
        valid += 1
        if valid == 1:
            plan(problem, planner="compiled")  # compiles and warms up
            plan(problem, planner="ompl")
        search.append(plan(problem, planner="compiled", shortcut_tries=0)[1])
        result, spent = plan(problem, planner="compiled")
        whole.append(spent)
        by_ompl, spent = plan(problem, planner="ompl")
        ompl_ms.append(spent)
        ompl_solved += by_ompl.path is not None
        if len(other) < options.peer and has_pyroboplan():
            other.append(pyroboplan_ms(problem, 1))
        if result.path is None:
            unsolved.append(problem.name)
            continue
        solved += 1
        if refinements < options.refine:
            refinements += 1
            motion, seconds = refined(problem, result.path)
            motion_s.append(seconds)
            if motion.certified and motion.source == "refined":
                certified += 1
            else:
                fallbacks += bool(motion.certified)
                not_certified.append(f"{problem.name}: {motion.status} {motion.note}")
    for problem in problems(robot, tool, folder, engine="fcl", srdf=srdf):
        if len(peer) == options.peer:
            break
        if not end_fault(problem):
            peer.append(plan(problem, planner="compiled")[1])
            ours.append(whole[len(peer) - 1])
    return {
        "set": name,
        "problems": count,
        "valid ends": valid,
        "invalid": dict(faults),
        "solved": solved,
        "unsolved": unsolved,
        "search + proof, median [ms]": float(np.median(search)),
        "search + proof, p90 [ms]": float(np.percentile(search, 90)),
        "with shortcuts, median [ms]": float(np.median(whole)),
        "with shortcuts, p90 [ms]": float(np.percentile(whole, 90)),
        "OMPL's planner on our checks: solved": ompl_solved,
        "OMPL's planner on our checks, median [ms]": float(np.median(ompl_ms)),
        "refined": refinements,
        "refined and certified": certified,
        "fallbacks": fallbacks,
        "not certified": not_certified,
        "refinement, median [s]": float(np.median(motion_s)) if motion_s else float("nan"),
        "OMPL with fcl / ours": (
            float(np.median(np.array(peer) / np.array(ours))) if peer else float("nan")
        ),
        "pyroboplan: solved": f"{sum(done for done, _ in other)}/{len(other)}",
        "pyroboplan / ours": (
            float(np.median([ms for _, ms in other] / np.array(whole[: len(other)])))
            if other
            else float("nan")
        ),
    }


SHOWN = (
    "set",
    "problems",
    "valid ends",
    "solved",
    "search + proof, median [ms]",
    "search + proof, p90 [ms]",
    "with shortcuts, median [ms]",
    "with shortcuts, p90 [ms]",
    "OMPL's planner on our checks: solved",
    "OMPL's planner on our checks, median [ms]",
    "refined",
    "refined and certified",
    "fallbacks",
    "refinement, median [s]",
    "OMPL with fcl / ours",
    "pyroboplan: solved",
    "pyroboplan / ours",
)


def main() -> None:
    """Run all sets, print, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default="panda,ur5")
    parser.add_argument("--sets", default="")
    parser.add_argument("--allowed", choices=("scene", "srdf"), default="scene")
    parser.add_argument("--limit", type=int, default=10_000)
    parser.add_argument("--refine", type=int, default=10_000)
    parser.add_argument("--peer", type=int, default=5)
    options = parser.parse_args()
    if not data_folder().is_dir():
        raise SystemExit(f"no MotionBenchMaker data at {data_folder()} (set DMOC_DATA); skipped")
    results = []
    with tempfile.TemporaryDirectory() as folder:
        arms = {
            "panda": lambda: (panda(Path(folder)), ()),
            "ur5": lambda: (ur5(Path(folder)), ur5_gripper()),
        }
        for arm in options.robots.split(","):
            robot, tool = arms[arm]()
            for name in SETS[arm]:
                if options.sets and name not in options.sets.split(","):
                    continue
                results.append(run_set(name, robot, tool, data_folder() / arm / name, options))
    if options.sets:
        results = merged("planning", "set", results)
    rows = [[figures.get(key, "") for key in SHOWN] for figures in results]
    text = table(list(SHOWN), rows)
    for figures in results:
        for key in ("invalid", "unsolved", "not certified"):
            if figures[key]:
                text += f"\n\n{figures['set']}, {key}: {figures[key]}"
    print(text)
    save("planning", results, "MotionBenchMaker: planned, refined, certified", text)


if __name__ == "__main__":
    main()
