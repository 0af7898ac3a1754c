"""Timing on the pallet cell: cost of an evaluation, of a collision check, and the peers' energies.

    python -m benchmarks.timing            # all tables
    python -m benchmarks.timing windows    # or any of TABLES below

Peers (cma, pyswarms) are skipped where they are not installed. All solve the same window, over the
same box, with the same objective (collision = +inf, as a large number where a peer needs one).
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable

import coal
import numpy as np
from scipy.optimize import differential_evolution
from scipy.optimize import minimize as scipy_minimize

from benchmarks.timing_common import save_table
from dmoc.motion.trajectory import JointTrajectory
from dmoc.swarm import SwarmParams, minimise
from sequencing.timing.clearance.arms import ArmShapes, joint_frames
from sequencing.timing.clearance.segments import segment_distances
from sequencing.timing.clearance.swept import swept_path
from sequencing.timing.power.along_path import exact_power_w
from sequencing.timing.power.timeline import cost, cost_and_gradient, cost_batch
from sequencing.timing.search.optimise import SearchParams, optimise_timing
from sequencing.timing.search.prepared import Geometry, prepare_cell
from sequencing.timing.search.slack import decode_batch, slack_graph
from sequencing.timing.search.windows import (
    fast_timing,
    general_timing,
    make_windows,
    stretched_timing,
    window_timing,
)
from studies.pallet_cell.sampled_check import BROAD, NARROW, SampledCheck
from studies.pallet_cell.study import pallet_cell

SEEDS = range(10)
PENALTY = 1e7


def cpu_us(run: Callable[[], object], repeats: int) -> float:
    """Median CPU time of five rounds of `repeats` calls [us per call]."""
    run()
    rounds = []
    for _ in range(5):
        start = time.process_time()
        for _ in range(repeats):
            run()
        rounds.append((time.process_time() - start) / repeats * 1e6)
    return float(np.median(rounds))


class Window:
    """One window of the pallet cell as a black-box problem over z in [0, 1]^4."""

    def __init__(self, prepared, windows, geometry: Geometry | None, index: int) -> None:
        self.numbers = list(windows.numbers[index])
        self.length = float(windows.edges_s[index + 1] - windows.edges_s[index])
        flat = np.array([t for row in prepared.cell.durations_s for t in row])[self.numbers]
        self.line = prepared.window(self.numbers, self.length, self.length / 500)
        self.graph = slack_graph([[t] for t in flat], (), self.length)
        self.free = None
        if geometry is not None:
            n = self.numbers
            geometry.sharpen([(a, b) for k, a in enumerate(n) for b in n[k + 1 :]])
            self.free = geometry.window(n, self.length).free
        self.critical = int(np.argmax(flat))
        moving = [r for r in range(len(flat)) if r != self.critical]
        self.active = np.array([*moving, *[r + len(flat) for r in moving]])
        self.size = len(flat)
        self.count = 0

    def points(self, x: np.ndarray) -> np.ndarray:
        z = np.zeros((len(x), 2 * self.size))
        z[:, self.active] = np.clip(x, 0.0, 1.0)
        return decode_batch(self.graph, z.reshape(-1, 2, self.size))

    def batch(self, x: np.ndarray) -> np.ndarray:
        self.count += len(x)
        timing = self.points(np.atleast_2d(x))
        value = np.full(len(timing), np.inf)
        free = np.ones(len(timing), bool) if self.free is None else self.free(timing)
        if free.any():
            value[free] = cost_batch(self.line, timing[free, 0], timing[free, 1])
        return value

    def one(self, x: np.ndarray) -> float:
        value = float(self.batch(np.asarray(x)[None])[0])
        return value if np.isfinite(value) else PENALTY

    def base(self) -> float:
        return cost(self.line, np.zeros(self.size), np.ones(self.size))


def evaluation() -> None:
    prepared = prepare_cell(pallet_cell())
    windows = make_windows(prepared)
    window = Window(prepared, windows, None, 0)
    start, speed = np.array([0.0, 0.05, 0.1]), np.array([1.0, 0.8, 0.7])
    many = np.tile(start, (2000, 1)), np.tile(speed, (2000, 1))
    paths = [prepared.paths[k] for k in window.numbers]
    one = cpu_us(lambda: cost(window.line, start, speed), 300)
    batch = cpu_us(lambda: cost_batch(window.line, *many), 1) / 2000
    gradient = cpu_us(lambda: cost_and_gradient(window.line, start, speed), 300)
    exact = cpu_us(lambda: [exact_power_w(p, 0.8) for p in paths], 50)
    rows = [
        {"what": "quartic, in a batch", "us": batch, "goal": "<= 10"},
        {"what": "quartic, one call", "us": one, "goal": ""},
        {"what": "value and gradient, one call", "us": gradient, "goal": "<= 3x one"},
        {"what": "gradient / one call", "us": gradient / one, "goal": "<= 3"},
        {"what": "exact per joint", "us": exact, "goal": "<= 50"},
    ]
    save_table("timing_evaluation", rows, "One evaluation: 3 robots, 500 link steps")


def collision() -> None:
    cell = pallet_cell()
    prepared = prepare_cell(cell)
    windows = make_windows(prepared)
    start = time.process_time()
    geometry = Geometry(cell)
    for numbers in windows.numbers:
        for i, a in enumerate(numbers):
            for b in numbers[i + 1 :]:
                geometry.map(a, b)
    rough_s = time.process_time() - start
    window = Window(prepared, windows, geometry, 31)
    timing = window.points(np.random.default_rng(0).random((2000, 4)))
    each = cpu_us(lambda: window.free(timing), 1) / 2000
    rows = [
        {"what": "one window's check by coordination maps [us]", "value": each, "goal": "<= 20"},
        {"what": "all 117 capsule maps, swept paths included [s]", "value": rough_s, "goal": ""},
    ]
    save_table("timing_collision", rows, "Collision check of a window, three arms")


def routines() -> None:
    """The paper's Table 1: 16 solids free, 24 colliding, 24 free; 100 samples of one trajectory."""
    cell = pallet_cell()
    prepared = prepare_cell(cell)
    windows = make_windows(prepared)
    skip = ("base_link", "link_6")  # eight solids a robot
    fast = np.zeros(3), np.ones(3)
    # The window whose best timing without collision check really collides.
    for index in range(len(windows.numbers)):
        window = Window(prepared, windows, None, index)
        loose = optimise_timing(window.line, window.graph, 0)
        slow = loose.start_s, loose.override
        q = [window_joints(cell, windows, index, r, slow, 100) for r in range(3)]
        if SampledCheck(cell.robots, (), "ssap", "gjk", skip).first_collision(q) >= 0:
            break
    rows = []
    for broad in BROAD:
        for narrow in NARROW:
            row: dict[str, object] = {"broad": broad, "narrow": narrow}
            for title, count, timing in (
                ("16 free", 2, fast),
                ("24 colliding", 3, slow),
                ("24 free", 3, fast),
            ):
                check = SampledCheck(cell.robots[:count], (), broad, narrow, skip)
                q = [window_joints(cell, windows, index, r, timing, 100) for r in range(count)]
                hit = check.first_collision(q) >= 0
                row[f"{title} [ms]"] = cpu_us(lambda c=check, q=q: c.first_collision(q), 2) / 1e3
                row[f"{title}: collides"] = hit
            rows.append(row)
    save_table(
        "timing_routines", rows, "Sampled collision routines, 100 samples, as the paper's Table 1"
    )


