"""Station-like GTSP instances: many alternatives a weld, asymmetric costs, a home position.

The cluster sizes are those of Table 1 of Björkenstam et al. (M = 20, 307 alternatives), repeated
for larger M. A node is a joint vector; the cost of a travel is the time of the slowest joint
(bang-bang with a speed limit) plus an effort that is larger against gravity, in whole
thousandths, so that a proof does not depend on rounding.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from sequencing.gtsp import GtspProblem

TABLE_1 = (6, 8, 16, 22, 27, 18, 10, 16, 20, 30, 16, 36, 16, 13, 16, 9, 9, 7, 6, 6)
FOLDER = Path(__file__).parent
SPEED_RAD_S = np.array([2.2, 2.0, 2.2, 3.2, 3.2, 3.6])
ACCELERATION_RAD_S2 = np.array([8.0, 7.0, 9.0, 18.0, 18.0, 24.0])
KINDS = ("branches", "scattered")


def random_nodes(clusters: int, seed: int, kind: str = "branches") -> tuple[np.ndarray, np.ndarray]:
    """Joint vectors (V, 6) and cluster of each node; node 0 is home, alone in cluster 0.

    branches   studs on a curved panel; arm, elbow and wrist branches, and steps of tool spin.
    scattered  alternatives drawn around the stud with little structure: harder.
    """
    rng = np.random.default_rng([seed, clusters])
    sizes = [TABLE_1[k % len(TABLE_1)] for k in range(clusters)]
    rows = [np.array([0.0, -1.2, 1.4, 0.0, 0.8, 0.0])]
    labels = [0]
    for g, size in enumerate(sizes, start=1):
        u, v = rng.uniform(-1, 1, 2)
        stud = np.array([0.9 * u, -0.4 + 0.5 * v, 0.9 - 0.6 * v, 0.3 * u, 0.6, 0.2 * v])
        spins = rng.permutation(12)
        for k in range(size):
            q = stud.copy()
            if kind == "scattered":
                q += rng.normal(0.0, [0.35, 0.3, 0.4, 1.0, 0.5, 1.6])
            else:
                elbow, wrist = (k // 12) % 2, (k // 6) % 2
                q += [0.0, 0.5 * elbow, -0.9 * elbow, 0.6 * elbow, 0.0, 0.0]
                if wrist:
                    q[3:5] = q[3] - np.pi * np.sign(q[3]), -q[4]
                q[5] += (spins[k % 12] - 5.5) * np.pi / 6
                q += rng.normal(0.0, 0.05, 6)
            rows.append(q)
            labels.append(g)
    return np.round(np.array(rows), 5), np.array(labels)


def travel_costs(joints_rad: np.ndarray) -> np.ndarray:
    """(V, V) whole thousandths: slowest joint's time, plus an effort that dislikes lifting."""
    delta = joints_rad[None, :, :] - joints_rad[:, None, :]
    way = np.abs(delta)
    short = way < SPEED_RAD_S**2 / ACCELERATION_RAD_S2
    time = np.where(
        short,
        2 * np.sqrt(way / ACCELERATION_RAD_S2),
        way / SPEED_RAD_S + SPEED_RAD_S / ACCELERATION_RAD_S2,
    ).max(axis=2)
    lift = np.maximum(0.0, -delta[:, :, 1]) * 0.35 + np.maximum(0.0, delta[:, :, 2]) * 0.15
    effort = 0.08 * (delta[:, :, :3] ** 2).sum(axis=2)
    return np.round(1000.0 * (time + lift + effort))


def station_like(clusters: int, seed: int, kind: str = "branches") -> GtspProblem:
    """A generated instance with `clusters` welds and a home."""
    joints, labels = random_nodes(clusters, seed, kind)
    name = f"station{clusters}-{kind}-{seed}"
    return GtspProblem(travel_costs(joints), labels, home=0, name=name)


def save(clusters: int, seed: int, kind: str, folder: Path = FOLDER) -> Path:
    """Write the nodes of an instance as CSV: cluster, then six joint angles in rad."""
    joints, labels = random_nodes(clusters, seed, kind)
    path = folder / f"station{clusters}-{kind}-{seed}.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["cluster", *(f"q{j}_rad" for j in range(1, 7))])
        for label, row in zip(labels, joints):
            writer.writerow([label, *(f"{x:.5f}" for x in row)])
    return path


def load(path: Path) -> GtspProblem:
    """The instance of a saved file."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    labels = table[:, 0].astype(int)
    return GtspProblem(travel_costs(table[:, 1:]), labels, home=0, name=path.stem)


def proven_optima() -> dict[str, int]:
    """Optimum of each saved instance, proven by bounded dynamic programming."""
    return json.loads((FOLDER / "optima.json").read_text(encoding="utf-8"))
