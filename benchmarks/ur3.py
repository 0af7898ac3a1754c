"""Searches over Bézier control points on summed torque: the UR3 paper's Fig. 1, with gradients.

Every search starts from the same seeded 30 points around the straight line and may look at 30
curves in each of 250 iterations (7,500 evaluations); limits and collisions are enforced by the
same penalty. GA: tournament of two, blend crossover, Gaussian mutation, two elites. DE: scipy's
best1bin. CMA-ES: pycma (optional extra `bench`), left out where it is absent. The gradient search
is not of this kind: it is there to say how near to a local optimum the others come.

    python -m benchmarks.ur3 [RUNS]
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import differential_evolution

from benchmarks.timing_common import RESULTS, save_table
from dmoc.robot.robot import load_robot
from studies.ur3.bezier_descent import descend_bezier
from studies.ur3.bezier_problem import BezierProblem, Evaluator
from studies.ur3.bezier_swarm import PAPER_SWARM, PENALTY, swarm_bezier
from studies.ur3.moves import paper_moves
from studies.ur3.world import avoid_in, forbidden_in, tabletop_world

POPULATION, ITERATIONS = 30, 250
Objective = Callable[[np.ndarray], np.ndarray]


class Task:
    """Summed torque of movement A: penalised values of points (P, 30)."""

    def __init__(self, kind: str) -> None:
        robot = load_robot("ur3e_class")
        world = tabletop_world(robot)
        self.move = next(move for move in paper_moves() if move.name == kind)
        self.forbidden, self.avoid = forbidden_in(world), avoid_in(world)
        self.problem = BezierProblem(
            robot, self.move.start_rad, self.move.goal_rad, 3.0, metric="torque"
        )
        self.evaluator = Evaluator(self.problem)
        self.lower, self.upper = self.problem.bounds

    def values(self, points: np.ndarray) -> np.ndarray:
        cost, excess = self.evaluator.evaluate(points)
        hit = self.forbidden(self.evaluator.curves(points))
        return np.where(hit | (excess > 0), PENALTY * (1.0 + excess), cost)

    def start(self, seed: int) -> np.ndarray:
        rng = np.random.default_rng([seed, 1])
        reach = np.repeat([0.1, 1.0, 1.0, 1.0, 0.1], 6)
        offset = reach * (2.0 * rng.random((POPULATION, 30)) - 1.0)
        offset[0] = 0.0
        return np.clip(self.problem.straight + offset, self.lower, self.upper)


class Recorder:
    """Calls the objective and keeps the best value after each block of a population."""

    def __init__(self, objective: Objective) -> None:
        self.objective, self.best, self.count = objective, np.inf, 0
        self.history: list[float] = []

    def __call__(self, points: np.ndarray) -> np.ndarray:
        values = self.objective(points)
        for value in values:
            self.best = min(self.best, float(value))
            self.count += 1
            if self.count % POPULATION == 0:
                self.history.append(self.best)
        return values


def genetic(objective: Objective, task: Task, seed: int) -> None:
    """A real-coded genetic algorithm."""
    rng = np.random.default_rng([seed, 3])
    people = task.start(seed)
    values = objective(people)
    for k in range(ITERATIONS - 1):
        order = np.argsort(values)
        people, values = people[order], values[order]
        pairs = rng.integers(0, POPULATION, (2, POPULATION - 2, 2)).min(axis=2)
        share = rng.uniform(-0.25, 1.25, (POPULATION - 2, 30))
        children = people[pairs[0]] + share * (people[pairs[1]] - people[pairs[0]])
        mutate = rng.random(children.shape) < 0.1
        children += mutate * rng.normal(0.0, 0.15 * (1.0 - k / ITERATIONS), children.shape)
        children = np.clip(children, task.lower, task.upper)
        people = np.vstack([people[:2], children])
        values = np.concatenate([values[:2], objective(children)])


def differential(objective: Objective, task: Task, seed: int) -> None:
    """scipy's differential evolution."""
    differential_evolution(
        lambda x: objective(np.atleast_2d(x.T)),
        list(zip(task.lower, task.upper)),
        init=task.start(seed),
        maxiter=ITERATIONS - 1,
        tol=0.0,
        polish=False,
        rng=seed,
        vectorized=True,
        updating="deferred",
    )


def cma_es(objective: Objective, task: Task, seed: int) -> None:
    """pycma with the same population, step 0.2 rad."""
    import cma

    search = cma.CMAEvolutionStrategy(
        np.clip(task.problem.straight, task.lower + 1e-6, task.upper - 1e-6),
        0.2,
        {
            "popsize": POPULATION,
            "seed": seed + 1,
            "verbose": -9,
            "bounds": [task.lower, task.upper],
            "maxiter": ITERATIONS,
        },
    )
    for _ in range(ITERATIONS):
        points = search.ask()
        search.tell(points, list(objective(np.array(points))))


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    task = Task("A")
    methods: dict[str, Callable[[Objective, Task, int], None]] = {
        "GA": genetic,
        "DE": differential,
        "CMA-ES": cma_es,
    }
    try:
        import cma  # noqa: F401
    except ImportError:
        print("pycma is not installed: CMA-ES left out")
        del methods["CMA-ES"]
    task.values(task.start(0))
    found: dict[str, tuple[list[np.ndarray], float]] = {}
    begin = time.process_time()
    swarm = [
        swarm_bezier(task.problem, seed, PAPER_SWARM, task.forbidden).history
        for seed in range(runs)
    ]
    found["PSO (paper)"] = (swarm, time.process_time() - begin)
    for name, method in methods.items():
        histories, begin = [], time.process_time()
        for seed in range(runs):
            record = Recorder(task.values)
            method(record, task, seed)
            histories.append(np.array((record.history + [record.best] * ITERATIONS)[:ITERATIONS]))
        found[name] = (histories, time.process_time() - begin)
    begin = time.process_time()
    gradients = [
        descend_bezier(task.problem, seed, forbidden=task.forbidden, avoid=task.avoid).value
        for seed in range(runs)
    ]
    gradient_cpu = time.process_time() - begin
    least = min(min(h[-1] for h in histories) for histories, _ in found.values())
    least = min(least, min(gradients))
    rows = []
    for name, (histories, cpu) in found.items():
        final = np.array([h[-1] for h in histories])
        within = [np.flatnonzero(h <= 1.05 * least) for h in histories]
        reached = [int(w[0]) + 1 for w in within if w.size]
        rows.append(
            {
                "search": name,
                "median N m s": float(np.median(final)),
                "best": float(final.min()),
                "worst": float(final.max()),
                "runs within 5 % of best known": f"{len(reached)}/{runs}",
                "median iteration of that": float(np.median(reached)) if reached else "",
                "CPU / PSO": cpu / found["PSO (paper)"][1],
            }
        )
    rows.append(
        {
            "search": "gradient, 4 starts",
            "median N m s": float(np.median(gradients)),
            "best": min(gradients),
            "worst": max(gradients),
            "runs within 5 % of best known": f"{sum(g <= 1.05 * least for g in gradients)}/{runs}",
            "CPU / PSO": gradient_cpu / found["PSO (paper)"][1],
        }
    )
    save_table(
        "ur3_search",
        rows,
        f"Summed torque of movement A over {runs} runs, 30 curves x 250 iterations each",
    )
    curves = {
        name: np.median(np.array(histories), axis=0).tolist()
        for name, (histories, _) in found.items()
    }
    (RESULTS / "ur3_search_curves.json").write_text(json.dumps(curves) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