def meshes() -> None:
    """Whole arms as meshes, 500 samples of every window at full speed: median and largest time."""
    cell = pallet_cell()
    windows = make_windows(prepare_cell(cell))
    fast = np.zeros(3), np.ones(3)
    rows = []
    for broad, obstacles in (("capsules", ()), ("capsules", cell.obstacles), ("ssap", ())):
        check = SampledCheck(cell.robots, obstacles, broad, "bvh", ("base_link",))
        spent = []
        for index in range(0, len(windows.numbers), 1 if broad == "capsules" else 13):
            q = [window_joints(cell, windows, index, r, fast, 500) for r in range(3)]
            assert check.first_collision(q) < 0
            spent.append(cpu_us(lambda c=check, q=q: c.first_collision(q), 1) / 1e3)
        rows.append(
            {
                "broad": broad,
                "obstacles": len(obstacles),
                "windows": len(spent),
                "median_ms": float(np.median(spent)),
                "largest_ms": float(np.max(spent)),
                "goal": "<= 10" if broad == "capsules" and not obstacles else "",
            }
        )
    save_table("timing_meshes", rows, "Trajectory check: 3 arms as meshes, 500 samples")


def window_joints(cell, windows, index: int, r: int, timing, samples: int) -> np.ndarray:
    """Joint vectors (K, n) of robot r at `samples` instants of a window."""
    trajectory = cell.robots[r].trajectories[cell.owner(windows.numbers[index][r])[1]]
    t = np.linspace(0, windows.edges_s[index + 1] - windows.edges_s[index], samples)
    s = np.clip((t - timing[0][r]) * timing[1][r], 0, trajectory.duration_s)
    return window_joints_at(trajectory, s)


