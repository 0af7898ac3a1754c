"""One edge of a station: free, around obstacles, by boxes, refused, without a path."""

from itertools import combinations, product

import numpy as np
import pytest
from scenes import box, snake

from dmoc.motion.motion import MotionProblem
from dmoc.motion.status import Status
from dmoc.refinement import RefineParams
from dmoc.solving.solver import solve
from planning import CollisionWorld, alternatives, demo_station
from planning.collision.departure_line import line_stray_m
from planning.collision.world import world_for
from planning.path.departure import (
    best_departure,
    departure_fractions,
    line_through,
    num_line_knots,
    with_departure,
)
from planning.path.edge_motion import EdgeParams, plan_motion
from planning.welds.poses import weld_line


@pytest.fixture(scope="module")
def cell():
    station = demo_station("stud_welding_a_8")
    world = CollisionWorld(station)
    return station, world, {s.stud.id: s for s in alternatives(station, world)}


def edge(cell, start, goal, num_intervals=20):
    """Problem and clearance between two (stud, index)."""
    station, world, table = cell
    a, b = (table[stud].alternatives[index] for stud, index in (start, goal))
    problem = with_departure(
        MotionProblem(station.robot, a.q_rad, b.q_rad, station.cost, num_intervals),
        line_through(a.line_rad),
        line_through(b.line_rad),
    )
    lines = [weld_line(station, table[stud].stud) for stud, _ in (start, goal)]
    return problem, world.clearance(*lines), lines


