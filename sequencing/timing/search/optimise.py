"""Find starts and overrides: gradient multi-start, particle swarm, and a polish between them.

An evaluation costs microseconds, so a thousand scattered points come first (many of them on
faces of the box, where optima like to lie); L-BFGS-B runs from the best of them, collisions
ignored. If its answer is free of collisions it is returned. Otherwise the swarm (invisible walls: a
collision is a forbidden point) looks on both sides of the barrier and a pattern search with
shrinking steps walks its best point up to the barrier. The best allowed point of all wins, and the
start given by the caller is always among the candidates: never worse than that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize as scipy_minimize

from dmoc.swarm import SwarmParams, minimise
from sequencing.timing.power.timeline import CellTimeline, coarser, cost_and_gradient, cost_batch
from sequencing.timing.search.slack import SlackGraph, decode, decode_batch, pull_back

FreeCheck = Callable[[np.ndarray], np.ndarray]
"""(P, 2, S) starts and overrides -> (P,) True where the schedule is free of collisions."""


@dataclass(frozen=True)
class SearchParams:
    """What to spend. `method` auto uses the swarm only where the gradient's answer collides."""

    method: str = "auto"  # auto | gradient | swarm
    scattered: int = 1000
    gradient_starts: int = 6
    gradient_iterations: int = 60
    swarm: SwarmParams = SwarmParams(particles=16, iterations=24)
    polish_rounds: int = 20


DEFAULT_SEARCH = SearchParams()
_FEW = 16  # scattering helps in so many dimensions at most
_COARSE = 4  # scattered points are ranked with steps so many times longer
_NEAR = 0.35  # starts closer than this in every coordinate are likely to end in one basin


@dataclass(frozen=True, eq=False)
class TimingResult:
    """Start_s and override (S,) of the best allowed point, value [J] and evaluations.

    `value_j` is inf if no allowed schedule was met.
    """

    start_s: np.ndarray
    override: np.ndarray
    value_j: float
    evaluations: int


def optimise_timing(
    line: CellTimeline,
    graph: SlackGraph,
    seed: int,
    free: FreeCheck | None = None,
    params: SearchParams = DEFAULT_SEARCH,
    start: np.ndarray | None = None,
) -> TimingResult:
    """Minimise the grid energy of `line` over the box of `graph`, keeping `free` schedules only.

    `start` (k, 2, S) are points to begin from (as-fast-as-possible and stretched always are).
    """
    search = _Search(line, graph, free)
    size = graph.duration_s.size
    fast, stretched = np.zeros((2, size)), np.zeros((2, size))
    stretched[0] = 1.0
    seeds = [fast, stretched, *([] if start is None else list(np.asarray(start, dtype=float)))]
    search.offer(np.array(seeds))
    active = np.concatenate([graph.free, graph.free + size])
    if active.size == 0:
        return search.result()
    rng = np.random.default_rng(seed)
    relaxed, relaxed_z = np.inf, search.z
    if params.method in ("auto", "gradient"):
        begin = seeds[1:] + search.scatter(active, rng, params)
        for z in begin:
            found, value = search.descend(z, active, params.gradient_iterations)
            if value < relaxed:
                relaxed, relaxed_z = value, found
        search.offer(relaxed_z[None])
    needs_swarm = params.method == "swarm" or (
        params.method == "auto" and search.value > relaxed + 1e-9 * abs(relaxed)
    )
    if needs_swarm:
        search.swarm(active, int(rng.integers(2**31)), params)
        search.polish(active, params.polish_rounds, rng)
    return search.result()


