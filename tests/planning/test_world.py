"""The collision world: what touches, which pairs are looked at, what is refused."""

import numpy as np
import pytest
from scenes import box, clutter, random_q, snake

from dmoc.errors import InputError, MeshError, ProblemError
from dmoc.robot.robot import load_robot
from planning.collision.departure_line import DepartureLine, line_stray_m
from planning.collision.world import world_for
from planning.geometry.shapes import Body, Shape, pose_matrix

ROBOT = load_robot("ur10e_class")
GUN = (
    Body("gun", (Shape("box", (0.08, 0.08, 0.1), pose=pose_matrix((0, 0, 0.06))),)),
    Body("tip", (Shape("cylinder", (0.01, 0.1), pose=pose_matrix((0, 0, 0.16))),), touches=True),
)


def worlds(seed: int):
    return [world_for(ROBOT, GUN, clutter(seed), engine=e) for e in ("native", "coal", "fcl")]


def test_engines_agree_on_touching_and_distance() -> None:
    for seed in range(3):
        native, coal, fcl = worlds(seed)
        q = random_q(ROBOT, 150, seed)
        phi = [w.clearance().phi(q) for w in (native, coal, fcl)]
        apart = phi[1] > 1e-5
        assert 10 < apart.sum() < 145
        assert np.abs(phi[0] - phi[1])[apart].max() < 3e-6
        assert np.abs(phi[0] - phi[2])[apart].max() < 1e-3
        assert np.array_equal(phi[0] > 0, phi[1] > 0)
        for world, distance in zip((native, coal, fcl), phi):
            assert np.array_equal(world.collide_batch(q), distance <= 0)


def test_batch_single_and_named_pairs_agree() -> None:
    world = worlds(1)[0]
    q = random_q(ROBOT, 200, 3)
    touching = world.collide_batch(q, 0.01)
    for row, hit in zip(q, touching):
        pair = world.collide(row, 0.01)
        assert (pair is not None) == hit
        distance, nearest = world.distance(row, 0.3)
        assert (distance <= 0.01) == hit
        pairs = world.collisions(row, 0.01)
        assert bool(pairs) == hit
        if hit:
            assert pair in pairs
            assert world.distances(row, 0.3)[0] == (nearest, pytest.approx(distance, abs=1e-9))


def test_distances_are_capped() -> None:
    world = world_for(ROBOT, (), (box("far", (0.1, 0.1, 0.1), (5.0, 0, 0)),))
    q = random_q(ROBOT, 50, 0)
    capped = world.clearance(cap_m=0.05).phi(q)
    assert capped.max() <= 0.05
    free = world.clearance(cap_m=10.0).phi(q)
    assert np.allclose(capped, np.minimum(free, 0.05), atol=1e-9)


def test_sphere_inside_a_link_and_link_inside_a_box_collide(tmp_path) -> None:
    robot = snake(tmp_path, 4)
    q = np.zeros(4)
    middle = (0.0, 0.0, 0.9)  # inside the last link
    small = Body("small", (Shape("sphere", (0.005,), pose=pose_matrix(middle)),))
    for engine in ("native", "coal", "fcl"):
        assert world_for(robot, (), (small,), engine=engine).collide(q) == ("small", "l4")
        world = world_for(robot, (), (box("big", (6.0, 6.0, 6.0), (0, 0, 0)),), engine=engine)
        assert world.collide(q) is not None
        assert world.distance(q)[0] < -0.02


def test_pairs_leave_out_what_cannot_or_may_touch(tmp_path) -> None:
    robot = snake(tmp_path, 5)
    world = world_for(robot, (), (box("wall", (1, 1, 1), (3, 0, 0)),), [("wall", "l5")])
    pairs = {frozenset(p) for p in world.pairs}
    assert frozenset(("l1", "l2")) not in pairs  # neighbours
    assert frozenset(("l1", "l4")) in pairs
    assert frozenset(("wall", "l0")) not in pairs  # both stand still
    assert frozenset(("wall", "l5")) not in pairs  # allowed
    assert frozenset(("wall", "l4")) in pairs
    tool = (box("tool", (0.1, 0.1, 0.1), (0, 0, 0.3)),)
    world = world_for(robot, tool)
    assert ("l2", "tool") in world.pairs
    assert ("l4", "tool") in world.never_touching  # a tool is no link, but this one is short
    large = (box("tool", (0.1, 0.1, 0.5), (0, 0, 0.0)),)
    assert ("l4", "tool") in world_for(robot, large).pairs
    assert not any({"l5", "tool"} == set(p) for p in (*world.pairs, *world.never_touching))


