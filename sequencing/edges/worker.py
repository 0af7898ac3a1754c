"""One edge, solved in whatever process an Executor runs it: a pure function of its job."""

from __future__ import annotations

import hashlib
import os
import pickle
import time
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.physics.resimulation import replay_motion
from dmoc.refinement import RefineParams
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.collision.warming import warm_up
from planning.collision.world import CollisionWorld
from planning.geometry.shapes import Body
from planning.path.departure import LineFunction, best_departure
from planning.path.edge_motion import EdgeParams, plan_motion
from planning.station.station import Station
from planning.station.studs import Stud
from planning.welds.poses import departure_point, weld_line
from sequencing.edges.store import decode_motion, encode_motion

# Raised whenever a change of the code changes the motion that an edge gets.
EDGE_VERSION = 6

Quality = Literal["screen", "final"]
NUM_INTERVALS: dict[Quality, int] = {"screen": 20, "final": 40}


@dataclass(frozen=True)
class EdgeJob:
    """What a worker needs: the context file (a station), the two ends, quality and seed.

    `origin` and `target` are stud ids, None for home. `start_rad` and `goal_rad` (n,) as tuples.
    `screened` is the screening motion that a final solve starts from.
    """

    context: str
    key: str
    origin: str | None
    target: str | None
    start_rad: tuple[float, ...]
    goal_rad: tuple[float, ...]
    quality: Quality
    method: Method
    seed: int
    solver: str = DEFAULT_SOLVER
    screened: bytes | None = None


@dataclass(frozen=True)
class EdgeResult:
    """Key, encoded motion, and the CPU seconds that it took (reported, never stored)."""

    key: str
    payload: bytes
    cpu_s: float


def write_context(station: Station, folder: Path) -> str:
    """Write the station for the workers; returns the path. The file lives as long as the run."""
    path = folder / f"context-{station.fingerprint[:16]}-{os.getpid()}.pickle"
    path.write_bytes(pickle.dumps(station))
    return str(path)


@lru_cache(maxsize=2)
def _context(path: str) -> tuple[Station, CollisionWorld, dict[str, Stud]]:
    # Only files written by `write_context` of the same run are read here.
    station: Station = pickle.loads(Path(path).read_bytes())
    world = CollisionWorld(station)
    # Workers that start together on a fresh machine share the compilation of the kernels.
    warm_up(world, reverse=os.getpid() % 2 == 1)
    return station, world, {stud.id: stud for stud in station.studs}


def solve_edge(job: EdgeJob) -> EdgeResult:
    """Plan and refine the motion of a job. Expected failure is a status of the motion."""
    began = time.process_time()
    station, world, studs = _context(job.context)
    motion = edge_motion(station, world, studs, job)
    if job.quality == "final" and motion.trajectory is not None:
        motion = replay_motion(motion, station.cost)
    return EdgeResult(job.key, encode_motion(motion), time.process_time() - began)


def edge_motion(
    station: Station, world: CollisionWorld, studs: dict[str, Stud], job: EdgeJob
) -> Motion:
    """The motion of a job in a world that exists already; a final one starts from the screened."""
    origin, target = (None if s is None else studs[s] for s in (job.origin, job.target))
    start, goal = np.array(job.start_rad), np.array(job.goal_rad)
    departure = best_departure(
        MotionProblem(station.robot, start, goal, station.cost),
        None if origin is None else _line(station, origin, start),
        None if target is None else _line(station, target, goal),
        NUM_INTERVALS[job.quality],
        job.solver,
    )
    clearance = world.clearance(
        start_line=None if origin is None or not origin.on else weld_line(station, origin),
        goal_line=None if target is None or not target.on else weld_line(station, target),
    )
    guess, guess_planner = None, "none"
    if job.screened is not None:
        screened = decode_motion(job.screened, station.robot)
        if screened.source == "refined":
            guess, guess_planner = screened.trajectory, screened.planner
    return plan_motion(
        departure.problem,
        clearance,
        world,
        seed=job.seed,
        quality=job.quality,
        method=job.method,
        guess=guess,
        guess_planner=guess_planner,
        free_guess=departure.guess,
        solver=job.solver,
    )


def _line(station: Station, stud: Stud, q_rad: Array) -> LineFunction:
    return lambda fraction: departure_point(station, stud, q_rad, fraction)


def context_fingerprint(station: Station, method: str, solver: str = DEFAULT_SOLVER) -> str:
    """sha256 of everything but the two ends that decides an edge: robot, shapes, cost, versions.

    The list of studs is not part of it: editing one stud leaves the edges of the others valid.
    """
    digest = hashlib.sha256()
    digest.update(f"{EDGE_VERSION}|{method}|{station.cost!r}|{station.clearance_m!r}".encode())
    digest.update(repr((sorted(station.allowed_collisions), station.engine)).encode())
    # By the name that the settings of a solve had when the first stores were written: what is in
    # them stays found, and every edge keeps its seed.
    settings = repr((RefineParams().by(solver), EdgeParams(), NUM_INTERVALS))
    digest.update(settings.replace("SolveParams(", "IpoptParams(").encode())
    for name in ("dmoc", "casadi", "pin", "coal", "ompl", "numba", "numpy", "scipy", "toppra"):
        digest.update(f"{name}={_version(name)};".encode())
    digest.update(station.robot.fingerprint.encode())
    for body in (*station.tool_bodies, *station.obstacles):
        _digest_body(digest, body)
    return digest.hexdigest()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # ompl, where another planner takes its place
        return "none"


def _digest_body(digest: hashlib._Hash, body: Body) -> None:
    digest.update(f"{body.name}|{body.touches}".encode())
    digest.update(np.ascontiguousarray(body.pose).tobytes())
    for shape in body.shapes:
        digest.update(f"{shape.kind}{shape.size_m!r}".encode())
        digest.update(np.ascontiguousarray(shape.pose).tobytes())
        if shape.vertices_m is not None:
            digest.update(np.ascontiguousarray(shape.vertices_m).tobytes())
