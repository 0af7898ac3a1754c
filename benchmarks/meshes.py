"""Obstacles of many triangles: from the file to a certified motion through their opening.

    python -m benchmarks.meshes [--triangles 20000,60000,200000] [--motions 4]

The obstacle is a rough ring of rounded corners that stands in front of an arm (ur10e_class), drawn
with a fixed seed and written as STL. Measured: reading, cutting into convex pieces, the check that
they cover the mesh (20,000 points of its surface), the second run from the cache; then motions from
beside the ring to behind it, through the opening, planned, refined (N = 20, 2 cm asked) and
certified, and every 10 ms compared with coal on the triangles themselves. Saves
`results/meshes.json` and `.md`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planning_common import save, table
from dmoc.motion.motion import MotionProblem
from dmoc.robot.robot import load_robot
from planning.collision.mesh_opinion import MeshOpinion
from planning.collision.world import CollisionWorld, world_for
from planning.geometry.convex import cover_gap_m, sample_surface
from planning.geometry.decompose import cached_pieces, mesh_pieces
from planning.geometry.mesh import Mesh, load_mesh
from planning.geometry.shapes import Body, Shape, pose_matrix
from planning.path.edge_motion import plan_motion
from planning.path.rrt_connect import plan_path

PLACE_M = np.array([0.72, 0.0, 0.45])
HALF_M = (0.32, 0.27)
TUBE_M = 0.05
CLEARANCE_M = 0.02


def rough_ring(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) [m] and faces of about `count` triangles: a closed tube along a rounded
    rectangle in the y–z plane, its radius wavy by millimetres and noisy by tenths.
    """
    across = int(np.sqrt(count / 8))
    along = count // (2 * across)
    u = np.linspace(0, 2 * np.pi, along, endpoint=False)
    v = np.linspace(0, 2 * np.pi, across, endpoint=False)
    r = (np.cos(u) ** 4 + np.sin(u) ** 4) ** -0.25
    centre = np.stack([0 * u, HALF_M[0] * r * np.cos(u), HALF_M[1] * r * np.sin(u)], axis=1)
    outwards = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    rng = np.random.default_rng(seed)
    radius = TUBE_M + 2e-4 * rng.normal(size=(along, across))
    for _ in range(12):
        waves, phase = rng.integers(1, 30, 2), rng.uniform(0, 2 * np.pi, 2)
        radius += (
            2e-3
            * rng.normal()
            * np.outer(np.sin(waves[0] * u + phase[0]), np.cos(waves[1] * v + phase[1]))
        )
    ring = np.cos(v)[:, None] * outwards[:, None] + np.sin(v)[:, None] * np.array([1.0, 0, 0])
    points = centre[:, None] + radius[..., None] * ring
    i, k = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    here, right = i * across + k, i * across + (k + 1) % across
    ahead = (i + 1) % along * across + k
    both = (i + 1) % along * across + (k + 1) % across
    faces = np.concatenate(
        [np.stack([here, right, ahead], axis=-1), np.stack([ahead, right, both], axis=-1)]
    )
    return points.reshape(-1, 3), faces.reshape(-1, 3)


