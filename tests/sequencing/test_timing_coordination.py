"""Coordination maps never call a collision free; the walk through them; the final check."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.robot.robot import load_robot
from planning.geometry.shapes import Body, Shape
from sequencing.timing.cell.read import Cell, CellRobot
from sequencing.timing.clearance.arms import arm_shapes, coal_solid, joint_frames
from sequencing.timing.clearance.segments import segment_distance
from sequencing.timing.clearance.swept import swept_path
from sequencing.timing.clearance.verify import check_schedule
from sequencing.timing.power.dc_link import LinkParams
from sequencing.timing.search.prepared import Geometry
from studies.pallet_cell.sampled_check import SampledCheck

LEFT = load_robot("ur10e_class")
RIGHT = LEFT.with_base(pin.SE3(pin.utils.rotate("z", np.pi), np.array([1.7, 0.0, 0.0])))
TOOL = (Body("tool", (Shape("box", (0.1, 0.1, 0.2), pose=np.eye(4)),)),)
# The arm at zero points along -x, so q1 near pi turns both towards each other.
LOW = np.array([2.2, -1.2, -0.9, -1.0, -1.0, -1.0])
HIGH = np.array([4.0, -0.3, 0.9, 1.0, 1.0, 1.0])


def crossing_cell(seed: int, count: int = 1, clearance_m: float = 0.0) -> Cell:
    rng = np.random.default_rng(seed)
    robots = []
    for name, robot in (("left", LEFT), ("right", RIGHT)):
        stops = rng.uniform(LOW, HIGH, (count + 1, 6))
        motions = tuple(trapezoid_motion(robot, a, b) for a, b in itertools.pairwise(stops))
        robots.append(
            CellRobot(name, robot, TOOL, motions, (robot,) * count, ("",) * count, (0.0,) * count)
        )
    return Cell("test", tuple(robots), (), (), (LinkParams(),), (0, 0), 0.0, clearance_m)


def dense_free(cell: Cell, start, override, total_s: float, samples: int = 300) -> bool:
    """Oracle: coal on every pair of exact solids at many instants."""
    import coal

    t = np.linspace(0, total_s, samples)
    placed = []
    for r, item in enumerate(cell.robots):
        shapes = arm_shapes(item.robot, item.tool_bodies)
        s = np.clip((t - start[r]) * override[r], 0, item.trajectories[0].duration_s)
        rotation, origin = joint_frames(item.robot, item.trajectories[0].sample(s).q_rad)
        placed.append((shapes, rotation, origin))

    def at(k, r, c):
        shapes, rotation, origin = placed[r]
        j, pose = shapes.joint[c], shapes.pose[c]
        return coal.Transform3s(
            rotation[k, j] @ pose[:3, :3], rotation[k, j] @ pose[:3, 3] + origin[k, j]
        )

    request, result = coal.CollisionRequest(), coal.CollisionResult()
    for k in range(samples):
        for a in range(len(placed[0][0].joint)):
            for b in range(len(placed[1][0].joint)):
                result.clear()
                coal.collide(
                    placed[0][0].solids[a],
                    at(k, 0, a),
                    placed[1][0].solids[b],
                    at(k, 1, b),
                    request,
                    result,
                )
                if result.isCollision():
                    return False
    return True


def test_a_free_map_is_free_in_the_dense_exact_check() -> None:
    seen = {True: 0, False: 0}
    for seed in range(6):
        cell = crossing_cell(seed)
        flat = np.array([t.duration_s for r in cell.robots for t in r.trajectories])
        total = 2.0 * flat.max()
        geometry = Geometry(cell)
        geometry.sharpen([(0, 1)])
        window = geometry.window([0, 1], total)
        rng = np.random.default_rng(seed)
        for _ in range(3):
            override = rng.uniform(0.6, 1.0, 2)
            start = rng.uniform(0, 1, 2) * (total - flat / override)
            free = bool(window.free(np.array([[start, override]]))[0])
            seen[free] += 1
            if free:
                assert dense_free(cell, start, override, total, 120)
    assert min(seen.values()) > 0


def test_exact_maps_only_ever_free_more_than_capsules() -> None:
    for seed in range(4):
        cell = crossing_cell(seed)
        geometry = Geometry(cell)
        rough = geometry.map(0, 1).blocked
        geometry.sharpen([(0, 1)])
        sharp = geometry.map(0, 1).blocked
        if rough is None:
            assert sharp is None
        elif sharp is not None:
            assert (sharp <= rough).all()


def test_capsules_cover_their_solids() -> None:
    import coal

    request, result = coal.DistanceRequest(), coal.DistanceResult()
    point = coal.Sphere(1e-6)
    for robot in (LEFT, load_robot("irb6640_class")):
        shapes = arm_shapes(robot, TOOL)
        rng = np.random.default_rng(0)
        for c, solid in enumerate(shapes.solids):
            pose = coal.Transform3s(shapes.pose[c][:3, :3], shapes.pose[c][:3, 3])
            low = shapes.ends_m[c].min(axis=0) - 1.5 * shapes.radius_m[c]
            high = shapes.ends_m[c].max(axis=0) + 1.5 * shapes.radius_m[c]
            for p in rng.uniform(low, high, (400, 3)):
                result.clear()
                place = coal.Transform3s(np.eye(3), p)
                if coal.distance(solid, pose, point, place, request, result) <= 0:
                    segment = shapes.ends_m[c]
                    gap = segment_distance(segment, np.array([p, p]))
                    assert gap <= shapes.radius_m[c] + 1e-5


def test_no_solid_moves_further_than_its_bound() -> None:
    motion = crossing_cell(3).robots[0].trajectories[0]
    shapes = arm_shapes(LEFT, TOOL)
    coarse = swept_path(LEFT, shapes, motion, 32)
    fine = swept_path(LEFT, shapes, motion, 3200)
    for k in range(32):
        inside = fine.ends_m[100 * k : 100 * (k + 1) + 1]
        moved = np.linalg.norm(inside - coarse.ends_m[k], axis=-1).max(axis=(0, 2))
        assert (moved <= coarse.travel_m[k + 1] - coarse.travel_m[k] + 1e-9).all()
    assert (fine.ends_m.min(axis=(0, 1, 2)) >= coarse.box_m[0]).all()
    assert (fine.ends_m.max(axis=(0, 1, 2)) <= coarse.box_m[1]).all()


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6))
def test_segment_distance_equals_the_sampled_minimum(seed) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    if seed % 5 == 0:
        b[1] = b[0]
    if seed % 7 == 0:
        b = a + rng.normal(size=3)
    s = np.linspace(0, 1, 101)
    p = a[0] + s[:, None] * (a[1] - a[0])
    q = b[0] + s[:, None] * (b[1] - b[0])
    sampled = np.linalg.norm(p[:, None] - q[None], axis=-1).min()
    found = segment_distance(a, b)
    assert found <= sampled + 1e-12
    assert found >= sampled - 0.02 * (np.linalg.norm(a[1] - a[0]) + np.linalg.norm(b[1] - b[0]))


def test_walk_and_final_check_agree_on_whole_schedules() -> None:
    agreed = {True: 0, False: 0}
    for seed in range(8):
        cell = crossing_cell(seed, count=3)
        flat = np.array([t.duration_s for r in cell.robots for t in r.trajectories])
        start = np.concatenate([np.cumsum([0, *flat[:2]]), np.cumsum([0, *flat[3:5]])])
        geometry = Geometry(cell)
        geometry.sharpen([(a, b) for a in range(3) for b in range(3, 6)])
        crossings = geometry.crossings(float(flat.sum()))
        meeting = crossings.collisions(start, np.ones(6))
        contacts = check_schedule(cell, start, np.ones(6), most=20)
        if not meeting:
            assert not contacts
        if any(c.distance_m <= 0.0 for c in contacts):
            assert meeting
        agreed[not meeting] += 1
    assert min(agreed.values()) > 0


def test_final_check_sees_a_collision_between_two_samples() -> None:
    # The left arm, stretched out, sweeps through the upright right arm once within 1.5 s.
    a, b = np.zeros(6), np.zeros(6)
    a[0], b[0] = 1.9, 4.4
    q = np.array([0.0, -np.pi / 2, 0.0, 0.0, 0.0, 0.0])
    left = CellRobot("left", LEFT, (), (trapezoid_motion(LEFT, a, b),), (LEFT,), ("",), (0.0,))
    near = LEFT.with_base(pin.SE3(pin.utils.rotate("z", np.pi), np.array([0.9, 0.0, 0.0])))
    hold = trapezoid_motion(near, q, q + np.array([0, 0, 0, 0, 0, 1e-3]))
    right = CellRobot("right", near, (), (hold,), (near,), ("",), (0.0,))
    cell = Cell("sweep", (left, right), (), (), (LinkParams(),), (0, 0), 0.0, 0.0)
    ends = np.array([0.0, left.trajectories[0].duration_s])
    assert dense_free(cell, np.zeros(2), np.ones(2), float(ends[1]), samples=2)
    contacts = check_schedule(cell, np.zeros(2), np.ones(2))
    assert any(c.distance_m <= 0.0 for c in contacts)


def test_unknown_shapes_are_refused() -> None:
    from dmoc.errors import ProblemError

    with pytest.raises(ProblemError, match="shape"):
        coal_solid(Shape("mesh", vertices_m=np.zeros((3, 3))))


def test_a_robot_that_stands_through_a_window_is_in_the_way() -> None:
    """The window's check against exact solids at many instants of the one that moves."""
    seen = {True: 0, False: 0}
    for seed in range(12):
        cell = crossing_cell(seed)
        geometry = Geometry(cell)
        geometry.sharpen([(0, 1)])
        for moving, still in ((0, 1), (1, 0)):
            for ended in (False, True):
                length = cell.robots[moving].trajectories[0].duration_s
                check = geometry.window([moving], length, [(still, ended)])
                free = bool(check.free(np.array([[[0.0, 0.0], [1.0, 1.0]]]))[0])
                assert free == (check.collisions(np.zeros(2), np.ones(2)) == [])
                path = cell.robots[still].trajectories[0].q_rad[-1 if ended else 0]
                t = np.linspace(0.0, length, 200)
                q = [np.repeat(path[None], 200, 0)] * 2
                q[moving] = cell.robots[moving].trajectories[0].sample(t).q_rad
                hit = SampledCheck(cell.robots, (), "capsules", "gjk").first_collision(q) >= 0
                assert not (free and hit)
                seen[free] += 1
    assert min(seen.values()) > 3


