"""What `dmoc gtsp FILE` computes, as the object that `--json` prints."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from sequencing.gtsp.gtsplib import read_gtsplib
from sequencing.gtsp.held_karp_table import held_karp
from sequencing.gtsp.normalise import normal_form
from sequencing.gtsp.portfolio import solve
from sequencing.gtsp.problem import GtspProblem


def run_gtsp_file(
    path: str | Path,
    seed: int = 0,
    exact: bool = False,
    effort: str = "normal",
) -> dict[str, Any]:
    """Solve a `.gtsp` file: {cost, tour (1-based), lower_bound, proven, method, cpu_s}.

    `cost` is None where no tour was found and `lower_bound` where nothing was proven. `cpu_s` is
    the process CPU time of the solve; loading or compiling the kernels comes before.
    Raises `InputError` for a bad file and `ProblemError` for an unknown effort.
    """
    problem = read_gtsplib(path)
    _load_kernels(exact)
    begin = time.process_time()
    method = "exact" if exact else "auto"
    tour = solve(problem, seed=seed, method=method, effort=effort)
    cpu_s = time.process_time() - begin
    return {
        "cost": _plain(tour.cost),
        "tour": [v + 1 for v in tour.nodes],
        "lower_bound": _plain(tour.lower_bound),
        "proven": tour.proven,
        "method": tour.method,
        "cpu_s": round(cpu_s, 4),
    }


def _load_kernels(exact: bool) -> None:
    """Compile or load what the solve needs, so that `cpu_s` is the solve's own."""
    cost = 1.0 - np.eye(4)
    tiny = GtspProblem(cost, np.arange(4))
    solve(tiny, stop=100, method="heuristic")
    if exact:
        from sequencing.gtsp.bounded import bounded_dp

        form = normal_form(tiny)
        bounded_dp(form, 5.0, 0.5, None, 1 << 20)
        held_karp(form)


def _plain(value: float) -> int | float | None:
    """A whole number as int, infinities as None (JSON has none)."""
    if not math.isfinite(value):
        return None
    return int(value) if value == int(value) else value
