"""How a budget of iterations is spent, by the number of clusters; measured in docs/gtsp.md."""

from __future__ import annotations

from dataclasses import dataclass

QUICK, THOROUGH = 0.25, 4.0  # of the normal budget


@dataclass(frozen=True)
class Plan:
    """iterations in all, members of the population, iterations for a child."""

    iterations: int
    population: int
    child: int

    @staticmethod
    def of(clusters: int, effort: str, iterations: int | None) -> Plan:
        """The plan for a problem; `iterations` overrides what the effort says."""
        if iterations is None:
            if clusters <= 60:
                normal = 40_000 + 1000 * clusters
            else:
                normal = 3500 * clusters if clusters <= 120 else min(6000 * clusters, 1_000_000)
            factor = {"quick": QUICK, "normal": 1.0, "thorough": THOROUGH}[effort]
            iterations = int(normal * factor)
        child = 1500 if clusters <= 60 else 2000
        population = min(8 if clusters <= 60 else 16, iterations // (3 * child))
        return Plan(iterations, population, child)
