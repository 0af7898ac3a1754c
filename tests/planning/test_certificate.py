"""The certificate: catches what lies between knots, and never proves what collides."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import box, clutter, quintic, random_q, snake

from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import load_robot
from planning.collision.certificate import bezier_of, certify, prove_path, sub_points
from planning.collision.departure_line import DepartureLine
from planning.collision.world import world_for
from planning.geometry.shapes import Body, Shape, pose_matrix

ROBOT = load_robot("ur10e_class")


def turn_past(tmp_path, obstacles, tool=()):
    """An outstretched arm in a world; joint 1 turns it about z."""
    robot = snake(tmp_path, 4)
    out = np.array([0.0, np.pi / 2, 0.0, 0.0])
    return world_for(robot, tool, obstacles), out


def test_bezier_control_points_give_the_trajectory_itself() -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.1, 1.0, 8))
    trajectory = JointTrajectory(
        t, rng.normal(size=(8, 6)), rng.normal(size=(8, 6)), np.zeros((7, 6))
    )
    times = np.concatenate([t[:-1, None] + np.diff(t)[:, None] * np.arange(4) / 4]).ravel()
    expected = trajectory.sample(np.append(times, t[-1])).q_rad
    assert np.allclose(sub_points(bezier_of(trajectory), 4), expected, atol=1e-12)


def test_a_plate_between_two_knots_is_caught(tmp_path) -> None:
    """Both knots are free, the plate stands between them: interval and pair are named."""
    plate = box("plate", (0.4, 0.002, 0.4), (0.7, 0.0, 0.4))
    world, arm = turn_past(tmp_path, (plate,))
    ends = np.array([arm, arm])
    ends[:, 0] = -0.4, 0.4
    q = np.vstack([ends[0], ends[0], ends[1]])
    trajectory = JointTrajectory(np.array([0.0, 1, 2]), q, np.zeros((3, 4)), np.zeros((2, 4)))
    clearance = world.clearance()
    assert np.all(clearance.phi(q) > 0.05)
    certificate = clearance.certify(trajectory)
    assert not certificate.ok
    assert {f.interval for f in certificate.failures} == {1}
    assert {f.pair[0] for f in certificate.failures} == {"plate"}
    failure = certificate.failures[0]
    at = trajectory.sample(1.0 + failure.fraction).q_rad[0]
    assert clearance.phi(at[None])[0] < 0.01
    assert not prove_path(clearance, q)
    without = world_for(world.robot, (), ()).clearance().certify(trajectory)
    assert without.ok
    assert without.failures == ()


def test_the_curve_is_judged_and_not_its_chord(tmp_path) -> None:
    """Knots and chord are free; the velocities swing the curve into the wall."""
    wall = box("wall", (0.6, 0.02, 0.4), (0.6, 0.35, 0.4))
    world, arm = turn_past(tmp_path, (wall,))
    q, t = np.vstack([arm, arm]), np.array([0.0, 2.0])
    clearance = world.clearance()
    still = JointTrajectory(t, q, np.zeros((2, 4)), np.zeros((1, 4)))
    assert clearance.certify(still).ok
    swing = np.zeros((2, 4))
    swing[:, 0] = 1.2, -1.2
    moving = JointTrajectory(t, q, swing, np.zeros((1, 4)))
    assert moving.sample(1.0).q_rad[0, 0] == pytest.approx(0.6)
    assert not clearance.certify(moving).ok


def test_tracking_error_inflates(tmp_path) -> None:
    wall = box("wall", (0.4, 0.02, 0.4), (0.7, 0.06, 0.4))
    world, arm = turn_past(tmp_path, (wall,))
    q = np.vstack([arm, arm + [0.0, 0.2, 0, 0]])
    trajectory = JointTrajectory(np.array([0.0, 1]), q, np.zeros((2, 4)), np.zeros((1, 4)))
    gap = world.clearance().phi(q).min()
    assert 0.01 < gap < 0.03
    assert world.clearance(tracking_error_m=gap - 0.002).certify(trajectory).ok
    assert not world.clearance(tracking_error_m=gap + 0.002).certify(trajectory).ok


def test_self_collision_is_caught(tmp_path) -> None:
    robot = snake(tmp_path, 6)
    world = world_for(robot)
    folded = np.array([0.0, 2.6, 0.0, 2.6, 0.0, 0.0])
    straight = np.zeros(6)
    if world.collide(folded) is None:
        pytest.skip("the fold does not touch")
    certificate = world.clearance().certify(quintic(straight, folded))
    assert not certificate.ok
    assert all(
        a.startswith("l") and b.startswith("l") for a, b in (f.pair for f in certificate.failures)
    )


@pytest.mark.parametrize("seed", range(4))
def test_what_is_certified_survives_a_dense_check_by_the_other_engine(seed: int) -> None:
    """1 kHz samples of certified random motions are free for fcl; failures name real contacts."""
    obstacles = clutter(seed)
    world = world_for(ROBOT, (), obstacles)
    judge = world_for(ROBOT, (), obstacles, engine="fcl")
    q = random_q(ROBOT, 400, seed)
    q = q[world.clearance().phi(q) > 0.02]
    outcome = {True: 0, False: 0}
    for a, b in zip(q[0:24:2], q[1:24:2]):
        b = a + 0.5 * (b - a)
        if world.collide(b, 0.01) is not None:
            continue
        trajectory = quintic(a, b)
        certificate = world.clearance().certify(trajectory)
        outcome[certificate.ok] += 1
        dense = trajectory.sample(np.linspace(0, 2.0, 2001)).q_rad
        touching = judge.collide_batch(dense[:: 1 if certificate.ok else 8])
        if certificate.ok:
            assert not touching.any()
            assert certificate.min_clearance_m > 0.002
        for failure in certificate.failures[:5]:
            t = trajectory.t_s[failure.interval] + 0.2 * failure.fraction
            at = world.clearance().phi(trajectory.sample(t).q_rad)[0]
            assert at < 0.005
    assert outcome[True] > 0


@pytest.mark.parametrize("clearance_m", [0.02, 0.1])
def test_the_proven_clearance_is_below_the_true_one_and_close(clearance_m: float) -> None:
    """Nothing of a dense sample is nearer than proven; where the demand is met, it is proven."""
    kept = close = 0
    for seed in (1, 2, 3):
        world = world_for(ROBOT, (), clutter(seed), clearance_m=clearance_m)
        clearance = world.clearance()
        q = random_q(ROBOT, 400, seed)
        q = q[clearance.phi(q) > 0.02]
        for a, b in zip(q[0:24:2], q[1:24:2]):
            trajectory = quintic(a, a + 0.4 * (b - a))
            certificate = clearance.certify(trajectory)
            if not certificate.ok:
                assert certificate.proven_clearance_m is None
                continue
            dense = trajectory.sample(np.linspace(0, trajectory.t_s[-1], 4001)).q_rad
            least = float(clearance.phi(dense).min())
            proven, seen = certificate.proven_clearance_m, certificate.min_clearance_m
            assert clearance.tracking_error_m <= proven <= clearance_m
            assert proven <= least + 1e-9
            # Seen is an upper bound of the true minimum (up to what 4001 samples miss).
            assert seen >= least - 1e-3
            if least > 1.06 * clearance_m:
                kept += 1
                assert proven == clearance_m
            elif least > clearance.tracking_error_m + 0.06 * clearance_m:
                close += 1
                assert proven > least - 0.1 * clearance_m - 0.003
                assert seen < least + 0.05 * clearance_m + 1e-3
    assert kept >= 3 or clearance_m > 0.05
    assert close >= 3


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_certified_means_free_for_random_curves(seed: int) -> None:
    """Property: random knots and velocities; certified curves keep their distance everywhere."""
    rng = np.random.default_rng(seed)
    world = world_for(ROBOT, (), clutter(seed, 4))
    clearance = world.clearance()
    q = random_q(ROBOT, 1, seed)[0] + np.cumsum(rng.normal(scale=0.08, size=(5, 6)), axis=0)
    trajectory = JointTrajectory(
        np.arange(5.0) * 0.3, q, rng.normal(scale=0.3, size=(5, 6)), np.zeros((4, 6))
    )
    certificate = clearance.certify(trajectory)
    phi = clearance.phi(trajectory.sample(np.linspace(0, 1.2, 600)).q_rad)
    if certificate.ok:
        assert phi.min() > clearance.tracking_error_m
    else:
        # A failure is contact up to the resolution of the bisection, never caution alone.
        fine = np.concatenate(
            [trajectory.sample(0.3 * (f.interval + f.fraction)).q_rad for f in certificate.failures]
        )
        assert clearance.phi(fine).min() <= clearance.tracking_error_m + 1e-3


def test_departure_line_is_handled_between_the_knots(tmp_path) -> None:
    """Straight along the line: proven. Sideways while still touching: refused."""
    tip = Body(
        "tip", (Shape("cylinder", (0.01, 0.3), pose=pose_matrix((0, 0, 0.3))),), touches=True
    )
    robot = snake(tmp_path, 6)
    q = np.array([0.0, 0.9, 0.0, 1.3, 0.0, 0.94159265])  # the last link points straight down
    flange = world_for(robot, (tip,)).tip_positions(q)[0]
    # The cylinder ends 0.45 m below the flange, 3 mm inside the sheet.
    sheet = box("sheet", (3.0, 3.0, 0.02), (0, 0, flange[2] - 0.457))
    world = world_for(robot, (tip,), (sheet,))
    assert world.collisions(q) == [("sheet", "tip")]
    up = np.array([0.0, 0.0, 1.0])
    line = DepartureLine(world.tip_positions(q)[0], up, 0.05, 0.01, "sheet")
    along = _follow(world, q, 0.04 * up)
    beside = _follow(world, q, 0.04 * np.array([1.0, 0, 0]))
    for path, good in ((along, True), (beside, False)):
        t = np.linspace(0, 1, len(path))
        v = np.gradient(path, t, axis=0)
        trajectory = JointTrajectory(t, path, v, np.zeros((len(path) - 1, 6)))
        assert world.clearance(line).certify(trajectory).ok == good
        assert world.clearance(None, line).certify(trajectory.reversed()).ok == good
        assert not world.clearance().certify(trajectory).ok


def _follow(world, q: np.ndarray, step: np.ndarray, parts: int = 9) -> np.ndarray:
    """Joint path whose tip moves straight by `step`, by damped Newton steps."""
    path, goal = [q], world.tip_positions(q)[0]
    for _ in range(parts - 1):
        goal = goal + step / (parts - 1)
        q = path[-1].copy()
        for _ in range(60):
            error = goal - world.tip_positions(q)[0]
            jacobian = np.column_stack(
                [
                    (world.tip_positions(q + 1e-6 * e)[0] - world.tip_positions(q)[0]) / 1e-6
                    for e in np.eye(len(q))
                ]
            )
            q = q + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-9 * np.eye(3), error)
        path.append(q)
    return np.array(path)


def test_a_nearly_endless_budget_changes_nothing_but_the_count() -> None:
    world = world_for(ROBOT, (), clutter(1))
    q = random_q(ROBOT, 200, 5)
    q = q[world.clearance().phi(q) > 0.05]
    trajectory = quintic(q[0], q[0] + 0.3 * (q[1] - q[0]))
    clearance = world.clearance()
    deep = certify(clearance, trajectory, max_depth=18)
    assert deep.ok == clearance.certify(trajectory).ok
    assert not certify(clearance, trajectory, max_depth=0).ok or deep.ok