def false_free(total: int = 10_000, instants: int = 100, fine: int = 4000) -> None:
    """Random timings that the maps call free, against exact solids at dense instants."""
    cell = pallet_cell()
    prepared = prepare_cell(cell)
    windows = make_windows(prepared)
    geometry = Geometry(cell)
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    rows = []
    for index in (33, 34):
        window = Window(prepared, windows, geometry, index)
        flat = window.graph.duration_s
        placers, paths = [], []
        for r, number in enumerate(window.numbers):
            item = cell.robots[r]
            trajectory = item.trajectories[cell.owner(number)[1]]
            paths.append(swept_path(item.robot, geometry.shapes[r], trajectory, fine))
            q = window_joints_at(trajectory, np.linspace(0, trajectory.duration_s, fine + 1))
            placers.append(ExactPlacer(geometry.shapes[r], *joint_frames(item.robot, q)))
        timing = window.points(np.random.default_rng(index).random((total // 2, 4)))
        free = window.free(timing)
        wrong = tests = 0
        for start, speed in timing[free]:
            t = np.linspace(0, window.length, instants)
            s = np.clip((t[:, None] - start) * speed, 0, flat)
            nearest = np.rint(s / flat * fine).astype(int)
            hit = False
            for k in nearest:
                for i in range(3):
                    for j in range(i + 1, 3):
                        a, b = paths[i], paths[j]
                        rough = segment_distances(a.ends_m[k[i]], b.ends_m[k[j]])
                        rough -= a.radius_m[:, None] + b.radius_m[None, :]
                        for c, d in np.argwhere(rough <= 0.0):
                            tests += 1
                            result.clear()
                            if coal.collide(
                                placers[i].shapes.solids[c],
                                placers[i].transform(k[i], c),
                                placers[j].shapes.solids[d],
                                placers[j].transform(k[j], d),
                                request,
                                result,
                            ):
                                hit = True
            wrong += hit
        rows.append(
            {
                "window": index,
                "timings": len(timing),
                "called free": int(free.sum()),
                "of these colliding": int(wrong),
                "exact tests": tests,
            }
        )
    save_table("timing_false_free", rows, "Coordination maps against the dense exact check")


class ExactPlacer:
    """Coal's solids of one arm at the samples of one path: the oracle of the maps."""

    def __init__(self, shapes: ArmShapes, rotation: np.ndarray, origin: np.ndarray) -> None:
        self.shapes = shapes
        turn = rotation[:, shapes.joint]
        self.rotation = turn @ shapes.pose[None, :, :3, :3]
        self.origin = (
            np.einsum("kcab,cb->kca", turn, shapes.pose[:, :3, 3]) + origin[:, shapes.joint]
        )

    def transform(self, sample: int, solid: int) -> coal.Transform3s:
        return coal.Transform3s(self.rotation[sample, solid], self.origin[sample, solid])


def window_joints_at(trajectory: JointTrajectory, s: np.ndarray) -> np.ndarray:
    """Joint vectors (K, n) at path times s (K,)."""
    return trajectory.on(None).sample(s + trajectory.t_s[0]).q_rad


def conflicted(prepared, windows) -> int:
    """The window where collisions cost most: the one that the paper's Fig. 5 is about."""
    geometry = Geometry(prepared.cell)
    worst, index = -1.0, 0
    for k in range(len(windows.numbers)):
        window = Window(prepared, windows, None, k)
        free = optimise_timing(window.line, window.graph, 0, None, SearchParams(method="gradient"))
        check = geometry.window(window.numbers, window.length)
        if check.free(np.array([[free.start_s, free.override]]))[0]:
            continue
        window = Window(prepared, windows, geometry, k)
        tight = optimise_timing(window.line, window.graph, 0, window.free)
        if tight.value_j - free.value_j > worst:
            worst, index = tight.value_j - free.value_j, k
    return index


def windows_table() -> None:
    cell = pallet_cell()
    prepared = prepare_cell(cell)
    layout = make_windows(prepared)
    index = conflicted(prepared, layout)
    rows = []
    for title, geometry in (("without", None), ("with", Geometry(cell))):
        window = Window(prepared, layout, geometry, index)
        rows.append(
            {"collisions": title, "method": "as fast as possible", "median_j": window.base()}
        )
        for name, solve in peers(window, prepared):
            found, spent, counts = [], [], []
            solve(0)
            for seed in SEEDS:
                window.count = 0
                start = time.process_time()
                value = solve(seed)
                spent.append(time.process_time() - start)
                found.append(value)
                counts.append(window.count)
            rows.append(
                {
                    "collisions": title,
                    "method": name,
                    "median_j": float(np.median(found)),
                    "worst_j": float(np.max(found)),
                    "evaluations": int(np.median(counts)),
                    "cpu_ms": 1e3 * float(np.median(spent)),
                }
            )
    save_table("timing_windows", rows, f"Window {index} of the pallet cell, 4 variables, 10 seeds")


def peers(window: Window, prepared) -> list[tuple[str, Callable[[int], float]]]:
    box = [(0.0, 1.0)] * len(window.active)
    low, high = np.zeros(len(box)), np.ones(len(box))

    def ours(seed: int) -> float:
        found = optimise_timing(window.line, window.graph, seed, window.free)
        window.count = found.evaluations
        return found.value_j

    def small(seed: int) -> float:
        params = SearchParams(
            method="swarm",
            scattered=64,
            swarm=SwarmParams(particles=12, iterations=2),
            polish_rounds=8,
        )
        found = optimise_timing(window.line, window.graph, seed, window.free, params)
        window.count = found.evaluations
        return found.value_j

    def swarm(seed: int) -> float:
        params = SwarmParams(particles=24, iterations=60)
        return minimise(window.batch, low, high, seed, params).value

    def evolution(budget: int) -> Callable[[int], float]:
        def run(seed: int) -> float:
            out = differential_evolution(
                window.one, box, seed=seed, popsize=15, maxiter=budget, tol=1e-8, polish=False
            )
            return float(out.fun)

        return run

    def slsqp(seed: int) -> float:
        rng = np.random.default_rng(seed)
        runs = [
            scipy_minimize(window.one, x, method="SLSQP", bounds=box, options={"maxiter": 100})
            for x in (np.r_[np.ones(2), np.zeros(2)], *rng.random((5, len(box))))
        ]
        return float(min(run.fun for run in runs))

    found = [
        ("own default", ours),
        ("own, small budget", small),
        ("own swarm only", swarm),
        ("SciPy DE", evolution(60)),
        ("SciPy DE, 10x", evolution(600)),
        ("SLSQP x6", slsqp),
    ]
    try:
        import cma

        def evolve(seed: int, budget: int = 1500) -> float:
            options = {
                "bounds": [0, 1],
                "seed": seed + 1,
                "verbose": -9,
                "maxfevals": budget,
                "tolfun": 1e-7,
            }
            out = cma.fmin2(window.one, 0.5 * (low + high), 0.3, options)
            return float(out[1].result.fbest)

        found += [("cma", evolve), ("cma, 10x", lambda seed: evolve(seed, 15000))]
    except ImportError:
        print("cma is not installed: skipped")
    try:
        import pyswarms

        def flock(seed: int) -> float:
            np.random.seed(seed)  # noqa: NPY002  (pyswarms knows only the global generator)
            optimiser = pyswarms.single.GlobalBestPSO(
                n_particles=30,
                dimensions=len(box),
                bounds=(low, high),
                options={"c1": 1.49618, "c2": 1.49618, "w": 0.7298},
            )

            def objective(x: np.ndarray) -> np.ndarray:
                value = window.batch(x)
                return np.where(np.isfinite(value), value, PENALTY)

            return float(optimiser.optimize(objective, iters=100, verbose=False)[0])

        found.append(("pyswarms", flock))
    except ImportError:
        print("pyswarms is not installed: skipped")
    return found


def whole() -> None:
    cell = pallet_cell()
    prepared = prepare_cell(cell)
    layout = make_windows(prepared)
    window_timing(prepared, layout, 0, None)  # compile
    rows = []
    total = layout.edges_s[-1]
    fast = fast_timing(prepared, layout)
    stretched = stretched_timing(prepared, layout, float(total))
    timings = [("as fast as possible", fast, 0.0), ("stretched only", stretched, 0.0)]
    warm = Geometry(cell)
    window_timing(prepared, layout, 0, warm)
    for name, geometry in (
        ("39 windows, no collision check", None),
        ("39 windows, maps made on the way", Geometry(cell)),
        ("39 windows, maps known", warm),
    ):
        start = time.process_time()
        timing = window_timing(prepared, layout, 0, geometry)
        timings.append((name, timing, time.process_time() - start))
    safe = timings[-1][1]
    for name, geometry in (("general, no collision check", None), ("general", Geometry(cell))):
        start = time.process_time()
        timing = general_timing(prepared, safe, 0, geometry, [stretched, fast])
        timings.append((name, timing, time.process_time() - start))
    base = stretch = 0.0
    for name, timing, spent in timings:
        energy = prepared.evaluate(timing.start_s, timing.override, timing.total_s).link_j
        base = base or energy
        stretch = energy if name == "stretched only" else stretch
        row = {"case": name, "energy_j": energy, "saving_percent": 100 * (1 - energy / base)}
        if stretch:
            row["against_stretched_percent"] = 100 * (1 - energy / stretch)
        row["cpu_s"] = spent
        rows.append(row)
    save_table("timing_whole", rows, "Pallet cell: 3 robots, 39 trajectories each")


def grid() -> None:
    cell = pallet_cell()
    prepared = prepare_cell(cell)
    layout = make_windows(prepared)
    flat = np.array([t for row in cell.durations_s for t in row])
    geometry = Geometry(cell)
    rows = []
    for index, (one, two) in itertools.product((0, 19, 33, 34), ((0, 1), (0, 2), (1, 2))):
        numbers = [layout.numbers[index][one], layout.numbers[index][two]]
        length = float(flat[numbers].max())
        line = prepared.window(numbers, length, length / 500)
        graph = slack_graph([[flat[k]] for k in numbers], (), length)
        geometry.sharpen([tuple(numbers)])
        free = geometry.window(numbers, length).free
        mover = int(np.argmin(flat[numbers]))
        axis = np.linspace(0, 1, 200)
        z = np.zeros((200 * 200, 2, 2))
        z[:, 0, mover], z[:, 1, mover] = np.repeat(axis, 200), np.tile(axis, 200)
        timing = decode_batch(graph, z)
        allowed = free(timing)
        energy = np.full(len(z), np.inf)
        energy[allowed] = cost_batch(line, timing[allowed, 0], timing[allowed, 1])
        for seed in range(3):
            found = optimise_timing(line, graph, seed, free)
            rows.append(
                {
                    "window": index,
                    "robots": f"{one}, {two}",
                    "seed": seed,
                    "grid_j": float(energy.min()),
                    "own_j": found.value_j,
                    "own_above_grid_percent": 100 * (found.value_j / energy.min() - 1),
                    "start_j": cost(line, np.zeros(2), np.ones(2)),
                    "blocked_percent": 100 * float(1 - allowed.mean()),
                }
            )
    save_table("timing_grid", rows, "Two robots: own search against a 200 x 200 grid")


TABLES = {
    "evaluation": evaluation,
    "collision": collision,
    "windows": windows_table,
    "whole": whole,
    "grid": grid,
    "routines": routines,
    "meshes": meshes,
    "false_free": false_free,
}


def main() -> None:
    for name in sys.argv[1:] or TABLES:
        TABLES[name]()


if __name__ == "__main__":
    main()
