"""Polish a found cycle: the tool spin of every weld becomes continuous.

The sequence chooses among a few spins of the tool; between them lies a better one for the weld and
its two motions. Slopes come from the multipliers of the motions; a step counts only if the two
motions, refined and certified again, and the weld together cost less. So the cycle never gets
worse, whatever the slopes are worth. Welds that share no motion move in one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dmoc.motion.motion import Motion
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from planning.station.studs import Stud
from planning.welds.alternatives_search import weld_cost
from sequencing.cycle.second_look import MotionLooks
from sequencing.cycle.spin import (
    EndGradient,
    admissible,
    end_gradient,
    line_problem,
    spin_slope,
    spun,
)
from sequencing.cycle_types import CycleMotion, Polish, Weld
from sequencing.edges.jobs import Between
from sequencing.edges.oracle import StationEdges

FIRST_STEP_RAD = 0.12
LEAST_STEP_RAD = 0.02
MAX_SWEEPS = 4
#: A step must save this share of the cost of the weld and its two motions.
WORTH = 1e-4


@dataclass
class _State:
    """The cycle while it changes."""

    welds: list[Weld]
    motions: list[CycleMotion]
    turned_rad: list[float]
    step_rad: list[float]
    slope: list[float | None]


def polish_cycle(
    oracle: StationEdges,
    world: CollisionWorld,
    looks: MotionLooks,
    welds: tuple[Weld, ...],
    motions: tuple[CycleMotion, ...],
    tell: Callable[[float], None],
) -> tuple[tuple[Weld, ...], tuple[CycleMotion, ...], Polish]:
    """Welds and motions of the polished cycle, and what it saved.

    `welds` and `motions` are in order of execution, as in a `Cycle`; `tell` hears the cost after
    every batch. Studs whose tool may not spin stay as they are.
    """
    station = oracle.station
    studs = {stud.id: stud for stud in station.studs}
    count = len(welds)
    state = _State(
        list(welds), list(motions), [0.0] * count, [FIRST_STEP_RAD] * count, [None] * count
    )
    before = _total(state)
    sweeps = 0
    while sweeps < MAX_SWEEPS and max(state.step_rad, default=0.0) >= LEAST_STEP_RAD:
        sweeps += 1
        for batch in _batches(count, len(motions) == count):
            _move(oracle, world, looks, studs, state, batch)
            tell(_total(state))
    moved = tuple(
        (weld.stud, turned) for weld, turned in zip(state.welds, state.turned_rad) if turned
    )
    polish = Polish(before, _total(state), sweeps, moved)
    return tuple(state.welds), tuple(state.motions), polish


def _total(state: _State) -> float:
    return float(sum(weld.cost for weld in state.welds) + sum(m.motion.cost for m in state.motions))


def _batches(count: int, closed: bool) -> list[list[int]]:
    """Welds that share no motion: every other one; a closed odd ring leaves one over."""
    even, odd = list(range(0, count, 2)), list(range(1, count, 2))
    if closed and count % 2 == 1 and count > 1:
        return [even[:-1], odd, even[-1:]]
    return [batch for batch in (even, odd) if batch]


def _around(state: _State, weld: int) -> tuple[int, int]:
    """Numbers of the motions that reach and that leave a weld."""
    if len(state.motions) == len(state.welds) + 1:
        return weld, weld + 1
    return (weld - 1) % len(state.motions), weld


def _move(
    oracle: StationEdges,
    world: CollisionWorld,
    looks: MotionLooks,
    studs: dict[str, Stud],
    state: _State,
    batch: list[int],
) -> None:
    """One step of every weld of the batch that has somewhere to go."""
    station = oracle.station
    trials: list[tuple[int, np.ndarray, float]] = []
    wanted: list[Between] = []
    for k in batch:
        stud, weld = studs[state.welds[k].stud], state.welds[k]
        if not stud.spin_free or stud.spin_rad is not None or state.step_rad[k] < LEAST_STEP_RAD:
            state.step_rad[k] = 0.0
            continue
        if state.slope[k] is None:
            state.slope[k] = _slope(station, studs, state, k)
        slope = state.slope[k]
        if not slope:
            state.step_rad[k] = 0.0
            continue
        turn = -float(np.sign(slope)) * state.step_rad[k]
        q = spun(station, weld.q_rad, turn)
        if q is None or not admissible(station, world, stud, q):
            state.step_rad[k] *= 0.4
            continue
        trials.append((k, q, turn))
        into, out = (state.motions[m] for m in _around(state, k))
        wanted.append(_between(studs, into, goal=q))
        wanted.append(_between(studs, out, start=q))
    found = oracle.between(wanted)
    for (k, q, turn), reaching, leaving in zip(trials, found[::2], found[1::2]):
        _accept(station, looks, studs, state, k, q, turn, (reaching, leaving))


def _accept(
    station: Station,
    looks: MotionLooks,
    studs: dict[str, Stud],
    state: _State,
    k: int,
    q: np.ndarray,
    turn: float,
    found: tuple[Motion, Motion],
) -> None:
    weld, places = state.welds[k], _around(state, k)
    holding = weld_cost(station, studs[weld.stud], q)
    old = weld.cost + sum(state.motions[m].motion.cost for m in places)
    new = holding + sum(motion.cost for motion in found)
    good = all(m.status.ok and m.certified and m.trajectory is not None for m in found)
    items = [replace(state.motions[m], motion=motion) for m, motion in zip(places, found)]
    worth = good and new <= old * (1.0 - WORTH)
    if not worth or any(looks.touch(item) is not None for item in items):
        state.step_rad[k] *= 0.4
        return
    state.welds[k] = replace(weld, q_rad=q, cost=holding)
    for place, item in zip(places, items):
        state.motions[place] = item
    state.turned_rad[k] += turn
    count = len(state.welds)
    for near in (k - 1, k, k + 1):  # their motions changed
        state.slope[near % count] = None


def _slope(station: Station, studs: dict[str, Stud], state: _State, k: int) -> float | None:
    """dF/dφ of weld k; 0 where it cannot be turned at all."""
    gradients: list[EndGradient | None] = []
    for place in _around(state, k):
        item = state.motions[place]
        trajectory = item.motion.trajectory
        gradient = None
        if trajectory is not None and item.motion.source == "refined":
            problem = line_problem(
                station, studs.get(item.origin), studs.get(item.target), trajectory
            )
            gradient = None if problem is None else end_gradient(problem, trajectory)
        gradients.append(gradient)
    weld = state.welds[k]
    slope = spin_slope(station, studs[weld.stud], weld.q_rad, gradients[1], gradients[0])
    return 0.0 if slope is None else slope


def _between(
    studs: dict[str, Stud],
    item: CycleMotion,
    start: np.ndarray | None = None,
    goal: np.ndarray | None = None,
) -> Between:
    trajectory = item.motion.trajectory
    assert trajectory is not None
    return Between(
        item.origin if item.origin in studs else None,
        item.target if item.target in studs else None,
        trajectory.q_rad[0] if start is None else start,
        trajectory.q_rad[-1] if goal is None else goal,
        item.motion,
    )
