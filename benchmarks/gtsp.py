"""The sequencer against its peers: gap and CPU seconds on GTSPLIB and station-like instances.

    python -m benchmarks.gtsp [--seeds 5] [--peers | --proofs | --methods] [--only M60,station]

GTSPLIB instances are read from DMOC_DATA/gtsplib (default ../shared/data/gtsplib). Peers that are
not installed are left out. CPU seconds are process time of this machine; compare ratios.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import platform
import resource
import statistics
import sys
import time
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from benchmarks import gtsp_peers, station_like
from sequencing.gtsp import GtspProblem, Stop, held_karp_memory_bytes, read_gtsplib, solve

RESULTS = Path(__file__).parent / "results"
DATA = Path(os.environ.get("DMOC_DATA", Path(__file__).parents[2] / "shared" / "data")) / "gtsplib"


def gtsplib() -> list[tuple[str, float, GtspProblem]]:
    """(group, best known, problem) of the data folder."""
    table = DATA / "best_known.csv"
    if not table.exists():
        print(f"no GTSPLIB data at {DATA}: set DMOC_DATA", file=sys.stderr)
        return []
    out = []
    for row in csv.DictReader(table.open(encoding="utf-8")):
        m = int(row["clusters"])
        group = "M60" if m <= 60 else "M120" if m <= 120 else "M220"
        problem = read_gtsplib(DATA / f"{row['instance']}.gtsp")
        out.append((group, float(row["best_known"]), problem))
    return out


def stations() -> list[tuple[str, float, GtspProblem]]:
    """The saved station-like instances with their proven optima."""
    optima = station_like.proven_optima()
    return [
        ("station", float(best), station_like.load(station_like.FOLDER / f"{name}.csv"))
        for name, best in optima.items()
    ]


def heuristic(instances: list, seeds: int, effort: str) -> list[dict]:
    """Gap and CPU of the default heuristic."""
    rows = []
    for group, best, problem in instances:
        gaps, cpu = [], []
        for seed in range(seeds):
            begin = time.process_time()
            tour = solve(problem, seed=seed, method="heuristic", effort=effort)
            cpu.append(time.process_time() - begin)
            gaps.append(100 * (tour.cost / best - 1))
        rows.append(
            {
                "group": group,
                "instance": problem.name,
                "gap_percent": statistics.mean(gaps),
                "worst_percent": max(gaps),
                "optimal": sum(gap <= 1e-9 for gap in gaps),
                "seeds": seeds,
                "cpu_s": statistics.mean(cpu),
            }
        )
        print(show(rows[-1]), flush=True)
    return rows


def peers(instances: list, seconds: float) -> list[dict]:
    """Gap and CPU of each installed peer, one run an instance."""
    rows = []
    for group, best, problem in instances:
        for name, run in gtsp_peers.installed().items():
            begin = time.process_time()
            cost = run(problem, seconds)
            used = time.process_time() - begin
            gap = None if cost is None else 100 * (cost / best - 1)
            rows.append(
                {
                    "group": group,
                    "instance": problem.name,
                    "peer": name,
                    "gap_percent": gap,
                    "cpu_s": used,
                }
            )
            print(show(rows[-1]), flush=True)
    return rows


def methods(instances: list, seeds: int) -> list[dict]:
    """The heuristic's parts on the same CPU budget: that of the default for given iterations."""
    rows = []
    for group, best, problem in instances:
        for iterations in (100 * problem.num_clusters, 1000 * problem.num_clusters):
            target = timed(problem, "heuristic", iterations, 0)[1]
            for method in ("heuristic", "ruin-recreate"):
                fit = max(2000, iterations)
                for _ in range(3):
                    fit = int(fit * target / max(timed(problem, method, fit, 0)[1], 1e-4)) + 1000
                runs = [timed(problem, method, fit, seed) for seed in range(1, seeds + 1)]
                rows.append(
                    {
                        "group": f"{group}, {iterations // problem.num_clusters} M iterations",
                        "instance": problem.name,
                        "method": method,
                        "gap_percent": statistics.mean(100 * (cost / best - 1) for cost, _ in runs),
                        "cpu_s": statistics.mean(cpu for _, cpu in runs),
                    }
                )
                print(show(rows[-1]), flush=True)
    return rows


def timed(problem: GtspProblem, method: str, iterations: int, seed: int) -> tuple[float, float]:
    """(cost, CPU seconds) of one run."""
    begin = time.process_time()
    tour = solve(problem, iterations, seed, method=method)
    return tour.cost, time.process_time() - begin


def proofs(instances: list) -> list[dict]:
    """CPU and bound of the exact method where M ≤ 41."""
    rows = []
    for group, best, problem in instances:
        if problem.num_clusters > 41:
            continue
        begin = time.process_time()
        tour = solve(problem, method="exact")
        rows.append(
            {
                "group": group,
                "instance": problem.name,
                "proven": tour.proven,
                "gap_percent": 100 * (tour.cost / best - 1),
                "bound_percent": 100 * tour.lower_bound / tour.cost,
                "cpu_s": time.process_time() - begin,
                "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
            }
        )
        print(show(rows[-1]), flush=True)
    return rows


