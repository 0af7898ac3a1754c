"""What the stud-welding study finds: sequences with costs, shares, changed assumptions, trade-offs.

All costs are J of the station's own weights unless a row says that it changes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sequencing.cycle_types import CycleCost, StudRow

#: Sequences whose travel time is this much [%] above the least are as good to the old method.
NEAR_PERCENT = 1.0


@dataclass(frozen=True)
class Use:
    """What a cycle takes: times [s], effort ∫uᵀu dt [N²m²s] and electrical energy [J].

    `drive_j` is drawn from the link while braking energy is shared between the axes but never
    given back, `net_j` with all of it given back, `total_j` is `drive_j` and the constant
    consumption. Welds are held by the motors.
    """

    duration_s: float
    motion_s: float
    effort: float
    drive_j: float
    net_j: float
    total_j: float


@dataclass(frozen=True)
class AblationRow:
    """One way to find a sequence; `cost` None where one of its travels has no motion."""

    name: str
    cost: CycleCost | None
    against_old_percent: float | None
    against_new_percent: float | None
    order: tuple[str, ...] = ()


@dataclass(frozen=True)
class Shares:
    """How a saving splits: `parts` sum to `total` exactly (Shapley values, in J).

    `costs` holds the cost of every combination, keyed by what is new in it (`""` is all old,
    `"poses+order"` …); `from_` names what was compared.
    """

    from_: str
    costs: dict[str, float]
    parts: dict[str, float]

    @property
    def total(self) -> float:
        """All old less all new."""
        return self.costs[""] - self.costs["+".join(self.parts)]

    def percent(self, part: str) -> float | None:
        """Share of a part in the saving, None where nothing is saved."""
        return 100.0 * self.parts[part] / self.total if self.total > 0 else None


@dataclass(frozen=True)
class ChangeRow:
    """A changed assumption: what the old and the nominal sequence cost then, and the best one.

    `regret_percent`: how much the nominal sequence costs more than the best found under the
    change. `conditional_gap_percent` holds only if no unsolved edge costs less than
    `conditional_factor` × its estimate. `common_neighbours_percent` and `same_poses` compare the
    best sequence with the nominal one.
    """

    group: str
    name: str
    best: CycleCost
    nominal: CycleCost | None
    old: CycleCost | None
    regret_percent: float | None
    saving_percent: float | None
    conditional_gap_percent: float | None
    conditional_factor: float
    common_neighbours_percent: float
    same_poses: int
    order: tuple[str, ...]
    edges: int
    best_use: Use
    nominal_use: Use | None = None
    note: str = ""


@dataclass(frozen=True)
class DepartureRow:
    """A way to leave and reach the welds, obstacles left out: cost of each sequence's travels.

    `travel` maps the sequences' names to their travel cost (None: some motion did not converge);
    `cheapest` names the one that is cheapest with its welds; `end_speed_m_s` is the median speed
    of the tip where it leaves the line.
    """

    name: str
    travel: dict[str, float | None]
    ratio: float | None
    end_speed_m_s: float | None
    cheapest: str


@dataclass(frozen=True)
class TradeOff:
    """A point of cycle time against consumption; `on_front` if no other point is better in both."""

    name: str
    sequence: Literal["new", "re-optimised", "old"]
    time_weight: float | None
    use: Use
    on_front: bool = False


@dataclass(frozen=True)
class StudWeldingStudy:
    """The whole study.

    `old_totals` are the costs of the tied sequences of least travel time that were drawn,
    `near_totals` those of sequences at most `NEAR_PERCENT` slower; screening quality.
    `provenance` tags the station's numbers as published or assumed.
    """

    station: str
    seed: int
    reduced: bool
    studs: tuple[StudRow, ...]
    old: CycleCost
    new: CycleCost
    old_totals: tuple[float, ...]
    near_totals: tuple[float, ...]
    old_time_s: float
    old_order: tuple[str, ...]
    new_order: tuple[str, ...]
    ablation: tuple[AblationRow, ...]
    shares: tuple[Shares, ...]
    changes: tuple[ChangeRow, ...]
    departures: tuple[DepartureRow, ...]
    trade_offs: tuple[TradeOff, ...]
    edges_evaluated: int
    provenance: dict[str, str]

    @property
    def saving_percent(self) -> float:
        """100 (old − new) / old of the totals, both with final motions."""
        return 100.0 * (1.0 - self.new.total / self.old.total)
