"""The strict bound: its series, its relaxed cost, and no solved motion below it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import inverse_dynamics
from dmoc.physics.running_cost import trajectory_cost
from dmoc.physics.state import mass_matrices
from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve
from planning.collision.world import CollisionWorld
from planning.path.departure import best_departure, line_through
from planning.station.build import demo_station
from planning.welds.alternatives_search import alternatives
from sequencing.bounds import power_bound, travel_bound
from sequencing.bounds.curves import _least_form, leaving_curves, reach
from sequencing.bounds.field import cell_grid, field_cells, lie_terms
from sequencing.bounds.series import arm_series
from sequencing.bounds.travel import SCALES
from sequencing.edges.nodes import station_nodes
from sequencing.edges.oracle import StationEdges
from sequencing.edges.store import EdgeStore
from tests.naive.naive_bounds import reference_torque, relaxed_rate

ROBOTS = ("ur10e_class", "irb6640_class")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request):
    return load_robot(request.param)


@pytest.fixture(scope="module")
def series(robot):
    return arm_series(robot)


@pytest.fixture(scope="module")
def grid(robot, series):
    return cell_grid(robot, series.bearing)


@pytest.fixture(scope="module")
def terms(series, grid):
    return lie_terms(series, grid)


def _states(robot, count, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (count, robot.num_joints))
    return q, rng.uniform(-1, 1, q.shape) * robot.velocity_limit_rad_s


def test_series_give_mass_matrix_and_gravity_back(robot, series) -> None:
    q, _ = _states(robot, 40, 3)
    bearing = list(series.bearing)
    x = q[:, bearing]
    spread = np.abs(robot.gravity_torque_nm(q)[:, bearing] - series.mean_gravity(x))
    assert np.all(spread <= series.spread + 1e-6)
    # The modulus of what the others add bounds the difference from the mean over them.
    value = np.einsum("pk,rkij->rpij", np.exp(1j * x @ series.mass_k.T), series.mass)
    gap = np.abs(mass_matrices(robot, q) - value[0].real)
    assert np.all(gap <= np.abs(value[1:]).sum(axis=0) + 1e-6)
    e = 1e-6 * np.eye(2)
    for m in (0, 1):
        slope = (series.mean_gravity(x + e[m]) - series.mean_gravity(x - e[m])) / 2e-6
        np.testing.assert_allclose(series.mean_gravity_slope(x)[..., m], slope, atol=1e-3)


@pytest.mark.parametrize("alpha", [(1.0, 0.5), (0.2, 0.4), (0.0, 0.7)])
@pytest.mark.parametrize("spend", [True, False])
def test_cells_are_below_the_relaxed_cost_everywhere(
    robot, series, grid, terms, alpha, spend
) -> None:
    cost = Cost()
    cells = field_cells(terms, cost, alpha, series.bearing, spend)
    q, v = _states(robot, 50, 8)
    a, b = series.bearing
    # Past one turn the cells repeat.
    at = ((q[:, [a, b]] - grid.lower) / grid.step).astype(int) % np.array(grid.counts)
    g = robot.gravity_torque_nm(q)
    for k in range(len(q)):
        i, j = at[k]
        mean = series.mean_gravity(q[k : k + 1, [a, b]])[0]
        assert np.all(cells.low[i, j] <= mean + 1e-9)
        assert np.all(mean <= cells.high[i, j] + 1e-9)
        dev = g[k, [a, b]] - mean
        s = np.array(alpha)
        low = cost.time + cost.effort * np.sum(s * (2 - s) * mean**2 + 2 * s * mean * dev)
        low += cells.diagonal[i, j] @ v[k] ** 2
        low -= 2 * cells.cross[i, j] * abs(v[k, a] * v[k, b])
        assert low <= relaxed_rate(robot, series, cost, alpha, q[k], v[k]) + 1e-5


def test_curves_are_below_the_relaxed_cost_near_a_pose(robot, series, grid, terms) -> None:
    cost, alpha = Cost(), (0.75, 0.5)
    cells = field_cells(terms, cost, alpha, series.bearing)
    q, _ = _states(robot, 4, 12)
    q *= 0.6
    t = np.array([0.0, 0.1, 0.25, 0.5])
    curves = leaving_curves(robot, cost, series, grid, cells, q, t)
    rate = np.diff(curves.spent, axis=1) / np.diff(t)
    rng = np.random.default_rng(4)
    for node in range(len(q)):
        for k in range(1, len(t)):
            far = reach(robot, t[k : k + 1])[0]
            fast = np.minimum(robot.velocity_limit_rad_s, t[k] * robot.acceleration_limit_rad_s2)
            for _ in range(40):
                p = q[node] + rng.uniform(-1, 1, len(far)) * far
                p = np.clip(p, robot.q_lower_rad, robot.q_upper_rad)
                v = rng.choice([-1.0, 0.0, 1.0, rng.uniform(-1, 1)], len(far)) * fast
                assert rate[node, k - 1] <= relaxed_rate(robot, series, cost, alpha, p, v) + 1e-5


def test_least_form_is_the_minimum_on_the_box() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        a, c, b = rng.normal(), rng.normal(), abs(rng.normal())
        u, w = rng.uniform(0.1, 2, 2)
        x, y = np.meshgrid(np.linspace(0, u, 201), np.linspace(0, w, 201))
        brute = np.min(a * x * x - 2 * b * x * y + c * y * y)
        assert brute - 5e-3 <= _least_form(a, b, c, u, w) <= brute + 1e-12


def test_torques_of_a_motion_meet_the_momentum_identity(robot, series) -> None:
    """∫ 2 s·u dt = ∫ 2 s·g − vᵀ L_s M v dt for any motion at rest at both ends."""
    rng = np.random.default_rng(9)
    n, alpha, duration = robot.num_joints, (1.0, 0.6), 1.3
    start, delta, bend = (rng.uniform(-0.7, 0.7, n) for _ in range(3))
    x = (np.arange(400) + 0.5) / 400
    s, d1 = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 / duration
    d2 = 60 * x * (1 - x) * (1 - 2 * x) / duration**2
    h, h1 = x**3 * (1 - x) ** 3 * 20, 60 * (x**2 * (1 - x) ** 2 * (1 - 2 * x)) / duration
    h2 = 60 * (2 * x * (1 - x) * (1 - 2 * x) ** 2 - 2 * x**2 * (1 - x) ** 2) / duration**2
    q = start + np.outer(s, delta) + np.outer(h, bend)
    v = np.outer(d1, delta) + np.outer(h1, bend)
    u = inverse_dynamics(robot.model, q, v, np.outer(d2, delta) + np.outer(h2, bend))
    reference = np.array([reference_torque(series, alpha, p, n) for p in q])
    left = np.sum(2 * reference * u)
    cost = Cost(time=0.0, effort=1.0, velocity=0.0)
    right = sum(relaxed_rate(robot, series, cost, alpha, a, b) for a, b in zip(q, v))
    right += np.sum(reference**2)
    assert left == pytest.approx(right, rel=1e-5)


def _station_problem(count):
    station = demo_station("stud_welding_a")
    if count is not None:
        station = replace(station, studs=station.studs[::count], spin_steps=4)
    world = CollisionWorld(station)
    nodes = station_nodes(station, alternatives(station, world))
    return station, world, nodes


def _never_above(count, thin, seed):
    """Obstacle-free optima between random poses, on their departure lines: J, its continuous twin
    and the bound of the same edge."""
    station, _, nodes = _station_problem(thin)
    robot, cost = station.robot, station.cost
    pairs = nodes.usable_pairs()
    pairs = pairs[np.random.default_rng(seed).choice(len(pairs), min(count, len(pairs)), False)]
    waypoints = nodes.waypoints(pairs)
    bound = power_bound(robot, cost, waypoints)
    bound = np.maximum(bound, travel_bound(robot, cost, nodes.q_rad)(pairs, waypoints))
    for low, points in zip(bound, waypoints):
        problem = best_departure(
            MotionProblem(robot, points[0], points[3], cost),
            line_through(points[:2]),
            line_through(points[3:1:-1]),
            20,
        ).problem
        for each in (problem, problem.replace(depart_rad=None, arrive_rad=None)):
            if each is not problem:
                straight = points[None, [0, 3]]
                low = power_bound(robot, cost, straight)[0]
            motion = solve(each)
            if motion.status.ok:
                assert 0 < low <= motion.cost * (1 + 1e-6)
                assert low <= trajectory_cost(motion.trajectory, robot, cost)


def test_no_solved_motion_is_below_the_bound() -> None:
    _never_above(14, 5, 1)


@pytest.mark.slow
def test_two_thousand_solved_motions_are_above_the_bound() -> None:
    _never_above(2000, None, 2)


@pytest.mark.slow
def test_refined_motions_are_above_the_bound(tmp_path) -> None:
    """Certified motions among the obstacles: 250 edges drawn at random."""
    station, world, nodes = _station_problem(None)
    pairs = nodes.usable_pairs()
    pairs = pairs[np.random.default_rng(3).choice(len(pairs), 250, False)]
    with EdgeStore(tmp_path / "edges.sqlite") as store:
        oracle = StationEdges(station, world, nodes, store)
        solved = oracle.evaluate(pairs)
        assert np.all(oracle.bound(pairs) <= solved * (1 + 1e-6))
        for motion in oracle.motions(pairs):
            assert motion.status.ok or not np.isfinite(motion.cost)


def test_the_holding_part_beats_speeds_and_energy_somewhere() -> None:
    """Between heavy poses close to each other, where power balance and speeds say little."""
    station, _, nodes = _station_problem(5)
    pairs = nodes.usable_pairs()
    waypoints = nodes.waypoints(pairs)
    holding = travel_bound(station.robot, station.cost, nodes.q_rad)(pairs, waypoints)
    assert np.max(holding / power_bound(station.robot, station.cost, waypoints)) > 1.5


def test_costs_that_the_theory_does_not_cover_have_no_holding_part(robot) -> None:
    q = np.zeros((2, robot.num_joints))
    assert travel_bound(robot, Cost(effort=0.0), q) is None
    n = robot.num_joints
    assert travel_bound(robot, Cost(torque_matrix=np.eye(n)), q) is None
    assert len({scale[:2] for scale in SCALES}) > 5
