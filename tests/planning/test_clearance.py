"""Gradients, weights and reach of the clearance, against differences and sampled points."""

import numpy as np
from scenes import clutter, random_q, snake

from dmoc.robot.robot import load_robot
from planning.collision.world import world_for

ROBOT = load_robot("ur10e_class")


def surface_points(world, q: np.ndarray) -> np.ndarray:
    """Corners and centres of all moving pieces at q, (P, 3)."""
    scene, points = world.scene, []
    scene.place(q)
    for p in range(scene.moving):
        piece, pose = scene.pieces[p], scene.pose[p]
        local = piece.vertices_m
        if piece.kind == "box":
            local = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T * piece.size_m
        elif piece.kind == "cylinder":
            angle = np.linspace(0, 2 * np.pi, 24)
            ring = np.column_stack([np.cos(angle), np.sin(angle)]) * piece.size_m[0]
            local = np.vstack(
                [np.column_stack([ring, np.full(24, z * piece.size_m[1] / 2)]) for z in (-1, 1)]
            )
        points.append(local @ pose[:9].reshape(3, 3).T + pose[9:12])
    return np.vstack(points)


def test_row_gradients_match_differences() -> None:
    """Where a row's distance is smooth, its gradient is the derivative of the pair's distance."""
    checked = 0
    for seed in range(3):
        world = world_for(ROBOT, (), clutter(seed))
        clearance = world.clearance()
        q = random_q(ROBOT, 30, seed)
        rows = clearance.rows(q, 0.2)
        near = world.scene.near(q, 0.2, clearance.scope)
        assert len(rows.knot) == len(rows.pair) == len(near.which)
        step = 1e-6
        for r in np.flatnonzero(near.values[:, 0] > 0.01)[:60]:
            k, m = near.which[r]
            assert rows.pair[r] == world.pair_of(m)
            for j in range(6):
                ahead, behind = q[k].copy(), q[k].copy()
                ahead[j] += step
                behind[j] -= step
                up, down = (world.scene.pair_distance(x, m) for x in (ahead, behind))
                slope = (up.distance_m - down.distance_m) / (2 * step)
                # coal's own distances carry 1e-6; witness points may jump on parallel faces.
                if np.linalg.norm(up.normal - down.normal) < 1e-3:
                    found = _native_slope(world, clearance, q[k], m, j, step)
                    assert abs(rows.gradient[r, j] - found) < 1e-4, (slope, found)
                    checked += 1
    assert checked > 200


def _native_slope(world, clearance, q, m, j, step) -> float:
    values = []
    for sign in (1, -1):
        moved = q.copy()
        moved[j] += sign * step
        near = world.scene.near(moved[None], 0.5, clearance.scope)
        values.append(near.values[near.which[:, 1] == m][0, 0])
    return (values[0] - values[1]) / (2 * step)


def test_gradient_points_out_of_penetration() -> None:
    """A step along the gradient of a penetrating row lifts its distance."""
    world = world_for(ROBOT, (), clutter(4))
    clearance = world.clearance()
    q = random_q(ROBOT, 60, 2)
    near = world.scene.near(q, 0.0, clearance.scope)
    better = []
    for (k, m), row in zip(near.which, near.values):
        gradient = row[10:]
        if np.linalg.norm(gradient) < 0.1:
            continue
        step = 1e-3 * gradient / (gradient @ gradient)
        lifted = world.scene.pair_distance(q[k] + step, m).distance_m
        better.append(lifted - row[0])
    assert len(better) > 20
    assert np.median(better) > 0.8e-3
    assert np.mean(np.array(better) > 0) > 0.9


def test_weights_and_reach_bound_every_point(tmp_path) -> None:
    for robot in (ROBOT, snake(tmp_path, 7)):
        world = world_for(robot, (), ())
        clearance = world.clearance()
        n = robot.num_joints
        for q in random_q(robot, 8, 1):
            points = surface_points(world, q)
            weights, reach = clearance.weights(q[None])[0], clearance.reach(q[None])[0]
            for j in range(n):
                step = np.zeros(n)
                step[j] = 1e-6
                slope = (surface_points(world, q + step) - points) / 1e-6
                assert weights[j] >= np.abs(slope).sum(axis=1).max() - 1e-5
                assert reach[j] >= np.linalg.norm(slope, axis=1).max() - 1e-5
                # Not needlessly large either.
                assert weights[j] <= 1.6 * np.abs(slope).sum(axis=1).max() + 0.1


def test_no_point_moves_farther_than_reach_times_step() -> None:
    """The bound that the certificate rests on, for large steps."""
    world = world_for(ROBOT, (), ())
    clearance = world.clearance()
    rng = np.random.default_rng(8)
    for q in random_q(ROBOT, 40, 6):
        reach = clearance.reach(q[None])[0]
        before = surface_points(world, q)
        for scale in (0.01, 0.3, 1.5):
            step = rng.uniform(-scale, scale, 6)
            moved = np.linalg.norm(surface_points(world, q + step) - before, axis=1).max()
            assert moved <= reach @ np.abs(step) + 1e-12
