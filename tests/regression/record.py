"""What the regression baselines hold, and how they are recorded.

    python -m tests.regression.record              every baseline (about an hour)
    python -m tests.regression.record welds gtsp   these only

A baseline is a JSON file in `baselines/`: `tolerance` (of numbers, relative above 1), `values`, and
the `commit` it was recorded at. `measure` gives the values anew; of edges only the `quick` rows
where `quick` is asked for. Whoever changes a baseline says why in the same commit.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.motion.motion import Motion
from dmoc.robot.robot import load_robot
from planning import CollisionWorld, Station, alternatives, demo_station, plan_path
from sequencing import PlanStop, plan_station, schedule
from sequencing.cycle_types import Cycle
from sequencing.edges.nodes import HOME, station_nodes
from sequencing.edges.store import EdgeStore, encode_motion
from sequencing.edges.worker import EdgeJob, edge_motion
from sequencing.gtsp import GtspProblem, Stop, read_gtsplib, solve
from sequencing.timing.scheduling import schedule_to_dict
from sequencing.timing.search.optimise import SearchParams
from studies.pallet_cell.study import first_trajectories, pallet_cell, run_pallet_cell_study
from studies.stud_welding.page import study_entry
from studies.stud_welding.study import Budget, run_stud_welding_study
from studies.ur3.bezier_descent import DescentParams
from studies.ur3.case import Setting, solve_case
from studies.ur3.moves import paper_moves
from studies.ur3.reference import free_form
from studies.ur3.world import tabletop_world

FOLDER = Path(__file__).parent / "baselines"
ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("DMOC_DATA", ROOT.parent / "shared" / "data")) / "gtsplib"
STATIONS = ("stud_welding_a_8", "stud_welding_a", "stud_welding_b", "stud_welding_c")

# Solved numbers repeat to the last digit on one machine; another CPU rounds differently, and
# iterations that stop at a tolerance carry that on.
SOLVED, EXACT = 1e-6, 1e-9


@cache
def station_world(name: str) -> tuple[Station, CollisionWorld]:
    """A station with its world, built once."""
    station = demo_station(name)
    return station, CollisionWorld(station)


# ---- stations --------------------------------------------------------------------------------


def weld_costs(name: str) -> dict[str, list[float]]:
    """Costs of the alternatives of every stud."""
    station, world = station_world(name)
    return {
        item.stud.id: [float(one.weld_cost) for one in item.alternatives]
        for item in alternatives(station, world)
    }


def made_by(motion: Motion) -> dict[str, Any]:
    """What a motion costs and who made it."""
    return {
        "cost": motion.cost,
        "duration_s": motion.duration_s,
        "status": motion.status.value,
        "source": motion.source,
        "certified": motion.certified,
        "solver": motion.solver,
        "planner": motion.planner,
        "method": motion.method,
    }


def edge_row(name: str, row: dict[str, Any]) -> dict[str, Any]:
    """The motion of a row (ends, seed, quality, wanted method)."""
    station, world = station_world(name)
    studs = {stud.id: stud for stud in station.studs}
    job = EdgeJob(
        context="",
        key="",
        origin=row["from"],
        target=row["to"],
        start_rad=tuple(row["start_rad"]),
        goal_rad=tuple(row["goal_rad"]),
        quality="screen",
        method=row["wanted"],
        seed=row["seed"],
    )
    motion = edge_motion(station, world, studs, job)
    if row["quality"] == "final":
        refined = replace(job, quality="final", screened=encode_motion(motion))
        motion = edge_motion(station, world, studs, refined)
    return {**row, **made_by(motion)}


def solved_edges(name: str, rows: list[dict[str, Any]] | None, quick: bool) -> list[dict[str, Any]]:
    """The recorded rows solved again, or 30 drawn ones: 20 of all pairs, 10 of near ones."""
    if rows is not None:
        return [edge_row(name, row) for row in rows if row["quick"] or not quick]
    station, world = station_world(name)
    nodes = station_nodes(station, alternatives(station, world))
    pairs, draw = nodes.usable_pairs(), np.random.default_rng(1)
    far = np.abs(nodes.q_rad[pairs[:, 0]] - nodes.q_rad[pairs[:, 1]]).max(axis=1)
    near = pairs[np.argsort(far, kind="stable")[: len(pairs) // 20]]
    drawn = np.vstack(
        [few[draw.choice(len(few), n, False)] for few, n in ((pairs, 20), (near, 10))]
    )
    drawn[-1, 1] = nodes.home
    found: list[dict[str, Any]] = []
    for k, (i, j) in enumerate(drawn):
        ends = [None if nodes.stud[v] == HOME else nodes.stud[v] for v in (i, j)]
        row = {
            "from": ends[0],
            "to": ends[1],
            "seed": 1000 + k,
            "quick": False,
            "quality": "final" if k % 10 == 4 else "screen",
            "wanted": "boxes" if k % 10 == 7 else "halfspaces",
            "start_rad": nodes.q_rad[i].round(9).tolist(),
            "goal_rad": nodes.q_rad[j].round(9).tolist(),
        }
        found.append(edge_row(name, row))
        print(name, k, found[-1]["cost"], found[-1]["planner"], found[-1]["method"], flush=True)
    kinds: dict[tuple[str, ...], dict[str, Any]] = {}
    for row in found:
        kinds.setdefault((row["method"], row["planner"], row["quality"]), row)
    for row in kinds.values():
        row["quick"] = True
    return found


def cycle_figures(cycle: Cycle) -> dict[str, Any]:
    """Order, poses, weld costs, motions, totals and counts of a planned cycle."""
    search, tables = cycle.search, cycle.tables
    return {
        "welds": [[weld.stud, weld.alternative, weld.cost] for weld in cycle.welds],
        "motions": [
            {"from": item.origin, "to": item.target, **made_by(item.motion)}
            for item in cycle.motions
        ],
        "tour": cycle.tour.cost,
        "duration_s": cycle.duration_s,
        "energy_based": tables.energy_based.to_dict(),
        "time_based": tables.time_based.to_dict(),
        "time_based_totals": list(tables.time_based_totals),
        "lower_bound": search.lower_bound,
        "edges": [search.edges_total, search.edges_evaluated, search.edges_failed],
    }


def few_studs() -> dict[str, Any]:
    """The first two studs of the small station with few spins, planned as all are."""
    station = demo_station("stud_welding_a_8")
    station = replace(station, studs=station.studs[:2], spin_steps=2, precedence=())
    stop = PlanStop(training_edges=4, coverage_edges=2, baseline_draws=2)
    return cycle_figures(plan_station(station, stop=stop))


def planned(name: str) -> dict[str, Any]:
    """The eight-stud station as `dmoc demo` plans it, the others with few edges."""
    few = PlanStop(60, 40, conditional_gap=0.03, max_evaluations=100, baseline_draws=2)
    stop = None if name == STATIONS[0] else few
    return cycle_figures(plan_station(demo_station(name), stop=stop))


def ompl_paths() -> list[Any]:
    """OMPL's paths between ends of departure lines of the eight-stud station, shortened."""
    station, world = station_world(STATIONS[0])
    ends = [item.alternatives[0].line_rad[-1] for item in alternatives(station, world)]
    found = []
    for start, goal in pairwise(ends):
        result = plan_path(world, start, goal, seed=3, planner="ompl")
        knots = None if result.path is None else result.path.q_rad.tolist()
        found.append([result.planner, knots])
    return found


