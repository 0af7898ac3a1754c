"""CPU and quality of free-time motions: this package beside its peers.

    python benchmarks/ocp.py [--pairs 20] [--reliability 0] [--robots ur10e_class irb6640_class]
        [--peers rockit crocoddyl toppra drake] [--reliability-solver structured]

Random rest-to-rest problems, N = 40, drawn before anything is solved, with |g(q)| ≤ 0.9 u_max at
both ends. For the comparison the acceleration limit is off for everybody; crocoddyl has none, nor
speed limits, so its J may be lower: the last ratio counts only the pairs where its motion keeps all
limits anyway. Ours is shown with the acceleration limit as well, and on twice the grid at fixed
time, where its J is what crocoddyl reaches with its fourth-order steps. "Own solver" is
`SolveParams(solver="structured")` in place of Ipopt, free time. CPU is process time of
the solve alone; J is the cost of the cubic interpolant with the torques that it needs by inverse
dynamics, for everybody alike; ratios are per problem, medians over problems. Peers that are not
installed are left out and named. Results: `benchmarks/results/ocp.md` and `.json`.
"""

import argparse
import datetime
import json
import os
import platform
import sys
import tempfile
import time
from collections import Counter
from importlib import metadata
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("DMOC_BACKEND", "c")

import numpy as np
from ocp_peers import Crocoddyl, Drake, Rockit, Toppra
from published_robots import FILES, published_robot

from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.resimulation import replay_motion
from dmoc.physics.running_cost import trajectory_cost
from dmoc.robot.robot import Robot, load_robot
from dmoc.solving.solver import solve
from dmoc.solving.solvers import DEFAULT_PARAMS, SolveParams

RESULTS = Path(__file__).parent / "results"
PUBLISHED = ("ur10", "panda", "z1")
REPEATS = 3
OWN = SolveParams(solver="structured")
FINER = "dmoc, fixed time, N = 80"


def robot_named(name: str) -> Robot:
    """One of the package, or as example-robot-data publishes it: without rotor inertia."""
    if name not in FILES:
        return load_robot(name)
    return published_robot(name, Path(tempfile.gettempdir()) / "dmoc-published-robots")


def draw_pairs(robot: Robot, count: int, seed: int, span: float = 2.0) -> list[tuple]:
    rng, out = np.random.default_rng(seed), []
    lower, upper = np.maximum(robot.q_lower_rad, -span), np.minimum(robot.q_upper_rad, span)
    while len(out) < count:
        pair = rng.uniform(lower, upper, (2, robot.num_joints))
        if np.all(np.abs(robot.gravity_torque_nm(pair)) <= 0.9 * robot.torque_limit_nm):
            out.append((pair[0], pair[1]))
    return out


def timed(problem: MotionProblem, params: SolveParams = DEFAULT_PARAMS) -> tuple:
    """The motion and the least CPU of a few solves: the machine is shared."""
    spent = []
    for _ in range(REPEATS):
        start = time.process_time()
        motion = solve(problem, params)
        spent.append(time.process_time() - start)
    return motion, min(spent)


