"""The nodes of a station's sequencing problem: every alternative of every stud, and home."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from planning.station.station import Station
from planning.welds.poses import StudAlternatives
from sequencing.gtsp.problem import GtspProblem

HOME = "home"


@dataclass(frozen=True)
class StationNodes:
    """V nodes: rows of `q_rad` (V, n), grouped in clusters by stud (home is the last, if any).

    `line_end_rad` (V, n) is the joint vector at the end of the departure line (the pose itself at
    home), `weld_cost` (V,) the cost of holding the pose during the weld, `stud` the stud id of a
    node, `alternative` its number within the stud.
    """

    q_rad: Array
    line_end_rad: Array
    weld_cost: Array
    cluster_of: npt.NDArray[np.int64]
    stud: tuple[str, ...]
    alternative: npt.NDArray[np.int64]
    home: int | None
    studs: tuple[str, ...]

    @property
    def num_nodes(self) -> int:
        """V."""
        return len(self.stud)

    @property
    def num_configurations(self) -> int:
        """Nodes without home."""
        return self.num_nodes - (self.home is not None)

    def usable_pairs(self) -> npt.NDArray[np.int64]:
        """All pairs (i, j), i < j, of nodes in different clusters, (P, 2)."""
        i, j = np.triu_indices(self.num_nodes, 1)
        keep = self.cluster_of[i] != self.cluster_of[j]
        return np.stack([i[keep], j[keep]], axis=1)

    def waypoints(self, pairs: npt.NDArray[np.int64]) -> Array:
        """(K, 4, n): pose, end of its line, end of the other line, other pose."""
        i, j = pairs[:, 0], pairs[:, 1]
        rows = (self.q_rad[i], self.line_end_rad[i], self.line_end_rad[j], self.q_rad[j])
        return np.stack(rows, axis=1)

    def precedence(self, pairs: Sequence[tuple[str, str]]) -> tuple[tuple[int, int], ...]:
        """Precedences between studs as pairs of clusters; studs that are not there drop out."""
        cluster = {stud: k for k, stud in enumerate(self.studs)}
        return tuple((cluster[a], cluster[b]) for a, b in pairs if a in cluster and b in cluster)

    def problem(self, cost: Array, station: Station, node_cost: Array | None = None) -> GtspProblem:
        """The GTSP with the given travel costs (V, V)."""
        return GtspProblem(
            cost=cost,
            cluster_of=self.cluster_of,
            home=self.home,
            name=station.name,
            node_cost=self.weld_cost if node_cost is None else node_cost,
            precedence=self.precedence(station.precedence),
        )


def station_nodes(station: Station, found: Sequence[StudAlternatives]) -> StationNodes:
    """Flatten the alternatives of the studs that have any; add home as a cluster of its own."""
    rows, ends, costs, cluster, names, numbers = [], [], [], [], [], []
    studs: list[str] = []
    for item in found:
        if not item.alternatives:
            continue
        for alternative in item.alternatives:
            rows.append(alternative.q_rad)
            line = np.atleast_2d(alternative.line_rad)
            ends.append(line[-1] if len(line) else alternative.q_rad)
            costs.append(alternative.weld_cost)
            cluster.append(len(studs))
            names.append(item.stud.id)
            numbers.append(alternative.index)
        studs.append(item.stud.id)
    home = None
    if station.home_rad is not None and rows:
        home = len(rows)
        rows.append(station.home_rad)
        ends.append(station.home_rad)
        costs.append(0.0)
        cluster.append(len(studs))
        names.append(HOME)
        numbers.append(0)
    n = station.robot.num_joints
    return StationNodes(
        q_rad=np.array(rows).reshape(-1, n),
        line_end_rad=np.array(ends).reshape(-1, n),
        weld_cost=np.array(costs),
        cluster_of=np.array(cluster, dtype=np.int64),
        stud=tuple(names),
        alternative=np.array(numbers, dtype=np.int64),
        home=home,
        studs=tuple(studs),
    )
