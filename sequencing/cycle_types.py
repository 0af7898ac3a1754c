"""A planned cycle: which weld pose after which, with which motion, and what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from dmoc.arrays import Array, readonly
from dmoc.motion.motion import Motion
from dmoc.solving.solvers import DEFAULT_SOLVER
from planning.station.station import Station
from sequencing.gtsp.problem import Tour


@dataclass(frozen=True)
class Weld:
    """One weld of the cycle: joint vector (n,), its cost (time × holding rate), its time [s]."""

    stud: str
    alternative: int
    q_rad: Array
    cost: float
    time_s: float
    contact_depth_m: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "q_rad", readonly(self.q_rad, "q_rad", ndim=1))


@dataclass(frozen=True)
class CycleMotion:
    """One motion of the cycle: `travel` from weld to weld, `home` from or to the home position."""

    key: str
    origin: str
    target: str
    kind: Literal["travel", "home"]
    motion: Motion


@dataclass(frozen=True)
class CycleCost:
    """Cost of a whole cycle, split as in the paper's Table 2."""

    travel: float
    welding: float

    @property
    def total(self) -> float:
        """Travel + welding."""
        return self.travel + self.welding

    def to_dict(self) -> dict[str, float]:
        """The object of `time_based` and `energy_based` in `--json`."""
        return {"travel": self.travel, "welding": self.welding, "total": self.total}


@dataclass(frozen=True)
class StudRow:
    """A row of Table 1: how many alternatives a stud has and the range of their weld costs."""

    stud: str
    alternatives: int
    lowest_cost: float
    highest_cost: float


@dataclass(frozen=True)
class Tables:
    """Table 1 (per stud) and Table 2: old (time-based) against new (cost-based) sequence.

    `time_based` is the median total of `time_based_totals` (of an even number the cheaper of the
    middle two), the costs of several sequences that all minimise the approximate travel time
    max |Δq| / v. That ignores acceleration, so beside it `least_time` is a sequence that is
    quickest under speed and acceleration limits (None: not asked for, or not found). `travel_s` are
    the real travel times [s] of old, least-time and new sequence with final motions, NaN where
    unknown.
    """

    studs: tuple[StudRow, ...]
    time_based: CycleCost
    time_based_totals: tuple[float, ...]
    energy_based: CycleCost
    least_time: CycleCost | None = None
    travel_s: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    @property
    def saving_percent(self) -> float:
        """100 (old − new) / old of the totals."""
        return 100.0 * (1.0 - self.energy_based.total / self.time_based.total)

    @property
    def saving_against_least_time_percent(self) -> float | None:
        """The same against `least_time`."""
        if self.least_time is None:
            return None
        return 100.0 * (1.0 - self.energy_based.total / self.least_time.total)


@dataclass(frozen=True)
class Search:
    """How the sequence was found and what is proven about it.

    `lower_bound` is proven when `bound_is_proven` (docs/bounds.md: of the continuous cost of every
    motion within the robot's speed and acceleration limits); `gap_percent` is the strict gap to it.

    The conditional gap holds only if no unevaluated edge costs less than its own factor times its
    estimate; it is never called a bound. The factors, `conditional_factor` in the median, follow
    the deviation that the estimate states for each edge, scaled by `edges_held_out` edges that were
    drawn at random and that the estimate was not fitted to: with `coverage_percent` per cent
    probability another edge drawn at random costs more than its factor × its estimate.

    With `pruning` the bound and the gaps speak of the poses that were kept.

    Of `edges_evaluated` edges `edges_training` fitted the estimate, `edges_held_out` only judged
    it, and the rest were asked for by the search.
    """

    edges_total: int
    edges_evaluated: int
    edges_training: int
    edges_held_out: int
    edges_failed: int
    lower_bound: float
    bound_is_proven: bool
    gap_percent: float
    conditional_factor: float
    coverage_percent: float
    conditional_gap_percent: float
    stopped_by: str
    rounds: tuple[dict[str, Any], ...]
    pruning: Pruning | None = None


@dataclass(frozen=True)
class Pruning:
    """Of `poses` that weld the studs `kept` were planned with; `full_turns` of the others differ
    from a kept one by full turns only. By a price of straight lines no cycle through the others is
    cheaper by more than `may_cost_percent` (`sequencing.edges.pruning`).
    """

    poses: int
    kept: int
    full_turns: int
    may_cost_percent: float | None


