"""One edge, solved in whatever process an Executor runs it: a pure function of its job."""

from __future__ import annotations

import hashlib
import os
import pickle
import threading
import time
import zlib
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.physics.resimulation import replay_motion
from dmoc.refinement import RefineParams
from dmoc.refinement.params import Method
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.collision.warming import warm_up
from planning.collision.world import CollisionWorld
from planning.geometry.mesh import shape_fingerprint
from planning.geometry.shapes import Body
from planning.path.departure import LineFunction, best_departure
from planning.path.edge_motion import EdgeParams, plan_motion
from planning.station.station import Station
from planning.station.studs import Stud
from planning.welds.poses import departure_point, weld_line
from sequencing.edges.store import decode_motion, encode_motion

# Whose code decides what an edge gets: kernels, programme, planner, departure, this file.
CODE = ("dmoc", "planning")
LIBRARIES = (
    "casadi",
    "coal",
    "llvmlite",
    "numba",
    "numpy",
    "ompl",
    "pin",
    "python-fcl",
    "scipy",
    "toppra",
)

T = TypeVar("T")
Quality = Literal["screen", "final"]
NUM_INTERVALS: dict[Quality, int] = {"screen": 20, "final": 40}


@dataclass(frozen=True)
class EdgeJob:
    """What a worker needs: the station, the two ends, quality and seed; no file of anybody's.

    `context` names the station by the sha256 of `bundle`, its bytes, which a worker must be given
    once (None: it has them). `origin` and `target` are stud ids, None for home. `start_rad` and
    `goal_rad` (n,) as tuples. `screened` is the screening motion that a final solve starts from.
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
    bundle: bytes | None = None


@dataclass(frozen=True)
class EdgeResult:
    """Key, encoded motion, and the CPU seconds that it took (reported, never stored).

    Without a payload the worker lacks the station: send the job again with its bundle.
    """

    key: str
    payload: bytes | None
    cpu_s: float


def bundle_of(station: Station) -> tuple[str, bytes]:
    """A station's bytes for workers, and their name."""
    bundle = zlib.compress(pickle.dumps(station), 1)
    return hashlib.sha256(bundle).hexdigest(), bundle


Context = tuple[Station, CollisionWorld, dict[str, Stud]]
MOST_CONTEXTS = 2
_bundles: dict[str, bytes] = {}
_of_thread = threading.local()
# Worlds are one a thread, but compiled programmes keep workspace for the whole process.
_turn = threading.Lock()


def _context(job: EdgeJob) -> Context | None:
    """Station and world of a job in this thread; None where nobody sent the station yet."""
    known: dict[str, Context] = _of_thread.__dict__.setdefault("known", {})
    if job.context not in known:
        if job.bundle is not None:
            _keep(_bundles, job.context, job.bundle)
        if job.context not in _bundles:
            return None
        # Only what `bundle_of` made: it comes the way of the job, which the executor pickles.
        station: Station = pickle.loads(zlib.decompress(_bundles[job.context]))
        world = CollisionWorld(station)
        # Workers that start together on a fresh machine share the compilation of the kernels.
        warm_up(world, reverse=os.getpid() % 2 == 1)
        _keep(known, job.context, (station, world, {stud.id: stud for stud in station.studs}))
    return known[job.context]


def _keep(kept: dict[str, T], name: str, value: T) -> None:
    kept[name] = value
    while len(kept) > MOST_CONTEXTS:
        del kept[next(iter(kept))]


def solve_edge(job: EdgeJob) -> EdgeResult:
    """Plan and refine the motion of a job. Expected failure is a status of the motion.

    Threads of one process take turns.
    """
    with _turn:
        began = time.process_time()
        context = _context(job)
        if context is None:
            return EdgeResult(job.key, None, 0.0)
        motion = edge_motion(*context, job)
        if job.quality == "final" and motion.trajectory is not None:
            motion = replay_motion(motion, context[0].cost)
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
    """sha256 of everything but the two ends that decides an edge: robot, shapes, cost, code.

    Shapes count by content. The list of studs is not part of it: editing one leaves the edges of
    the others valid. Nor are the meshes behind the pieces: the second look reads those anew.
    """
    digest = hashlib.sha256()
    digest.update(f"{method}|{station.cost!r}|{station.clearance_m!r}".encode())
    digest.update(repr((sorted(station.allowed_collisions), station.engine)).encode())
    digest.update(repr((RefineParams().by(solver), EdgeParams(), NUM_INTERVALS)).encode())
    for name in LIBRARIES:
        digest.update(f"{name}={_version(name)};".encode())
    robot = station.robot
    digest.update(f"{code_fingerprint()}{robot.fingerprint}{shape_fingerprint(robot)}".encode())
    for body in (*station.tool_bodies, *station.obstacles):
        _digest_body(digest, body)
    return digest.hexdigest()


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """sha256 of the source text of `CODE` and of this file: another text may give other motions."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for package in CODE:
        root = Path(str(resources.files(package)))
        for path in sorted(root.rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
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
        for array in (shape.pose, shape.vertices_m, shape.faces):
            if array is not None:
                digest.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