def write_stl(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A binary STL in millimetres."""
    record = np.zeros(
        len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]
    )
    record["corners"] = 1e3 * vertices[faces]
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + record.tobytes())


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Result and CPU seconds."""
    begin = time.process_time()
    result = function()
    return result, time.process_time() - begin


def ends(world: CollisionWorld, count: int) -> np.ndarray:
    """Configurations (count, 2, n): the flange beside the ring, and behind its opening."""
    robot = world.robot
    q = np.random.default_rng(1).uniform(
        robot.q_lower_rad, robot.q_upper_rad, (400_000, robot.num_joints)
    )
    tip = world.tip_positions(q) - PLACE_M
    behind = (np.abs(tip[:, 1:]) < 0.12).all(axis=1) & (tip[:, 0] > 0.08) & (tip[:, 0] < 0.25)
    beside = (np.abs(tip[:, 1]) > 0.5) & (np.abs(tip[:, 0]) < 0.3) & (np.abs(tip[:, 2]) < 0.4)
    chosen = []
    for part in (beside, behind):
        free = q[part][~world.collide_batch(q[part], CLEARANCE_M)]
        chosen.append(free[:count])
    least = min(map(len, chosen))
    return np.stack([part[:least] for part in chosen], axis=1)


def motions(world: CollisionWorld, count: int) -> dict[str, Any]:
    """Figures of planned, refined and judged motions."""
    clearance, opinion = world.clearance(), MeshOpinion(world)
    plan_s, motion_s, least, kept = [], [], [], []
    certified = touching = 0
    pairs = ends(world, count)
    for k, (start, goal) in enumerate(pairs):
        path, spent = timed(lambda a=start, b=goal, k=k: plan_path(world, a, b, seed=k))
        plan_s.append(spent)
        if path.path is None:
            continue
        problem = MotionProblem(world.robot, start, goal, num_intervals=20)
        motion, spent = timed(
            lambda p=problem, k=k: plan_motion(p, clearance, world, seed=k, quality="final")
        )
        motion_s.append(spent)
        if not motion.certified:
            continue
        certified += 1
        kept.append(motion.proven_clearance_m)
        times = np.arange(0.0, motion.duration_s, 0.01)
        near = [
            min(opinion.distances(q, 0.1).values(), default=0.1)
            for q in motion.trajectory.sample(times).q_rad
        ]
        least.append(min(near))
        touching += min(near) <= 0.0
    return {
        "motions through the opening": len(pairs),
        "paths found": len(motion_s),
        "certified": certified,
        "plan, median [ms]": 1e3 * float(np.median(plan_s)),
        "final motion, median [s]": float(np.median(motion_s)),
        "asked [mm]": 1e3 * CLEARANCE_M,
        "least proven [mm]": 1e3 * min(kept, default=np.nan),
        "least to the triangles by coal [mm]": 1e3 * min(least, default=np.nan),
        "touching for coal": touching,
    }


def run(count: int, motions_wanted: int) -> dict[str, Any]:
    """Figures of one mesh."""
    robot = load_robot("ur10e_class")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_stl(folder / "ring.stl", *rough_ring(count))
        mesh, read_s = timed(lambda: load_mesh("ring.stl", folder, "mm"))
        pieces, cut_s = timed(lambda: mesh_pieces(mesh))
        cached_pieces(mesh)
        again, cached_s = timed(lambda: cached_pieces(mesh))
        same = all(np.array_equal(a.vertices_m, b.vertices_m) for a, b in zip(pieces, again))
        gap, cover_s = timed(lambda: cover_gap_m(pieces, sample_surface(mesh, 20_000, seed=0)))
        world, built_s = timed(lambda: world_for(robot, (), (_body(mesh, pieces),)))
        return {
            "triangles": len(mesh.faces),
            "watertight": mesh.watertight,
            "read [s]": read_s,
            "cut into pieces [s]": cut_s,
            "pieces": len(pieces),
            "cover check [s]": cover_s,
            "largest gap [mm]": 1e3 * float(gap.max()),
            "pieces from the cache [s]": cached_s,
            "the same pieces": same,
            "world built [s]": built_s,
            **motions(world, motions_wanted),
        }


def _body(mesh: Mesh, pieces: tuple[Shape, ...]) -> Body:
    shape = Shape("mesh", vertices_m=mesh.vertices_m, faces=mesh.faces)
    return Body("ring", pieces, mesh=shape, pose=pose_matrix(PLACE_M))


def main() -> None:
    """Measure, print, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triangles", default="20000,60000,200000")
    parser.add_argument("--motions", type=int, default=4)
    options = parser.parse_args()
    world_for(load_robot("ur10e_class")).clearance()
    rows = [run(int(count), options.motions) for count in options.triangles.split(",")]
    names = list(rows[0])
    text = table(
        ["figure", *(str(row["triangles"]) for row in rows)],
        [[name, *(row[name] for row in rows)] for name in names[1:]],
    )
    print(text)
    save("meshes", rows, "Obstacles of many triangles", text)


if __name__ == "__main__":
    main()