# ---- sequencing ------------------------------------------------------------------------------


def drawn_problem(seed: int) -> GtspProblem:
    """Clusters of points in a square, of every kind: symmetric or not, home, path, precedence."""
    rng = np.random.default_rng(seed)
    clusters = 7 + seed % 6
    labels = np.repeat(np.arange(clusters), rng.integers(1, 6, clusters))
    place = rng.random((len(labels), 2))
    cost = 100.0 * np.linalg.norm(place[:, None] - place, axis=2)
    if seed % 3 == 1:
        cost += rng.integers(0, 20, cost.shape)
    order = rng.permutation(clusters)
    precedence = tuple((int(order[k]), int(order[k + 2])) for k in (0, 2)) if seed % 4 == 2 else ()
    return GtspProblem(
        cost=cost,
        cluster_of=labels,
        precedence=precedence,
        path=seed % 5 == 3,
        node_cost=rng.integers(0, 10, len(labels)).astype(float),
    )


def sequences() -> dict[str, Any]:
    """Exact values of drawn problems, and what the heuristic finds in few iterations."""
    found: dict[str, Any] = {}
    for seed in range(20):
        exact = solve(drawn_problem(seed), seed=0, method="exact")
        found[f"drawn {seed}"] = [exact.cost, exact.proven]
    for seed in range(3):
        rng = np.random.default_rng(100 + seed)
        place = rng.random((120, 2))
        cost = 1000.0 * np.linalg.norm(place[:, None] - place, axis=2)
        problem = GtspProblem(cost=cost, cluster_of=np.repeat(np.arange(40), 3))
        tour = solve(problem, Stop(iterations=30_000), seed=seed, method="heuristic")
        found[f"heuristic {seed}"] = tour.cost
    return found