@pytest.mark.slow
def test_no_false_free_in_ten_thousand_random_timings() -> None:
    """Timings that the maps call free, at 200 instants each, against every pair of exact solids."""
    called, total = 0, 0
    for seed in range(20):
        cell = crossing_cell(seed)
        flat = np.array([t.duration_s for r in cell.robots for t in r.trajectories])
        length = 1.8 * flat.max()
        geometry = Geometry(cell)
        geometry.sharpen([(0, 1)])
        rng = np.random.default_rng([seed, 1])
        override = rng.uniform(0.4, 1.0, (500, 2))
        start = rng.uniform(0, 1, (500, 2)) * np.maximum(length - flat / override, 0.0)
        timing = np.stack([start, override], axis=1)
        free = geometry.window([0, 1], length).free(timing)
        total += len(free)
        check = SampledCheck(cell.robots, (), "capsules", "gjk")
        t = np.linspace(0, length, 200)
        for begin, speed in timing[free]:
            q = [
                item.trajectories[0].sample(
                    np.clip((t - b) * v, 0, item.trajectories[0].duration_s)
                )
                for item, b, v in zip(cell.robots, begin, speed)
            ]
            called += 1
            assert check.first_collision([state.q_rad for state in q]) < 0
    assert total == 10_000
    assert 1000 < called < 9000
