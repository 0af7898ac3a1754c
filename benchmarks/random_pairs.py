"""Random pairs of weld poses in three stations: certified or not, and does fcl agree at 1 kHz.

    python -m benchmarks.random_pairs [--pairs 500] [--stations stud_welding_a,…]
        [--quality screen | final]

Two different studs, one alternative each, all drawn with a fixed seed; the motion between them as
the product plans it when it ranks edges (departure lines, obstacle-free optimum first), or, with
`--quality final`, as it plans those of a chosen sequence, from the ranked one. A motion
with a certificate is then sampled at 1 kHz and checked by fcl; its proven clearance must not exceed
what fcl measures at those samples. Edges whose straight joint-space line (from the end of one
departure line to the end of the other) touches nothing are timed apart from the others. Saves
`results/random_pairs.json` and `.md` (or `random_pairs_final`); with `--stations` the rows of the
other stations stay.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.planning_common import merged, save, table
from planning.collision.world import CollisionWorld
from planning.station.build import demo_station
from planning.welds.alternatives_search import alternatives
from sequencing.edges.store import encode_motion
from sequencing.edges.worker import EdgeJob, Quality, edge_motion, weld_line

STATIONS = ("stud_welding_a", "stud_welding_b", "stud_welding_c")


def run(name: str, count: int, quality: Quality) -> dict[str, Any]:
    """Figures of one station."""
    station = demo_station(name)
    world, judge = CollisionWorld(station), CollisionWorld(station, engine="fcl")
    studs = {stud.id: stud for stud in station.studs}
    welds = [found for found in alternatives(station, world) if found.alternatives]
    rng = np.random.default_rng(0)
    outcome: Counter[str] = Counter()
    spent: dict[bool, list[float]] = {True: [], False: []}
    touching, failed, overstated, kept = [], [], [], []
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for number in range(count):
        ends = [welds[i] for i in rng.choice(len(welds), 2, replace=False)]
        chosen = [end.alternatives[rng.integers(len(end.alternatives))] for end in ends]
        poses = [alternative.q_rad for alternative in chosen]
        ids = [end.stud if isinstance(end.stud, str) else end.stud.id for end in ends]
        job = EdgeJob(
            context="",
            key="",
            origin=ids[0],
            target=ids[1],
            start_rad=tuple(poses[0]),
            goal_rad=tuple(poses[1]),
            quality="screen",
            method="halfspaces",
            seed=number,
        )
        if quality == "final":
            screened = edge_motion(station, world, studs, job)
            job = replace(job, quality="final", screened=encode_motion(screened))
        begin = time.process_time()
        motion = edge_motion(station, world, studs, job)
        cpu = time.process_time() - begin
        first, last = (alternative.line_rad[-1] for alternative in chosen)
        is_free = not world.collide_batch((1 - share) * first + share * last).any()
        spent[is_free].append(cpu)
        outcome[motion.source if motion.certified else "not certified"] += 1
        if not motion.certified:
            failed.append(f"{ids[0]} to {ids[1]}: {motion.status} {motion.note}")
            continue
        lines = [weld_line(station, studs[i]) for i in ids if studs[i].on]
        dense = motion.trajectory.sample(np.arange(0.0, motion.duration_s, 1e-3)).q_rad
        if judge.collide_batch(dense, 0.0, lines).any():
            touching.append(f"{ids[0]} to {ids[1]}")
        nearest = int(np.argmin(world.clearance(*lines).phi(dense)))
        least = judge.distance(dense[nearest], 0.3, lines)[0]
        kept.append(motion.proven_clearance_m)
        if motion.proven_clearance_m > least + 5e-5:  # what fcl is off by on these shapes
            overstated.append(f"{ids[0]} to {ids[1]}")
    both = spent[True] + spent[False]
    return {
        "station": name,
        "pairs": count,
        "refined and certified": outcome["refined"],
        "certified fallback": outcome["fallback"],
        "not certified": outcome["not certified"],
        "touching for fcl at 1 kHz": len(touching),
        "nearer for fcl than proven": len(overstated),
        "proven clearance, median [mm]": 1e3 * float(np.median(kept)),
        "demanded [mm]": 1e3 * world.clearance_m,
        "proven to keep it": sum(k >= world.clearance_m * (1 - 1e-9) for k in kept),
        "least proven [mm]": 1e3 * min(kept),
        "CPU, median [s]": float(np.median(both)),
        "CPU, p90 [s]": float(np.percentile(both, 90)),
        "lines free": len(spent[True]),
        "CPU of these, median [s]": _median(spent[True]),
        "lines that hit": len(spent[False]),
        "CPU of those, median [s]": _median(spent[False]),
        "failed": failed,
        "touching": touching,
        "overstated": overstated,
    }


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def main() -> None:
    """Run the stations, print, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=500)
    parser.add_argument("--stations", default=",".join(STATIONS))
    parser.add_argument("--quality", choices=("screen", "final"), default="screen")
    options = parser.parse_args()
    names = options.stations.split(",")
    shares = [options.pairs // len(names)] * len(names)
    shares[0] += options.pairs - sum(shares)
    results = [run(name, count, options.quality) for name, count in zip(names, shares)]
    file = "random_pairs" if options.quality == "screen" else "random_pairs_final"
    if len(names) < len(STATIONS):
        results = merged(file, "station", results)
    shown = [key for key in results[-1] if key not in ("failed", "touching", "overstated")]
    text = table(shown, [[figures.get(key, "") for key in shown] for figures in results])
    for figures in results:
        for line in figures["failed"]:
            text += f"\n\n{figures['station']}: {line}"
    print(text)
    save(file, results, "Random pairs of weld poses, certified", text)


if __name__ == "__main__":
    main()
