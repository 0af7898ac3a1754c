"""Distances, yes/no checks and certificates: CPU time a configuration, and who disagrees.

    python -m benchmarks.distances [--stations stud_welding_a,…] [--configurations 2000]

Prints one table a station and saves `results/distances.json` and `.md`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.planning_common import save, table
from dmoc.motion.trajectory import JointTrajectory
from planning.collision.mesh_opinion import MeshOpinion
from planning.collision.world import CollisionWorld
from planning.station.build import demo_station

STATIONS = ("stud_welding_a", "stud_welding_b", "stud_welding_c")
GOALS = {
    "yes/no, one at a time [us]": 25.0,
    "rows at 80 configurations, cap 0.3 m [ms]": 10.0,
    "certificate, 20 intervals [ms]": 10.0,
}


def cpu_s(action: Callable[[], Any], repeats: int = 3) -> float:
    """Smallest CPU time of a few runs [s]."""
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        action()
        spent.append(time.process_time() - begin)
    return min(spent)


def quintic(a: np.ndarray, b: np.ndarray, duration_s: float) -> JointTrajectory:
    """Rest-to-rest motion on the joint-space line, 20 intervals."""
    t = np.linspace(0.0, duration_s, 21)
    s = (t / duration_s)[:, None]
    q = a + (10 * s**3 - 15 * s**4 + 6 * s**5) * (b - a)
    v = (30 * s**2 - 60 * s**3 + 30 * s**4) / duration_s * (b - a)
    return JointTrajectory(t, q, v, np.zeros((20, len(a))))


def measure(name: str, count: int) -> dict[str, Any]:
    """All figures of one station."""
    station = demo_station(name)
    begin = time.process_time()
    world = CollisionWorld(station)
    build = time.process_time() - begin
    robot = station.robot
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (count, robot.num_joints))
    clearance = world.clearance()
    touching = world.collide_batch(q)
    phi = clearance.phi(q)
    near = q[(phi > 0) & (phi < 0.1)][:80]
    clearance.rows(near, 0.3)
    free = q[phi > 0.02]
    motions = [quintic(a, b, 3.0) for a, b in zip(free[0:80:2], free[1:80:2])]
    clearance.certify(motions[0])
    figures: dict[str, Any] = {
        "bodies": len(world.scene.bodies),
        "pieces": len(world.scene.pieces),
        "body pairs": len(world.pairs),
        "piece pairs": len(world.scene.pairs.body),
        "pairs dropped by proof": len(world.never_touching),
        "world built [ms]": 1e3 * build,
        "share touching": float(touching.mean()),
    }
    few = q[: min(count, 500)]
    figures["yes/no, one at a time [us]"] = (
        1e6 * cpu_s(lambda: [world.collide(row) for row in few]) / len(few)
    )
    figures["yes/no, batch [us]"] = 1e6 * cpu_s(lambda: world.collide_batch(q)) / count
    figures["smallest distance, cap 0.3 m [us]"] = (
        1e6 * cpu_s(lambda: clearance.phi(q[~touching])) / int((~touching).sum())
    )
    figures["rows at 80 configurations, cap 0.3 m [ms]"] = 1e3 * cpu_s(
        lambda: clearance.rows(near, 0.3)
    )
    spent, certified = [], 0
    for motion in motions:
        spent.append(1e3 * cpu_s(lambda m=motion: clearance.certify(m), 2))
        certified += clearance.certify(motion).ok
    figures["certificate, 20 intervals [ms]"] = float(np.median(spent))
    figures["certificate, slowest of 40 [ms]"] = float(np.max(spent))
    figures["random motions certified"] = f"{certified}/{len(motions)}"
    figures |= _other_engines(station, world, q, motions)
    return figures


def _other_engines(station: Any, world: CollisionWorld, q: np.ndarray, motions: list) -> dict:
    figures: dict[str, Any] = {}
    few = q[:300]
    truth = world.clearance().phi(few)
    for engine in ("coal", "fcl"):
        other = CollisionWorld(station, engine=engine)
        spent = cpu_s(lambda w=other: w.collide_batch(few), 1)
        figures[f"yes/no by {engine} [us]"] = 1e6 * spent / len(few)
        begin = time.process_time()
        phi = other.clearance().phi(few)
        figures[f"smallest distance by {engine} [us]"] = (
            1e6 * (time.process_time() - begin) / len(few)
        )
        apart = (truth > 0) & (phi > 0)
        gap = np.abs(phi - truth)[apart]
        figures[f"largest difference to {engine} [mm]"] = 1e3 * float(gap.max())
        figures[f"differences to {engine} above 1 mm"] = int((gap > 1e-3).sum())
        figures[f"touching or not: {engine} differs"] = int(((phi > 0) != (truth > 0)).sum())
    judge = CollisionWorld(station, engine="fcl")
    wrong = checked = 0
    clearance = world.clearance()
    for motion in motions:
        if clearance.certify(motion).ok:
            dense = motion.sample(np.arange(0.0, motion.duration_s, 1e-3)).q_rad
            wrong += bool(judge.collide_batch(dense).any())
            checked += 1
    figures["certified motions that fcl finds touching at 1 kHz"] = f"{wrong}/{checked}"
    opinion = MeshOpinion(world)
    figures["largest leak of pieces against meshes [mm]"] = 1e3 * max(
        opinion.leak_m(row, 0.3) for row in few[:100]
    )
    return figures


def main() -> None:
    """Measure, print, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stations", default=",".join(STATIONS))
    parser.add_argument("--configurations", type=int, default=2000)
    options = parser.parse_args()
    results = {name: measure(name, options.configurations) for name in options.stations.split(",")}
    names = list(results)
    keys = list(results[names[0]])
    rows = [[key, *(results[n][key] for n in names), GOALS.get(key, "")] for key in keys]
    text = table(["figure", *names, "goal"], rows)
    print(text)
    save("distances", results, "Distances, checks and certificates", text)


if __name__ == "__main__":
    main()
