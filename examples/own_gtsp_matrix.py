"""A generalised travelling salesman of one's own: any cost matrix, one node of every cluster."""

import numpy as np

from sequencing.gtsp import GtspProblem, Stop, solve

# Ten tasks that can each be done in three ways; a travel costs its length, a way its own price.
rng = np.random.default_rng(1)
place = rng.random((30, 2))
cost = np.linalg.norm(place[:, None] - place, axis=2)
problem = GtspProblem(
    cost=cost,
    cluster_of=np.repeat(np.arange(10), 3),
    node_cost=rng.uniform(0.0, 0.1, 30),
    home=0,
    precedence=[(3, 5), (5, 8)],  # task 3 before 5 before 8
)

tour = solve(problem, seed=0, method="exact")
print("tasks in order:", [int(problem.cluster_of[node]) for node in tour.nodes])
print(f"cost {tour.cost:.4f}, proven optimal: {tour.proven}")

# For large problems: a heuristic that stops by counts, so that the same seed gives the same tour.
quick = solve(problem, Stop(iterations=20_000), seed=0, method="heuristic")
print(f"heuristic {100 * (quick.cost / tour.cost - 1):.2f} % above it")
