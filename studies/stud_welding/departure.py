"""What leaving and reaching the welds costs: along a line, faster or slower, or with a stop.

Obstacles are left out, so that nothing but the way of leaving differs between the rows.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from importlib.metadata import version

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.solving.solver import solve_many
from planning.path.departure import LineFunction, with_departure
from planning.welds.poses import departure_point
from sequencing.edges.store import decode_motion, encode_motion
from studies.stud_welding.model import Model, StudyBench, travels
from studies.stud_welding.types import DepartureRow

NUM_INTERVALS = 20
Sequences = Mapping[str, tuple[int, ...]]
#: Row name → knots on each line, of twenty intervals; None: no line.
MODES: dict[str, int | None] = {
    "no line (no gun can)": None,
    "line in 1/20 of the motion": 1,
    "line in 2/20 of the motion": 2,
    "line in 3/20 of the motion": 3,
    "line in 4/20 of the motion": 4,
}
CHOSEN = "whichever is cheapest for each motion"
STOP = "retract, stop, travel, stop, approach"


def departure_rows(
    model: Model, sequences: Sequences, new: str, bench: StudyBench
) -> tuple[DepartureRow, ...]:
    """Travel cost of every sequence for each way to leave the welds; `new` is the one compared."""
    pairs = sorted({pair for cycle in sequences.values() for pair in canonical(cycle)})
    rows, base = [], None
    least: dict[tuple[int, int], tuple[float, float]] = {}  # cost and end speed
    for name, knots in MODES.items():
        motions = solve_kept([_problem(model, i, j, knots) for i, j in pairs], bench)
        costs = {pair: price(motion) for pair, motion in zip(pairs, motions)}
        speed = None
        if knots is not None:
            speeds = {
                pair: _end_speed(model, motion, knots)
                for pair, motion in zip(pairs, motions)
                if motion.status.ok
            }
            speed = _median(speeds.values())
            for pair, value in speeds.items():
                least[pair] = min(least.get(pair, (np.inf, 0.0)), (costs[pair], value))
        rows.append(_row(name, model, sequences, costs, new, base, speed))
        base = base or rows[0].travel[new]
    chosen = {pair: least.get(pair, (np.inf, 0.0))[0] for pair in pairs}
    speed = _median(speed for _, speed in least.values())
    rows.append(_row(CHOSEN, model, sequences, chosen, new, base, speed))
    rows.append(_row(STOP, model, sequences, _stopping(model, pairs, bench), new, base, 0.0))
    return tuple(rows)


def _median(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.median(found)) if found else None


def canonical(cycle: tuple[int, ...]) -> list[tuple[int, int]]:
    """Travels of a cycle with the smaller node first: both directions cost the same."""
    return [(min(i, j), max(i, j)) for i, j in travels(cycle).tolist()]


def price(motion: Motion) -> float:
    """Cost of a motion, inf where it did not converge."""
    return motion.cost if motion.status.ok else np.inf


def _row(
    name: str,
    model: Model,
    sequences: Sequences,
    costs: Mapping[tuple[int, int], float],
    new: str,
    base: float | None,
    speed: float | None,
) -> DepartureRow:
    travel: dict[str, float | None] = {}
    totals = {}
    for label, cycle in sequences.items():
        total = float(sum(costs[pair] for pair in canonical(cycle)))
        travel[label] = total if np.isfinite(total) else None
        if np.isfinite(total):
            totals[label] = total + float(np.sum(model.nodes.weld_cost[list(cycle)]))
    ours = travel[new]
    ratio = 1.0 if base is None else None if ours is None else ours / base
    cheapest = min(totals, key=lambda label: totals[label]) if totals else ""
    return DepartureRow(name, travel, ratio, speed, cheapest)


def _problem(model: Model, i: int, j: int, knots: int | None) -> MotionProblem:
    q, station = model.nodes.q_rad, model.station
    problem = MotionProblem(station.robot, q[i], q[j], station.cost, num_intervals=NUM_INTERVALS)
    if knots is None:
        return problem
    return with_departure(problem, _line(model, i), _line(model, j), NUM_INTERVALS, knots)


def _line(model: Model, node: int) -> LineFunction | None:
    if node == model.nodes.home:
        return None
    stud, q = model.station.stud(model.nodes.stud[node]), model.nodes.q_rad[node]
    return lambda fraction: departure_point(model.station, stud, q, fraction)


def _stopping(
    model: Model, pairs: list[tuple[int, int]], bench: StudyBench
) -> dict[tuple[int, int], float]:
    """Three motions from rest to rest: off the weld, between the lines' ends, onto the weld."""
    robot, cost, nodes = model.station.robot, model.station.cost, model.nodes
    welded = sorted({v for pair in pairs for v in pair} - {nodes.home})

    def rest_to_rest(start: Array, goal: Array) -> MotionProblem:
        return MotionProblem(robot, start, goal, cost, num_intervals=NUM_INTERVALS)

    lines = solve_kept([rest_to_rest(nodes.q_rad[v], nodes.line_end_rad[v]) for v in welded], bench)
    retract = {v: price(motion) for v, motion in zip(welded, lines)}
    between = solve_kept(
        [rest_to_rest(nodes.line_end_rad[i], nodes.line_end_rad[j]) for i, j in pairs], bench
    )
    return {
        (i, j): price(motion) + retract.get(i, 0.0) + retract.get(j, 0.0)
        for (i, j), motion in zip(pairs, between)
    }


def _end_speed(model: Model, motion: Motion, knots: int) -> float:
    """Speed of the tip [m/s] where the motion leaves its (first or last) line."""
    curve, robot = motion.trajectory, model.station.robot
    assert curve is not None
    time = curve.t_s[knots]
    half = 0.25 * (curve.t_s[1] - curve.t_s[0])
    before, after = (
        robot.tip_pose(q).translation
        for q in curve.sample(np.array([time - half, time + half])).q_rad
    )
    return float(np.linalg.norm(after - before) / (2 * half))


def solve_kept(problems: list[MotionProblem], bench: StudyBench) -> list[Motion]:
    """`dmoc.solve` of every problem, read from the bench's store where it was solved before."""
    keys = [_key(problem) for problem in problems]
    kept = {key: bench.store.get(key) for key in keys}
    missing = {k: p for k, p in zip(keys, problems) if kept[k] is None}
    solved = solve_many(list(missing.values()), bench.executor, seed=bench.seed)
    for key, motion in zip(missing, solved):
        kept[key] = encode_motion(motion)
        bench.store.put(key, encode_motion(motion))
    found = []
    for key, problem in zip(keys, problems):
        payload = kept[key]
        assert payload is not None
        found.append(decode_motion(payload, problem.robot))
    return found


def _key(problem: MotionProblem) -> str:
    digest = hashlib.sha256(
        f"free|{problem.robot.fingerprint}|{problem.cost!r}|{problem.num_intervals}".encode()
    )
    for name in ("dmoc", "casadi", "numpy"):
        digest.update(version(name).encode())
    for rows in (problem.start_rad, problem.goal_rad, problem.depart_rad, problem.arrive_rad):
        digest.update(b"|" if rows is None else np.ascontiguousarray(rows).tobytes())
    return digest.hexdigest()