def held_karp() -> list[dict]:
    """The paper's exact algorithm at its limit, M = 20: the median of three runs.

    The first one pays for memory that the process never had before (its system time).
    """
    problem = station_like.station_like(20, 1)
    warm = station_like.station_like(6, 1)
    solve(warm, method="held-karp")
    used = []
    for _ in range(3):
        begin = time.process_time()
        tour = solve(problem, Stop(iterations=20_000), method="held-karp")
        used.append(time.process_time() - begin)
    return [
        {
            "group": "held-karp",
            "instance": problem.name,
            "proven": tour.proven,
            "cpu_s": statistics.median(used),
            "first_cpu_s": used[0],
            "table_gb": held_karp_memory_bytes(problem) / 2**30,
        }
    ]


def show(row: dict) -> str:
    """One line of the table."""
    parts = [f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()]
    return "  ".join(parts)


def summary(rows: list[dict], key: str) -> list[dict]:
    """Mean gap and CPU by group (and peer)."""
    names = sorted({(row["group"], row.get(key, "")) for row in rows})
    out = []
    for group, name in names:
        part = [r for r in rows if r["group"] == group and r.get(key, "") == name]
        found = [r["gap_percent"] for r in part if r["gap_percent"] is not None]
        out.append(
            {
                "group": group,
                "solver": name or "sequencing.gtsp",
                "instances": len(part),
                "gap_percent": statistics.mean(found) if found else None,
                "cpu_s": statistics.mean(r["cpu_s"] for r in part),
            }
        )
    return out


def table(result: dict) -> str:
    """The summaries and the proofs as a page."""
    lines = [f"# The sequencer ({result['machine']}, {result['date']})", ""]
    lines += [f"- {name} {number}" for name, number in result["versions"].items()]
    lines += [f"- {note}" for note in result.get("notes", [])]
    for title in ("heuristic", "methods", "peers"):
        if title in result:
            lines += [
                "",
                f"## {title}",
                "",
                "| group | solver | instances | gap % | CPU s |",
                "|---|---|---|---|---|",
            ]
            for r in result[title]["summary"]:
                gap = "none found" if r["gap_percent"] is None else f"{r['gap_percent']:.4f}"
                lines.append(
                    f"| {r['group']} | {r['solver']} | {r['instances']} | {gap} "
                    f"| {r['cpu_s']:.2f} |"
                )
    if "proofs" in result:
        lines += [
            "",
            "## proofs",
            "",
            "| instance | proven | bound, % of cost | CPU s |",
            "|---|---|---|---|",
        ]
        lines += [
            f"| {r['instance']} | {r['proven']} | {r['bound_percent']:.2f} | {r['cpu_s']:.2f} |"
            for r in result["proofs"]
        ]
    for r in result.get("held_karp", []):
        lines.append(
            f"\nHeld–Karp, {r['instance']}: {r['cpu_s']:.2f} s CPU "
            f"({r['first_cpu_s']:.2f} s the first time), {r['table_gb']:.2f} GiB."
        )
    return "\n".join(lines) + "\n"


def installed_version(name: str) -> str:
    """Version of a distribution, or that it is absent."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--effort", default="normal")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--proofs", action="store_true")
    parser.add_argument("--methods", action="store_true")
    parser.add_argument("--seconds", type=float, default=3.0, help="for each peer")
    parser.add_argument("--only", default="M60,M120,M220,station")
    parser.add_argument("--out", type=Path, default=RESULTS / "gtsp.json")
    args = parser.parse_args()
    solve(GtspProblem(1.0 - np.eye(4), np.arange(4)), stop=100, method="heuristic")
    solve(station_like.station_like(4, 1), method="exact")
    groups = args.only.split(",")
    instances = [i for i in gtsplib() + stations() if i[0] in groups]
    result: dict = {}
    if args.out.exists():
        result = json.loads(args.out.read_text(encoding="utf-8"))
    result["machine"] = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    result["date"] = date.today().isoformat()
    packages = ("numba", "numpy", "pyvrp", "ortools", "elkai")
    result["versions"] = {name: installed_version(name) for name in packages}
    if args.peers:
        rows = peers(instances, args.seconds)
        result["peers"] = {"summary": summary(rows, "peer"), "rows": rows}
    elif args.methods:
        rows = methods(instances, args.seeds)
        result["methods"] = {"summary": summary(rows, "method"), "rows": rows}
        for line in result["methods"]["summary"]:
            print(show(line))
    elif args.proofs:
        result["held_karp"] = held_karp()
        result["proofs"] = proofs(instances)
    else:
        rows = heuristic(instances, args.seeds, args.effort)
        old = result.get("heuristic", {}).get("rows", [])
        rows = [r for r in old if r["group"] not in groups] + rows
        result["heuristic"] = {"summary": summary(rows, "solver"), "rows": rows}
        for line in result["heuristic"]["summary"]:
            print(show(line))
    args.out.parent.mkdir(exist_ok=True)
    args.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    args.out.with_suffix(".md").write_text(table(result), encoding="utf-8")


if __name__ == "__main__":
    main()
