"""When a solver stops: by counts, never by time, so that the same seed gives the same tour."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from dmoc.errors import ProblemError

EFFORTS = ("quick", "normal", "thorough")


@dataclass(frozen=True)
class Stop:
    """Limits of one solve; None means: as the effort says.

    iterations    of the heuristic, all restarts together.
    states        of the bounded dynamic programming, in one layer.
    memory_bytes  of the Held–Karp table or of the states.
    target_cost   stop as soon as a tour costs no more.
    """

    iterations: int | None = None
    states: int | None = None
    memory_bytes: int = 2 << 30
    target_cost: float = -math.inf

    def __post_init__(self) -> None:
        for key in ("iterations", "states", "memory_bytes"):
            value = getattr(self, key)
            if value is not None and value < 0:
                raise ProblemError.of("gtsp-stop", field=key, value=str(value), legal="0 or more")
        if math.isnan(self.target_cost):
            raise ProblemError.of("gtsp-stop", field="target_cost", value="NaN", legal="a cost")


@dataclass(frozen=True)
class Incumbent:
    """What a progress callback receives: the best tour so far."""

    iterations: int
    nodes: tuple[int, ...]
    cost: float


Callback = Callable[[Incumbent], None]