@dataclass(frozen=True)
class Polish:
    """What turning the tool continuously saved after the sequence was found.

    `moved` are the studs whose tool was turned, and by how much [rad]. The strict gap and the
    conditional gap speak of the cycle before: `cost_before`.
    """

    cost_before: float
    cost_after: float
    sweeps: int
    moved: tuple[tuple[str, float], ...]

    @property
    def saving_percent(self) -> float:
        """100 (before − after) / before; never negative."""
        return 100.0 * (1.0 - self.cost_after / self.cost_before)

    def to_dict(self) -> dict[str, Any]:
        """The entry of result.json."""
        return {
            "cost_before": self.cost_before,
            "cost_after": self.cost_after,
            "saving_percent": self.saving_percent,
            "sweeps": self.sweeps,
            "moved": [{"stud": stud, "spin_rad": turn} for stud, turn in self.moved],
        }


@dataclass(frozen=True)
class Look:
    """What a second engine found when it looked at the motions of a cycle.

    Of `motions` it asked `configurations`, against the pieces and the original meshes, and met
    `contacts`: none in a cycle that was planned. `refused` names motions that the certificate had
    passed and this engine did not; the cycle goes another way.
    """

    engine: str
    motions: int
    configurations: int
    contacts: int
    refused: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reuse:
    """Which travels came from the store and which were solved in this run.

    Each is a pair of ends, `stud/alternative` or `home`; `lost` names those that killed their
    worker twice and count as impossible. It depends on what earlier runs left
    behind, so it is no part of a `Cycle` and of result.json: timing.json has it.
    """

    reused: tuple[tuple[str, str], ...]
    solved: tuple[tuple[str, str], ...]
    lost: tuple[str, ...] = ()

    def summary(self) -> str:
        """`412 travels from the store, 45 solved: S07 (45 of 45), …`: the studs that they touch."""
        text = f"{len(self.reused)} travels from the store, {len(self.solved)} solved"
        text = "; ".join([text, *self.lost])
        if not self.reused or not self.solved:
            return text
        touched: dict[str, int] = {}
        for pair in self.solved:
            for end in pair:
                stud = end.rsplit("/", 1)[0]
                touched[stud] = touched.get(stud, 0) + 1
        order = sorted(touched.items(), key=lambda item: (-item[1], item[0]))
        listed = ", ".join(f"{stud} ({count})" for stud, count in order[:6])
        return f"{text}, touching {listed}" + (", …" if len(order) > 6 else "")

    def to_dict(self) -> dict[str, Any]:
        """The entry of timing.json."""
        return {
            "edges_reused": len(self.reused),
            "edges_solved": len(self.solved),
            "reused": [list(pair) for pair in self.reused],
            "solved": [list(pair) for pair in self.solved],
            "lost": list(self.lost),
        }


@dataclass(frozen=True)
class Cycle:
    """The result of `plan_station`. Motions and welds are in order of execution.

    With a home: motion 0 leaves home, motion k+1 leaves weld k, the last one returns home.
    Without: motion k leaves weld k and the last one returns to weld 0. `unreachable` lists studs
    that are not in the cycle, each with its reason. CPU times are in no field.
    """

    station: Station
    seed: int
    method: str
    tour: Tour
    welds: tuple[Weld, ...]
    motions: tuple[CycleMotion, ...]
    tables: Tables
    search: Search
    configurations: int
    unreachable: tuple[tuple[str, str], ...]
    polish: Polish | None = None
    second_look: Look | None = None
    solver: str = DEFAULT_SOLVER

    @property
    def duration_s(self) -> float:
        """Cycle time: all motions and all welds [s]."""
        return float(
            sum(m.motion.duration_s for m in self.motions) + sum(w.time_s for w in self.welds)
        )

    @property
    def certified(self) -> int:
        """How many motions are certified between their knots."""
        return sum(1 for m in self.motions if m.motion.certified)

    @property
    def fallbacks(self) -> int:
        """How many motions are the time-scaled seed instead of a refined one."""
        return sum(1 for m in self.motions if m.motion.source == "fallback")
