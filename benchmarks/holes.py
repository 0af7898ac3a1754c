"""245 holes in a curved panel, sequenced by time: one GTSP against order first, then poses.

    python -m benchmarks.holes [--efforts quick] [--legs 6] [--spins 3]

RoboTSP (Suárez-Ruiz, Lembono, Pham 2018) drills 245 holes in two steps: the shortest order of the
holes in task space, then for this order the best joint vectors, by dynamic programming. The panel
here is our own, with the same number of holes; both methods get the same alternatives and the
same travel times, and both orders come from the same solver. Travel: the fastest synchronised
trapezoid between the ends of the departure lines, plus the lines. A sample of consecutive legs of
both tours is planned for real, refined and certified. CPU seconds of this machine.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np

from dmoc import Robot
from planning.collision.world import CollisionWorld
from planning.station.build import load_station
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing.edges.nodes import HOME, StationNodes, station_nodes
from sequencing.edges.worker import EdgeJob, edge_motion
from sequencing.gtsp import GtspProblem, Stop, solve
from sequencing.gtsp.cluster_optimisation import optimise_anchored

RESULTS = Path(__file__).parent / "results"
ROWS, COLUMNS = 7, 35
ARC_CENTRE_M, ARC_RADIUS_M = np.array([2.35, 0.15]), 1.2
ANGLES_DEG = np.linspace(22.0, 70.0, ROWS)
HALF_LENGTH_M = 0.72
DRILL_S = 3.0
WARM = 500  # iterations for each hole, from the recipe's tour
STATION = """\
schema_version: 1
name: panel_245
robot: {{model: irb6640_class}}
tool:
  shapes:
    - {{name: arm, box_m: [0.30, 0.10, 0.10], pose: {{position_m: [0.15, 0, 0.04]}}}}
    - {{name: spindle, box_m: [0.12, 0.12, 0.30], pose: {{position_m: [0.3, 0, -0.02]}}}}
    - {{name: drill, cylinder_m: [0.010, 0.23], pose: {{position_m: [0.3, 0, -0.285]}},
       touches: true}}
  mass_kg: 30
  com_m: [0.24, 0, 0]
  inertia_kg_m2: [[0.9, 0, 0], [0, 1.2, 0], [0, 0, 0.6]]
  tip: {{position_m: [0.3, 0, -0.405], quaternion_xyzw: [1, 0, 0, 0]}}
