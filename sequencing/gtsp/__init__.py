"""The generalised travelling salesman problem: exact and heuristic solvers."""