def first_edges(cell, wanted, count):
    """The first edges whose obstacle-free optimum is certified, or is not."""
    studs, found = sorted(cell[2]), []
    for k in range(60):
        start, goal = (studs[k % len(studs)], k // 3), (studs[(3 * k + 2) % len(studs)], k // 2)
        if start[0] == goal[0] or any(
            index >= len(cell[2][stud].alternatives) for stud, index in (start, goal)
        ):
            continue
        problem, clearance, _ = edge(cell, start, goal)
        free = plan_motion(problem, clearance, cell[1], seed=0, method="none")
        if free.certified is wanted:
            found.append((start, goal, free))
        if len(found) == count:
            return found
    raise AssertionError("the station holds too few such edges")


@pytest.fixture(scope="module")
def hard(cell):
    return first_edges(cell, False, 3)


def second_opinion(cell, motion, lines):
    """Smallest distance every 5 ms by the other engine, departure exemptions applied."""
    other = CollisionWorld(cell[0], engine="coal").clearance(*lines)
    times = np.arange(0.0, motion.duration_s, 0.005)
    return float(other.phi(motion.trajectory.sample(times).q_rad).min())


def test_line_knots_follow_the_grid():
    assert num_line_knots(20) == 1
    assert num_line_knots(40) == 2
    assert num_line_knots(8) == 1
    np.testing.assert_allclose(departure_fractions(1), [1.0])
    np.testing.assert_allclose(departure_fractions(2), [0.25, 1.0])


def nearest_poses(table):
    """The two poses of different studs between which the joints turn least."""
    pairs = [
        (a, b)
        for first, second in combinations(table.values(), 2)
        for a, b in product(first.alternatives, second.alternatives)
    ]
    return min(pairs, key=lambda pair: np.abs(pair[0].q_rad - pair[1].q_rad).max())


def test_the_cheapest_number_of_line_knots_is_taken(cell):
    station, _, table = cell
    seen = set()
    far = [
        (table[a].alternatives[0], table[b].alternatives[0])
        for a, b in (("S01", "S20"), ("S04", "S14"), ("S12", "S07"))
    ]
    for a, b in (*far, nearest_poses(table)):
        lines = line_through(a.line_rad), line_through(b.line_rad)
        plain = MotionProblem(station.robot, a.q_rad, b.q_rad, station.cost, 20)
        chosen = best_departure(plain, *lines).problem
        costs = [solve(with_departure(plain, *lines, 20, m)).cost for m in (1, 2, 3, 4)]
        assert len(chosen.depart_rad) == 1 + int(np.argmin(costs))
        fine = best_departure(plain, *lines, 40).problem
        assert fine.num_intervals == 40
        assert len(fine.depart_rad) == 2 * len(chosen.depart_rad)
        seen.add(len(chosen.depart_rad))
    assert len(seen) > 1


@pytest.mark.parametrize("num", [20, 40])
def test_the_guess_of_a_departure_saves_iterations(cell, num):
    station, _, table = cell
    cold, warm = 0, 0
    for first, second in (("S01", "S20"), ("S04", "S14"), ("S12", "S07")):
        a, b = table[first].alternatives[0], table[second].alternatives[0]
        lines = line_through(a.line_rad), line_through(b.line_rad)
        plain = MotionProblem(station.robot, a.q_rad, b.q_rad, station.cost)
        chosen = best_departure(plain, *lines, num)
        from_line, from_guess = solve(chosen.problem), solve(chosen.problem, guess=chosen.guess)
        assert from_guess.cost <= 1.02 * from_line.cost  # another optimum may be next to it
        cold, warm = cold + from_line.iterations, warm + from_guess.iterations
    assert warm < cold


def test_a_free_edge_is_its_obstacle_free_optimum(cell):
    start, goal, free = first_edges(cell, True, 1)[0]
    problem, clearance, _ = edge(cell, start, goal)
    motion = plan_motion(problem, clearance, cell[1], seed=0)
    assert motion.cost == free.cost
    assert motion.certified
    assert motion.source == "refined"


def test_blocked_edges_end_certified_with_a_small_defect(cell, hard):
    for start, goal, free in hard:
        problem, clearance, lines = edge(cell, start, goal)
        motion = plan_motion(problem, clearance, cell[1], seed=1)
        assert motion.certified, motion.note
        assert motion.status.ok
        assert motion.source == "refined"
        assert motion.max_defect <= 1e-6
        assert motion.cost > 0.98 * free.cost
        assert second_opinion(cell, motion, lines) > 0
        np.testing.assert_allclose(motion.trajectory.q_rad[1], problem.depart_rad[0], atol=1e-8)
        times = np.linspace(0, motion.duration_s, 800)
        tips = cell[1].tip_positions(motion.trajectory.sample(times).q_rad)
        assert line_stray_m(lines[0], tips) < cell[0].stray_m
        assert line_stray_m(lines[1], tips[::-1]) < cell[0].stray_m


def test_same_seed_same_motion_and_a_finer_grid_agrees(cell, hard):
    start, goal, _ = hard[0]
    problem, clearance, _ = edge(cell, start, goal)
    one = plan_motion(problem, clearance, cell[1], seed=5)
    two = plan_motion(problem, clearance, cell[1], seed=5)
    np.testing.assert_array_equal(one.trajectory.q_rad, two.trajectory.q_rad)
    fine, clearance, _ = edge(cell, start, goal, num_intervals=40)
    final = plan_motion(fine, clearance, cell[1], seed=5, quality="final", guess=one.trajectory)
    assert final.certified
    assert final.max_defect <= 1e-6
    assert final.cost == pytest.approx(one.cost, rel=0.04)


def test_boxes_end_certified(cell, hard):
    """The published formulation, with sub-points and repair."""
    start, goal, free = hard[0]
    problem, clearance, lines = edge(cell, start, goal)
    motion = plan_motion(
        problem, clearance, cell[1], seed=1, method="boxes", params=EdgeParams(num_paths=1)
    )
    assert motion.certified, motion.note
    assert motion.source == "refined"
    assert motion.cost > 0.98 * free.cost
    assert second_opinion(cell, motion, lines) > 0


def test_fallback_where_refinement_may_do_nothing(cell, hard):
    start, goal, _ = hard[0]
    problem, clearance, lines = edge(cell, start, goal)
    idle = RefineParams(max_outer=0, trust_rad=1e-6, repair_rounds=0)
    motion = plan_motion(
        problem, clearance, cell[1], seed=1, params=EdgeParams(num_paths=1, refine=idle)
    )
    assert motion.source == "fallback"
    assert motion.certified
    assert motion.max_defect is None
    assert second_opinion(cell, motion, lines) > 0


def test_an_end_in_collision_is_named(cell, hard):
    start, goal, _ = hard[0]
    problem, clearance, _ = edge(cell, start, goal)
    inside = problem.goal_rad.copy()
    inside[1] += 0.35
    blocked = problem.replace(goal_rad=inside, arrive_rad=None)
    motion = plan_motion(blocked, clearance, cell[1], seed=0)
    assert motion.status is Status.IN_COLLISION
    assert motion.trajectory is None
    assert motion.note.startswith("goal: ")


def test_a_goal_behind_a_closed_wall_is_unreachable_and_the_wall_is_named(tmp_path):
    """Bent to one side and to the other. In between joint 2 passes 0, and there the arm, whatever
    its other joints do, stands in the ceiling: no motion exists, from any seed, by any method.
    """
    robot = snake(tmp_path, 3, limit=1.5)
    start, goal = np.array([0.0, 1.4, 0.0]), np.array([0.0, -1.4, 0.0])
    closed = world_for(robot, (), (box("ceiling", (3, 3, 0.02), (0, 0, 0.75)),))
    turns = np.array(np.meshgrid(np.linspace(-1.5, 1.5, 31), [0.0], np.linspace(-1.5, 1.5, 31)))
    assert closed.collide_batch(turns.reshape(3, -1).T, -0.02).all()
    assert not closed.collide_batch(np.stack([start, goal]), 0.02).any()
    problem = MotionProblem(robot, start, goal, num_intervals=20)
    few = EdgeParams(max_iterations=150)
    for seed, quality, method in (
        (0, "screen", "halfspaces"),
        (1, "final", "halfspaces"),
        (0, "screen", "boxes"),
    ):
        motion = plan_motion(
            problem,
            closed.clearance(),
            closed,
            seed=seed,
            quality=quality,
            method=method,
            params=few,
        )
        assert motion.status is Status.NO_PATH
        assert not motion.status.ok
        assert motion.trajectory is None
        assert not motion.certified
        assert motion.cost == float("inf")
        assert motion.note.startswith("no path within 6 attempts of 150 iterations")
        assert "most often in the way: ceiling - " in motion.note
    # The wall and nothing else is the reason: with it raised, the same question has an answer.
    raised = world_for(robot, (), (box("ceiling", (3, 3, 0.02), (0, 0, 0.95)),))
    motion = plan_motion(problem, raised.clearance(), raised, seed=0, params=few)
    assert motion.certified, motion.note
    assert motion.trajectory.q_rad[:, 1].min() < -1.3 < 1.3 < motion.trajectory.q_rad[:, 1].max()


def test_a_final_motion_is_proven_to_keep_what_the_station_asks(cell, hard):
    """Between the knots as well; the judge samples a millisecond grid with another engine."""
    station, world, _ = cell
    for start, goal, _ in hard[:2]:
        problem, clearance, lines = edge(cell, start, goal)
        motion = plan_motion(problem, clearance, world, seed=1, quality="final")
        assert motion.proven_clearance_m == pytest.approx(station.clearance_m, abs=1e-9)
        assert motion.note == ""
        assert second_opinion(cell, motion, lines) > station.clearance_m - 1e-5
        loose = plan_motion(problem, clearance, world, seed=1)
        assert motion.cost == pytest.approx(loose.cost, rel=0.02)


def test_a_motion_that_cannot_keep_the_clearance_says_so(cell, hard):
    """Its ends are nearer than what is asked: certified, but with a note that names the pair."""
    station = cell[0]
    start, goal, _ = hard[0]
    wide = world_for(
        station.robot, station.tool_bodies, station.obstacles, station.allowed_collisions, 0.2
    )
    problem, _, lines = edge(cell, start, goal)
    clearance = wide.clearance(*lines)
    motion = plan_motion(problem, clearance, wide, seed=1, params=EdgeParams(num_paths=1))
    assert motion.certified
    assert 0.002 <= motion.proven_clearance_m < 0.2
    assert f"keep {1e3 * motion.proven_clearance_m:.1f} mm of the 200 mm asked for" in motion.note
    nearest = second_opinion(cell, motion, lines)
    assert nearest < 0.2
    assert motion.proven_clearance_m <= nearest + 1e-5