def test_pairs_dropped_by_proof_never_touch() -> None:
    """Neighbours of the wrist stay apart in 2,000 random configurations and at the corners."""
    for name in ("ur10e_class", "irb6640_class"):
        robot = load_robot(name)
        world = world_for(robot)
        assert world.never_touching
        scene = world.scene
        pieces = {b: [i for i, p in enumerate(scene.pieces) if p.body == b] for b in scene.bodies}
        q = random_q(robot, 2000, 9)
        corners = np.array(np.meshgrid(*[[0, 1]] * 6)).reshape(6, -1).T
        q = np.vstack([q, robot.q_lower_rad + corners * (robot.q_upper_rad - robot.q_lower_rad)])
        for row in q:
            scene.place(row)
            for a, b in world.never_touching:
                for i in pieces[a]:
                    for k in pieces[b]:
                        assert not scene.engine.touches(i, k, scene.pose[i], scene.pose[k])
    # A pair that does touch somewhere is not dropped.
    assert ("link_2", "link_4") in world_for(load_robot("ur10e_class")).pairs


def test_clearance_of_one_pair_of_bodies() -> None:
    obstacles = clutter(2)
    plain = world_for(ROBOT, (), obstacles)
    wide = world_for(ROBOT, (), obstacles, pair_clearance_m={("thing_0", "wrist_3_link"): 0.1})
    name = next(b for _, b in plain.pairs if "wrist_3" in b or "link_6" in b)
    wide = world_for(ROBOT, (), obstacles, pair_clearance_m={("thing_0", name): 0.1})
    for q in random_q(ROBOT, 100, 4):
        before = dict(plain.distances(q, 0.5))
        after = dict(wide.distances(q, 0.4))
        key = ("thing_0", name)
        if key in before and before[key] < 0.45:
            assert after[key] == pytest.approx(before[key] - 0.1, abs=1e-9)
        for pair in before.keys() & after.keys() - {key}:
            assert after[pair] == pytest.approx(before[pair], abs=1e-9)


def test_bad_input_is_refused() -> None:
    world = world_for(ROBOT)
    for bad in (np.full(6, np.nan), np.zeros(5), np.full((2, 6), np.inf)):
        with pytest.raises(ProblemError):
            world.collide(bad)
    with pytest.raises(InputError, match="nowhere"):
        world_for(ROBOT, (), (), [("nowhere", "base_link")])
    with pytest.raises(InputError, match="used twice"):
        world_for(ROBOT, (), (clutter(0)[0], clutter(0)[0]))
    with pytest.raises(InputError, match="native, coal, fcl"):
        world_for(ROBOT, engine="bullet")
    with pytest.raises(MeshError, match="no shapes"):
        world_for(ROBOT, (), (Body("empty", ()),))
    flat = Shape("convex", vertices_m=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    with pytest.raises(MeshError, match="thickness"):
        world_for(ROBOT, (), (Body("flat", (flat,)),))
    soup = Shape("mesh", vertices_m=np.eye(3), faces=np.array([[0, 1, 2]]))
    with pytest.raises(MeshError, match="decompose"):
        world_for(ROBOT, (), (Body("soup", (soup,)),))
    with pytest.raises(MeshError, match="positive lengths"):
        world_for(ROBOT, (), (Body("thin", (Shape("box", (0.1, 0.0, 0.1)),)),))
    with pytest.raises(InputError, match="part"):
        world.collide(np.zeros(6), lines=[DepartureLine(np.zeros(3), np.eye(3)[2], 0.1)])


def test_departure_line_exempts_the_tip_inside_its_tube_only(tmp_path) -> None:
    robot = snake(tmp_path, 4)
    q = np.zeros(4)
    tool = (
        Body("tip", (Shape("cylinder", (0.01, 0.1), pose=pose_matrix((0, 0, 0.2))),), touches=True),
    )
    sheet = box("sheet", (1.0, 1.0, 0.02), (0, 0, 1.05))
    start = world_for(robot, tool, (sheet,)).tip_positions(q)[0]
    line = DepartureLine(start, np.array([0, 0, -1.0]), 0.03, 0.01, "sheet")
    other = DepartureLine(start + [0.05, 0, 0], np.array([0, 0, -1.0]), 0.03, 0.01, "sheet")
    for engine in ("native", "coal", "fcl"):
        world = world_for(robot, tool, (sheet,), engine=engine)
        assert world.collide(q) == ("sheet", "tip")
        assert world.collide(q, lines=[line]) is None
        assert world.collide(q, lines=[other]) == ("sheet", "tip")
        assert world.collide(q, lines=[other, line]) is None
        assert world.clearance(line).phi(q[None])[0] > 0
        assert world.clearance(None, other).phi(q[None])[0] < 0


def test_stray_from_a_line_is_measured_until_it_is_left() -> None:
    line = DepartureLine(np.zeros(3), np.array([0, 0, 1.0]), 0.1, 0.01, "part")
    z = np.linspace(0, 0.3, 61)
    tips = np.column_stack([0.05 * z, np.zeros(61), z])
    assert line_stray_m(line, tips) == pytest.approx(0.005, abs=1e-3)
    assert line_stray_m(line, tips[::-1]) == 0.0  # starts beyond the end
    with pytest.raises(ProblemError, match="unit vector"):
        DepartureLine(np.zeros(3), np.array([0, 0, 2.0]), 0.1)