def compare(name: str, count: int, peers: list) -> dict:
    robot = robot_named(name)
    free = robot.with_limits(acceleration_limit_rad_s2=1e3)
    pairs = draw_pairs(robot, count, seed=7)
    cost = Cost()
    limited = [MotionProblem(robot, *pair) for pair in pairs]
    problems = [MotionProblem(free, *pair) for pair in pairs]
    for params in (SolveParams(), OWN):
        solve(limited[0], params), solve(problems[0], params)
    rows = {
        "with acceleration limits": [timed(problem) for problem in limited],
        "with acceleration limits, own solver": [timed(problem, OWN) for problem in limited],
        "dmoc, own solver": [timed(problem, OWN) for problem in problems],
    }
    ours = [timed(problem) for problem in problems]
    fixed = [timed(p.replace(duration_s=m.duration_s)) for p, (m, _) in zip(problems, ours)]
    finer = [
        timed(p.replace(duration_s=m.duration_s, num_intervals=80))
        for p, (m, _) in zip(problems, ours)
    ]
    rows |= {"dmoc, free time": ours, "dmoc, fixed time": fixed, FINER: finer}
    report = {}
    for label, results in rows.items():
        report[label] = summary(
            [(m.trajectory if m.status.ok else None, cpu) for m, cpu in results],
            free,
            cost,
            problems,
        )
        report[label]["replay_mrad"] = 1e3 * float(
            np.median([replay_motion(m).replay_error_rad for m, _ in results])
        )
    for kind in peers:
        peer = kind(free, cost, 40)
        results, base = [], ours if kind.free_time else fixed
        if kind.most_pairs is None:  # warm-up
            peer.solve(problems[0], *(() if kind.free_time else (ours[0][0].duration_s,)))
        for problem, (motion, _) in list(zip(problems, ours))[: kind.most_pairs]:
            extra = () if kind.free_time else (motion.duration_s,)
            results.append(peer.solve(problem, *extra))
        entry = summary(results, free, cost, problems)
        ok = [i for i, (t, _) in enumerate(results) if t is not None]
        entry["cpu_ratio_to_dmoc"] = float(np.median([results[i][1] / base[i][1] for i in ok]))
        worth = {
            i: trajectory_cost(results[i][0], free, cost)
            / trajectory_cost(base[i][0].trajectory, free, cost)
            for i in ok
        }
        entry["cost_ratio_to_dmoc"] = float(np.median(list(worth.values())))
        if not kind.free_time:
            entry["cpu_ratio_to_finer"] = float(
                np.median([results[i][1] / finer[i][1] for i in ok])
            )
        legal = [i for i in ok if is_legal(results[i][0], free)]
        entry["within_limits"], entry["pairs"] = len(legal), len(results)
        if legal:
            entry["cost_ratio_within_limits"] = float(np.median([worth[i] for i in legal]))
        if legal and not kind.free_time:
            entry["cost_ratio_to_finer"] = float(
                np.median(
                    [
                        trajectory_cost(results[i][0], free, cost)
                        / trajectory_cost(finer[i][0].trajectory, free, cost)
                        for i in legal
                    ]
                )
            )
        report[peer.name] = entry
    return report


def is_legal(trajectory: JointTrajectory, robot: Robot) -> bool:
    """Whether the curve keeps the limits of position, speed and torque, to 1 % of speed and torque:
    then a peer without such limits solved the same problem as one with them."""
    curve = trajectory.sample(np.linspace(0.0, trajectory.duration_s, 2001))
    low, high = robot.q_lower_rad - 1e-3, robot.q_upper_rad + 1e-3
    return bool(
        np.all((curve.q_rad >= low) & (curve.q_rad <= high))
        and np.all(np.abs(curve.velocity_rad_s) <= 1.01 * robot.velocity_limit_rad_s)
        and np.all(np.abs(curve.torque_nm) <= 1.01 * robot.torque_limit_nm)
    )


def summary(results: list, robot: Robot, cost: Cost, problems: list) -> dict:
    ok = [(t, p) for (t, _), p in zip(results, problems) if t is not None]
    return {
        "cpu_ms_median": 1e3 * float(np.median([cpu for _, cpu in results])),
        "cpu_ms_worst": 1e3 * float(max(cpu for _, cpu in results)),
        "cost_median": float(np.median([trajectory_cost(t, robot, cost) for t, _ in ok])),
        "end_error_mrad": 1e3 * float(max(np.abs(t.q_rad[-1] - p.goal_rad).max() for t, p in ok)),
        "failed": len(results) - len(ok),
    }


def reliability(name: str, count: int, params: SolveParams) -> dict:
    robot = robot_named(name)
    statuses, cpu, iterations, defects = Counter(), [], [], []
    for pair in draw_pairs(robot, count, seed=1000):
        start = time.process_time()
        motion = solve(MotionProblem(robot, *pair), params)
        cpu.append(time.process_time() - start)
        statuses[motion.status.value] += 1
        iterations.append(motion.iterations)
        defects.append(motion.max_defect)
    return {
        "pairs": count,
        "statuses": dict(statuses),
        "cpu_ms_median": 1e3 * float(np.median(cpu)),
        "cpu_ms_p99": 1e3 * float(np.percentile(cpu, 99)),
        "iterations_median": float(np.median(iterations)),
        "iterations_worst": max(iterations),
        "largest_defect": max(defects),
    }


def installed(kinds: list) -> tuple[list, list]:
    found, missing = [], []
    for kind, module in kinds:
        try:
            __import__(module)
            found.append(kind)
        except ImportError:
            missing.append(module)
    return found, missing