obstacles:
{strips}  - {{name: ground, box_m: [7, 6, 0.1], pose: {{position_m: [1.2, 0, -0.05]}}}}
studs: holes.csv
spin_steps: {spins}
departure: {{direction: normal, length_m: 0.03}}
home_rad: [0, -0.35, 0.35, 0, 0.6, 0]
clearance_m: 0.01
cost: {{time: 1.0, effort: 1.0e-8, velocity: 1.0e-2}}
"""


def write_panel(folder: Path, spins: int) -> Path:
    """The station's files: seven strips of a fuselage-like skin, 35 holes in each."""
    rng = np.random.default_rng(245)
    strips, lines = "", ["id,x_m,y_m,z_m,nx,ny,nz,weld_time_s"]
    for row, angle in enumerate(np.deg2rad(ANGLES_DEG), start=1):
        normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
        along = np.array([np.cos(angle), 0.0, np.sin(angle)])
        top = np.array([ARC_CENTRE_M[0], 0.0, ARC_CENTRE_M[1]]) + ARC_RADIUS_M * normal
        middle = top - 0.006 * normal
        half = -angle / 2
        strips += (
            f"  - {{name: strip_{row}, box_m: [0.18, {2 * HALF_LENGTH_M + 0.1:g}, 0.012], pose: "
            f"{{position_m: [{middle[0]:.6f}, 0, {middle[2]:.6f}], "
            f"quaternion_xyzw: [0, {np.sin(half):.9f}, 0, {np.cos(half):.9f}]}}}}\n"
        )
        for k, y in enumerate(np.linspace(-HALF_LENGTH_M, HALF_LENGTH_M, COLUMNS), start=1):
            across, aside = rng.uniform(-0.03, 0.03), rng.uniform(-0.006, 0.006)
            x = top + across * along + np.array([0.0, y + aside, 0.0])
            numbers = ",".join(f"{v:.6f}" for v in (*x, *normal))
            lines.append(f"H{row}{k:02d},{numbers},{DRILL_S}")
    path = folder / "station.yaml"
    path.write_text(STATION.format(strips=strips, spins=spins), encoding="utf-8")
    (folder / "holes.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def travel_times(robot: Robot, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Durations (K,) [s] of the fastest synchronised trapezoids between rows (K, n)."""
    way = np.abs(goal - start)
    slow = (way / robot.velocity_limit_rad_s).max(axis=-1)  # 1 / speed of s
    root = np.sqrt((way / robot.acceleration_limit_rad_s2).max(axis=-1))  # 1 / √acceleration
    with np.errstate(divide="ignore", invalid="ignore"):
        plateau = slow + root**2 / slow
    return np.where(slow > root, plateau, 2.0 * root)


def problem_of(nodes: StationNodes, robot: Robot) -> GtspProblem:
    """Travel times between line ends as costs, both ways along the own line as node costs."""
    ends = nodes.line_end_rad
    cost = np.stack([travel_times(robot, row[None, :], ends) for row in ends])
    lines = 2.0 * travel_times(robot, nodes.q_rad, ends)
    return GtspProblem(cost, nodes.cluster_of, node_cost=lines, home=nodes.home, name="panel_245")


def order_then_poses(problem: GtspProblem, place: np.ndarray, seed: int) -> tuple[int, ...]:
    """The recipe: shortest order of the places (M, 3), then the best nodes for that order."""
    between = np.linalg.norm(place[:, None] - place[None], axis=2)
    assert problem.home is not None
    home = int(problem.cluster_of[problem.home])
    single = GtspProblem(between, np.arange(len(place)), home=home)
    order = [int(g) for g in solve(single, seed=seed, effort="quick").nodes]
    by_cluster = np.argsort(problem.cluster_of, kind="stable")
    ptr = np.concatenate([[0], np.cumsum(np.bincount(problem.cluster_of))]).astype(np.int64)
    half = problem.node_cost[by_cluster] / 2
    cost = problem.cost[np.ix_(by_cluster, by_cluster)] + half[:, None] + half[None, :]
    node = np.zeros(len(order), dtype=np.int64)
    node[0] = ptr[home]  # home is alone in its cluster
    work = np.empty(len(cost)), np.empty(len(cost), dtype=np.int64)
    optimise_anchored(cost, ptr, np.array(order), len(order), node, *work)
    return tuple(int(by_cluster[v]) for v in node)


def certified_legs(
    problem: GtspProblem,
    nodes: StationNodes,
    station: Station,
    world: CollisionWorld,
    tour: tuple[int, ...],
    legs: int,
) -> list[dict]:
    """Final motions of `legs` legs spread evenly over the tour."""
    studs = {stud.id: stud for stud in station.studs}
    rows = []
    for k in np.linspace(0, len(tour) - 1, legs).round().astype(int):
        u, v = tour[k], tour[(k + 1) % len(tour)]
        ends = [None if nodes.stud[w] == HOME else nodes.stud[w] for w in (u, v)]
        job = EdgeJob(
            context="",
            key=f"{u}-{v}",
            origin=ends[0],
            target=ends[1],
            seed=0,
            quality="final",
            start_rad=tuple(nodes.q_rad[u]),
            goal_rad=tuple(nodes.q_rad[v]),
            method="halfspaces",
        )
        motion = edge_motion(station, world, studs, job)
        model = problem.cost[u, v] + (problem.node_cost[u] + problem.node_cost[v]) / 2
        duration = None if motion.trajectory is None else float(motion.trajectory.t_s[-1])
        rows.append(
            {
                "from": nodes.stud[u],
                "to": nodes.stud[v],
                "certified": bool(motion.certified),
                "duration_s": duration,
                "model_s": float(model),
                "status": motion.status.name,
            }
        )
        print("   ", rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--efforts", default="quick")
    parser.add_argument("--legs", type=int, default=6)
    parser.add_argument("--spins", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=RESULTS / "holes.json")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        station = load_station(write_panel(Path(folder), args.spins))
    world = CollisionWorld(station)
    begin = time.process_time()
    found = alternatives(station, world)
    cpu_alternatives = time.process_time() - begin
    without = [item.stud.id for item in found if not item.alternatives]
    nodes = station_nodes(station, found)
    begin = time.process_time()
    problem = problem_of(nodes, station.robot)
    cpu_costs = time.process_time() - begin
    sizes = np.bincount(problem.cluster_of)
    print(
        f"{len(nodes.studs)} holes, {nodes.num_nodes} nodes ({sizes.min()} to {sizes.max()} a "
        f"hole), without any: {without or 'none'}; alternatives {cpu_alternatives:.1f} s, "
        f"travel times {cpu_costs:.1f} s",
        flush=True,
    )
    solve(GtspProblem(1.0 - np.eye(4), np.arange(4)), stop=100, method="heuristic")
    known = {item.stud.id: item.stud.position_m for item in found}
    tip = station.robot.tip_pose(np.asarray(station.home_rad)).translation
    place = np.array([known[s] for s in nodes.studs] + [tip])
    rows, tours = [], {}
    begin = time.process_time()
    tours["order, then poses"] = order_then_poses(problem, place, args.seed)
    used = {"order, then poses": time.process_time() - begin}
    for effort in args.efforts.split(","):
        begin = time.process_time()
        tours[f"gtsp {effort}"] = solve(problem, seed=args.seed, effort=effort).nodes
        used[f"gtsp {effort}"] = time.process_time() - begin
    begin = time.process_time()
    stop = Stop(iterations=WARM * problem.num_clusters)
    warm = solve(problem, stop, args.seed, initial=[tours["order, then poses"]])
    tours["gtsp from that order"] = warm.nodes
    used["gtsp from that order"] = time.process_time() - begin + used["order, then poses"]
    base = problem.tour_cost(tours["order, then poses"])
    for name, tour in tours.items():
        assert problem.faults(tour) == ()
        cost = problem.tour_cost(tour)
        rows.append(
            {
                "method": name,
                "travel_s": round(cost, 3),
                "cpu_s": round(used[name], 2),
                "ratio": round(cost / base, 4),
            }
        )
        print(rows[-1], flush=True)
    best = min(tours, key=lambda name: problem.tour_cost(tours[name]))
    legs = (
        {
            name: certified_legs(problem, nodes, station, world, tours[name], args.legs)
            for name in dict.fromkeys(["order, then poses", best])
        }
        if args.legs
        else {}
    )
    result = {
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "date": date.today().isoformat(),
        "numpy": np.__version__,
        "holes": len(nodes.studs),
        "nodes": nodes.num_nodes,
        "without_alternative": without,
        "alternatives_cpu_s": round(cpu_alternatives, 2),
        "rows": rows,
        "legs": legs,
    }
    args.out.parent.mkdir(exist_ok=True)
    args.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    args.out.with_suffix(".md").write_text(table(result), encoding="utf-8")


def table(result: dict) -> str:
    """The result as a page."""
    lines = [
        f"# {result['holes']} holes by time ({result['machine']}, {result['date']})",
        "",
        f"{result['nodes']} nodes; alternatives in {result['alternatives_cpu_s']} s CPU.",
        "",
        "| method | travel s | CPU s | ratio | cycle with the drilling s |",
        "|---|---|---|---|---|",
    ]
    drilling = DRILL_S * result["holes"]
    lines += [
        f"| {r['method']} | {r['travel_s']} | {r['cpu_s']} | {r['ratio']} "
        f"| {r['travel_s'] + drilling:.1f} |"
        for r in result["rows"]
    ]
    lines += [
        "",
        "| tour | legs planned | certified | their planned time s | their model time s |",
        "|---|---|---|---|---|",
    ]
    for name, legs in result["legs"].items():
        done = [leg for leg in legs if leg["certified"]]
        real, model = (sum(leg[key] for leg in done) for key in ("duration_s", "model_s"))
        lines.append(f"| {name} | {len(legs)} | {len(done)} | {real:.2f} | {model:.2f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