def library_sequences(most: int) -> dict[str, list[Any]]:
    """Exact values of the library's instances of at most `most` clusters; {} without the data."""
    if not DATA.is_dir():
        return {}
    with (DATA / "best_known.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if int(row["clusters"]) <= most]
    found = {}
    for row in rows:
        tour = solve(read_gtsplib(DATA / f"{row['instance']}.gtsp"), seed=0, method="exact")
        found[row["instance"]] = [tour.cost, tour.proven]
        assert tour.cost == float(row["best_known"]), row
    return found


# ---- cells and studies -----------------------------------------------------------------------


def schedule_figures(data: dict[str, Any]) -> dict[str, Any]:
    """What is compared of a schedule: energies, times and collisions of every case."""
    cases = {
        case["name"]: [case["energy_j"], case["duration_s"], case["collisions"]]
        for case in data["cases"]
    }
    kept = ("best", "energy_j", "status", "start_s", "override")
    return {"cases": cases, **{name: data[name] for name in kept}}


def few_trajectories() -> dict[str, Any]:
    """The first two trajectories of each robot of the cell, with a small search."""
    params = SearchParams(scattered=40, gradient_starts=1, gradient_iterations=10, polish_rounds=2)
    cell = first_trajectories(pallet_cell(), 2)
    return schedule_figures(schedule_to_dict(schedule(cell, 0, params)))


def cell_study() -> dict[str, Any]:
    """The study of the pallet cell on four trajectories a robot."""
    data = run_pallet_cell_study(0, trajectories=4, capacities_f=(1e-3, 6e-3))
    return {**schedule_figures(data), "capacity": data["capacity"]}


def bezier_optima(names: str, free: bool) -> dict[str, Any]:
    """UR3: descent, short swarm and, if `free`, the optimal control of movements."""
    robot = load_robot("ur3e_class")
    setting = Setting(robot, tabletop_world(robot), descent=DescentParams(starts=1, iterations=25))
    setting = replace(setting, swarm=replace(setting.swarm, iterations=10))
    found: dict[str, Any] = {}
    for move in [move for move in paper_moves() if move.name in names]:
        for metric in ("iv_absolute", "energy"):
            case = solve_case(move, metric, setting, (0,))
            found[f"{move.name} {metric}"] = [case.swarm[0].value, case.gradient.value]
        if free:
            report = free_form(move, case.best, setting)[0]
            kept = ("status", "optimal_control_j", "freed_bezier_j", "free_form_j")
            found[f"{move.name} free"] = {name: report[name] for name in kept}
    return found


def stud_study(letter: str, folder: Path) -> dict[str, Any]:
    """The reduced stud-welding study: totals, orders, what each part saves."""
    budget = Budget(8, 4, draws=2, edges_per_change=3, changes=("masses × 1.25",))
    with EdgeStore(folder / f"study_{letter}.sqlite") as store:
        entry = study_entry(
            run_stud_welding_study(letter, store, reduced=True, budget=budget).study
        )
    return {key: value for key, value in entry.items() if key not in ("provenance", "station")}


# ---- the files -------------------------------------------------------------------------------

Measure = Callable[[list[dict[str, Any]] | None, bool, Path], Any]


def _plain(function: Callable[..., Any], *arguments: Any) -> Measure:
    return lambda rows, quick, folder: function(*arguments)


#: name: (how it is measured, tolerance, whether it is quick)
BASELINES: dict[str, tuple[Measure, float, bool]] = {
    **{f"welds_{name}": (_plain(weld_costs, name), EXACT, True) for name in STATIONS},
    **{
        f"edges_{name}": (
            lambda rows, quick, folder, name=name: solved_edges(name, rows, quick),
            SOLVED,
            True,
        )
        for name in STATIONS
    },
    "plan_few_studs": (_plain(few_studs), SOLVED, True),
    "paths_ompl": (_plain(ompl_paths), SOLVED, True),
    "gtsp": (_plain(sequences), EXACT, True),
    "gtsplib_small": (_plain(library_sequences, 11), EXACT, True),
    "cell_few": (_plain(few_trajectories), SOLVED, True),
    "ur3_few": (_plain(bezier_optima, "AC", False), SOLVED, True),
    **{f"plan_{name}": (_plain(planned, name), SOLVED, False) for name in STATIONS},
    "gtsplib": (_plain(library_sequences, 40), EXACT, False),
    "cell_study": (_plain(cell_study), SOLVED, False),
    "ur3_study": (_plain(bezier_optima, "ABCD", True), SOLVED, False),
    **{
        f"study_{letter}": (
            lambda rows, quick, folder, letter=letter: stud_study(letter, folder),
            SOLVED,
            False,
        )
        for letter in "ABC"
    },
}


def read(name: str) -> dict[str, Any]:
    """A recorded baseline."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def plain(value: Any) -> Any:
    """`value` as JSON gives it back."""
    return json.loads(json.dumps(value, default=lambda x: x.tolist()))


def main(names: list[str]) -> None:
    """Record the named baselines, or all of them."""
    import tempfile

    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()
    for name in names or BASELINES:
        measure, tolerance, _ = BASELINES[name]
        with tempfile.TemporaryDirectory() as folder:
            values = plain(measure(None, False, Path(folder)))
        entries = values.items() if isinstance(values, dict) else enumerate(values)
        opening, closing = "{}" if isinstance(values, dict) else "[]"
        lines = ",\n".join(
            (f"{json.dumps(key)}: " if opening == "{" else "") + json.dumps(value)
            for key, value in entries
        )
        head = f'"commit": "{commit}", "tolerance": {tolerance}, "values": {opening}'
        text = f"{{{head}\n{lines}\n{closing}}}\n"
        FOLDER.mkdir(exist_ok=True)
        (FOLDER / f"{name}.json").write_text(text, encoding="utf-8")
        print("recorded", name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