def first_result_seconds(name: str) -> float:
    """Wall clock of a fresh process with an empty cache, import to the first motion."""
    import subprocess

    robot = robot_named(name).urdf if name in FILES else name
    code = (
        "import time; t=time.perf_counter(); import dmoc, numpy as np\n"
        f"r=dmoc.load_robot('{robot}'); z=(r.q_lower_rad+r.q_upper_rad)/2\n"
        "m=dmoc.solve(dmoc.MotionProblem(r, z-0.3, z+0.3)); assert m.status.ok\n"
        "print(time.perf_counter()-t)"
    )
    with tempfile.TemporaryDirectory() as folder:
        env = os.environ | {"DMOC_CACHE": folder, "DMOC_BACKEND": "auto"}
        done = subprocess.run(
            [sys.executable, "-c", code], env=env, check=True, capture_output=True, text=True
        )
    return float(done.stdout)


def table(report: dict) -> str:
    lines = [
        "| tool | CPU ms (worst) | CPU / dmoc | J median | J / dmoc | within limits: J / dmoc "
        "(pairs) | end mrad | failed |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for label, row in report.items():
        cpu, worth = row.get("cpu_ratio_to_dmoc"), row.get("cost_ratio_to_dmoc")
        fair = row.get("cost_ratio_within_limits")
        lines.append(
            f"| {label} | {row['cpu_ms_median']:.1f} ({row['cpu_ms_worst']:.1f}) "
            f"| {'' if cpu is None else f'{cpu:.1f}'} | {row['cost_median']:.4f} "
            f"| {'' if worth is None else f'{worth:.4f}'} "
            f"| {'' if fair is None else f'{fair:.4f}'} "
            f"{'' if worth is None else '(' + str(row['within_limits']) + ')'} "
            f"| {row['end_error_mrad']:.3f} "
            f"| {row['failed']} |"
        )
    for label, row in report.items():
        if "cpu_ratio_to_finer" in row:
            line = f"{label} beside ours on N = 80: {row['cpu_ratio_to_finer']:.1f} times the CPU"
            if "cost_ratio_to_finer" in row:
                line += f", J {row['cost_ratio_to_finer']:.4f} of ours within limits"
            lines += ["", line + "."]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--reliability", type=int, default=0)
    parser.add_argument("--robots", nargs="+", default=["ur10e_class", "irb6640_class", *PUBLISHED])
    parser.add_argument("--reliability-robots", nargs="+", default=None)
    parser.add_argument("--peers", nargs="+", default=["rockit", "crocoddyl", "toppra", "drake"])
    parser.add_argument("--reliability-solver", default="ipopt", choices=["ipopt", "structured"])
    parser.add_argument("--name", default="ocp")
    options = parser.parse_args()
    kinds = {"rockit": Rockit, "crocoddyl": Crocoddyl, "toppra": Toppra, "drake": Drake}
    modules = {"drake": "pydrake"}
    peers, missing = installed([(kinds[name], modules.get(name, name)) for name in options.peers])
    versions = {}
    for package in ("casadi", "pin", "numpy", "rockit-meco", "crocoddyl", "toppra", "drake"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    data = {
        "date": datetime.date.today().isoformat(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": versions,
        "missing": missing,
        "comparison": {},
        "reliability": {},
        "first_result_s": {},
    }
    text = [
        "# Optimal control beside its peers",
        "",
        __doc__.split("\n\n")[2],
        "",
        f"{data['date']}, {data['cores']} cores, Python {data['python']}, "
        + ", ".join(f"{k} {v}" for k, v in versions.items())
        + (f"; not installed: {', '.join(missing)}" if missing else ""),
        "",
    ]
    for name in options.robots if options.pairs else []:
        report = compare(name, options.pairs, peers)
        data["comparison"][name] = report
        data["first_result_s"][name] = first_result_seconds(name)
        text += [
            f"## {name}, {options.pairs} problems",
            "",
            table(report),
            "",
            f"Fresh process, empty cache, import to first motion: "
            f"{data['first_result_s'][name]:.2f} s wall.",
            "",
        ]
    for name in (options.reliability_robots or options.robots) if options.reliability else []:
        found = reliability(
            name, options.reliability, SolveParams(solver=options.reliability_solver)
        )
        data["reliability"][name] = found
        text += [f"## Reliability, {name}, {options.reliability_solver}", "", f"{found}", ""]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{options.name}.json").write_text(json.dumps(data, indent=1) + "\n")
    (RESULTS / f"{options.name}.md").write_text("\n".join(text))
    print("\n".join(text))


if __name__ == "__main__":
    main()