class _Search:
    """Book-keeping of one search: the best allowed point and the count of evaluations."""

    def __init__(self, line: CellTimeline, graph: SlackGraph, free: FreeCheck | None) -> None:
        self.line, self.graph, self.free = line, graph, free
        self.coarse = coarser(line, _COARSE)
        self.size = graph.duration_s.size
        self.z = np.zeros((2, self.size))
        self.value = np.inf
        self.evaluations = 0

    def values(self, z: np.ndarray) -> np.ndarray:
        """J of points (P, 2, S), inf where they collide."""
        timing = decode_batch(self.graph, z)
        value = np.full(len(z), np.inf)
        allowed = np.ones(len(z), dtype=bool) if self.free is None else self.free(timing)
        if allowed.any():
            chosen = timing[allowed]
            value[allowed] = cost_batch(self.line, chosen[:, 0], chosen[:, 1])
        self.evaluations += len(z)
        return value

    def scatter(
        self, active: np.ndarray, rng: np.random.Generator, params: SearchParams
    ) -> list[np.ndarray]:
        """The best of random points that lie apart, collisions ignored, as starts of descents.

        That is for few dimensions. In many, every trajectory takes the same small share of the
        slack that is left to it: a large one would leave nothing to those that come later.
        """
        wanted = max(0, params.gradient_starts - 1)
        if wanted == 0:
            return []
        if active.size > _FEW:
            points = np.tile(self.z, (wanted, 1, 1))
            points[:, 0], points[:, 1] = 0.4 * 0.5 ** np.arange(1, wanted + 1)[:, None], 0.02
            return list(points)
        x = _scattered(params.scattered, active.size, rng)
        points = self.expand(x, active)
        timing = decode_batch(self.graph, points)
        value = cost_batch(self.coarse, timing[:, 0], timing[:, 1])
        self.evaluations += len(points)
        return list(points[_apart(x, value, wanted)])

    def offer(self, z: np.ndarray) -> None:
        value = self.values(z)
        k = int(np.argmin(value))
        if value[k] < self.value:
            self.z, self.value = z[k].copy(), float(value[k])

    def descend(self, z: np.ndarray, active: np.ndarray, rounds: int) -> tuple[np.ndarray, float]:
        """L-BFGS-B on the active variables, collisions ignored."""
        point = z.copy()
        flat = point.reshape(-1)

        def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
            flat[active] = x
            timing = decode_batch(self.graph, point[None])[0]
            value, by_start, by_override = cost_and_gradient(self.line, timing[0], timing[1])
            grad = pull_back(self.graph, point, timing, np.array([by_start, by_override]))
            self.evaluations += 1
            return value, grad.reshape(-1)[active]

        out = scipy_minimize(
            objective,
            flat[active].copy(),
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, 1.0)] * active.size,
            options={"maxiter": rounds, "maxfun": 3 * rounds},
        )
        flat[active] = np.clip(out.x, 0.0, 1.0)
        return point, float(out.fun)

    def expand(self, x: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Points (P, active) as (P, 2, S), the inactive variables as in the best point."""
        points = np.tile(self.z.reshape(-1), (len(x), 1))
        points[:, active] = x
        return points.reshape(-1, 2, self.size)

    def swarm(self, active: np.ndarray, seed: int, params: SearchParams) -> None:
        """Scattered allowed points, the swarm from the best of them, its best point kept."""
        rng = np.random.default_rng(seed)
        points = _scattered(max(1, params.scattered // 3), active.size, rng)
        value = self.values(self.expand(points, active))
        best = np.argsort(value)[: params.swarm.particles // 2]
        given = points[best[np.isfinite(value[best])]]
        if np.isfinite(self.value):
            given = np.vstack([self.z.reshape(-1)[active], given])
        found = minimise(
            lambda x: self.values(self.expand(x, active)),
            np.zeros(active.size),
            np.ones(active.size),
            seed,
            params.swarm,
            given if len(given) else None,
        )
        if found.value < self.value:
            self.z = self.expand(found.x[None], active)[0]
            self.value = found.value

    def polish(self, active: np.ndarray, rounds: int, rng: np.random.Generator) -> None:
        """Pattern search with random rotations of the axes, steps halved when nothing helps."""
        if not np.isfinite(self.value):
            return
        step, own = 0.1, np.eye(active.size)
        for _ in range(rounds):
            x = self.z.reshape(-1)[active]
            # A random reflection turns the axes; it costs no factorisation.
            normal = rng.standard_normal(active.size)
            axes = own - np.outer(normal, (2.0 / (normal @ normal)) * normal)
            moves = np.concatenate([own, axes])
            trial = np.clip(np.concatenate([x + step * moves, x - step * moves]), 0.0, 1.0)
            before = self.value
            self.offer(self.expand(trial, active))
            if self.value >= before - 1e-9 * abs(before):
                step *= 0.5
            else:
                step = min(0.5, 1.5 * step)

    def result(self) -> TimingResult:
        return TimingResult(*decode(self.graph, self.z), self.value, self.evaluations)


def _apart(x: np.ndarray, value: np.ndarray, wanted: int) -> list[int]:
    """The best points (rows of x) of which no two are close: as many basins as may be."""
    chosen: list[int] = []
    for k in np.argsort(value, kind="stable"):
        if len(chosen) == wanted:
            break
        if all(np.abs(x[k] - x[m]).max() > _NEAR for m in chosen):
            chosen.append(int(k))
    return chosen


def _scattered(count: int, dimensions: int, rng: np.random.Generator) -> np.ndarray:
    """Random points (count, dimensions); each coordinate is put on a face with chance 1/3."""
    points = rng.random((count, dimensions))
    face = rng.random((count, dimensions))
    points[face < 1.0 / 6.0] = 0.0
    points[face > 5.0 / 6.0] = 1.0
    return points
