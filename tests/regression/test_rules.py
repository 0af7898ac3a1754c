"""Rules that a recorded number guards too bluntly: each is broken by one small slip."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from ompl import geometric as og

from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointPath
from dmoc.refinement.boxes import box_half_widths
from dmoc.refinement.iterate import iterate_from_path
from dmoc.refinement.params import RefineParams
from dmoc.refinement.points import look, points_of
from dmoc.robot.robot import load_robot
from sequencing.cycle.baseline import time_based_sequences, time_costs
from sequencing.edges.nodes import StationNodes
from sequencing.gtsp.evolution import order_crossover
from studies.stud_welding.planar_world import PlanarWorld
from tests.regression.record import STATIONS, edge_row, read

WORLD = PlanarWorld([1.0, 0.8], [[1.35, 0.75]], [0.25])
PATH = JointPath(np.array([[-0.2, 0.3], [0.5, 2.2], [1.6, -0.3]]))


@pytest.mark.parametrize("fractions", [(0.0,), (0.0, 0.25, 0.5, 0.75)])
def test_no_point_of_the_robot_can_use_up_a_box(fractions) -> None:
    """n ‖Δq‖_{w,∞} ≤ φ − d_c: all joints at the rim of the box together move a point by at most the
    spare clearance, and with knots alone by exactly that."""
    problem = MotionProblem(load_robot("planar2"), *PATH.q_rad[[0, -1]], num_intervals=20)
    points = points_of(problem, fractions)
    iterate = iterate_from_path(problem, PATH)
    view = look(WORLD, iterate, points, 0.2)
    required, fixed = np.full(len(view.phi_m), 0.01), np.zeros(21, dtype=bool)
    params = RefineParams(trust_most_rad=1e3)
    half = box_half_widths(WORLD, view, points, required, fixed, params)
    free = view.phi_m > required
    weights = WORLD.weights(view.q_rad)
    moved = np.sum(weights * half[points.interval], axis=1)
    assert free.sum() > 10
    assert np.all(moved[free] <= (view.phi_m - required)[free] * (1 + 1e-9))
    if len(fractions) == 1:
        np.testing.assert_allclose(moved[free], (view.phi_m - required)[free])
        per_joint = weights.shape[1] * np.max(weights * half[points.interval], axis=1)
        np.testing.assert_allclose(per_joint[free], (view.phi_m - required)[free])


def hand_made_nodes() -> tuple[SimpleNamespace, StationNodes]:
    """Home and two studs; of the first, a pose turns one joint far, another all less."""
    robot = load_robot("ur10e_class")
    share = np.array([[0.5, 0, 0, 0, 0, 0], [0.4] * 6, [0.1] * 6, [0.0] * 6])
    nodes = StationNodes(
        q_rad=share * robot.velocity_limit_rad_s,
        line_end_rad=share * robot.velocity_limit_rad_s,
        weld_cost=np.zeros(4),
        cluster_of=np.array([0, 0, 1, 2]),
        stud=("S1", "S1", "S2", "home"),
        alternative=np.array([0, 1, 0, 0]),
        home=3,
        studs=("S1", "S2"),
    )
    return SimpleNamespace(robot=robot, precedence=(), name="hand"), nodes


def test_the_old_way_counts_the_slowest_joint_not_all_of_them() -> None:
    station, nodes = hand_made_nodes()
    times = time_costs(station, nodes)
    assert times[0, 3] == pytest.approx(0.5)
    assert times[1, 3] == pytest.approx(0.4)
    assert times[0, 2] == pytest.approx(0.4)
    assert times[1, 2] == pytest.approx(0.3)


def test_the_old_sequence_takes_the_pose_that_the_slowest_joint_reaches_first() -> None:
    station, nodes = hand_made_nodes()
    oracle = SimpleNamespace(
        station=station, nodes=nodes, costs={}, evaluate=lambda pairs: np.ones(len(pairs))
    )
    found = time_based_sequences(oracle, 3, 0)
    assert {1, 2, 3} == set(found[0].nodes)
    assert found[0].time_s == pytest.approx(0.4 + 0.3 + 0.1)


def test_a_planned_path_is_ompls_rrt_connect(monkeypatch) -> None:
    """The motion says so, and the planner is really asked."""
    asked, real = [], og.RRTConnect

    def counted(information):
        asked.append(information)
        return real(information)

    monkeypatch.setattr(og, "RRTConnect", counted)
    name = STATIONS[0]
    rows = [row for row in read(f"edges_{name}")["values"] if row["planner"] == "ompl"]
    assert edge_row(name, rows[0])["planner"] == "ompl"
    assert asked
    assert real(asked[0]).getName() == "RRTConnect"


@pytest.mark.parametrize(
    ("ordered", "pinned"), [(False, False), (False, True), (True, False), (True, True)]
)
def test_a_child_is_a_stretch_of_one_parent_and_the_order_of_the_other(ordered, pinned) -> None:
    """Parents without a common node: a child that has none of one of them is the other parent."""
    clusters, draw = 9, np.random.default_rng(4)
    cluster = np.repeat(np.arange(clusters), 2)
    shapes = set()
    for _ in range(200):
        one, two = (
            2 * np.concatenate([[0], 1 + draw.permutation(clusters - 1)]) + k for k in (0, 1)
        )
        child = order_crossover(one, two, cluster, ordered, pinned, draw)
        assert sorted(cluster[child]) == list(range(clusters))
        assert cluster[child[0]] == 0 or not (ordered or pinned)
        from_one = child % 2 == 0
        assert 0 < from_one.sum() < clusters
        shapes.add(int(from_one.sum()))
        # In place and in order (for a cycle: up to where it begins).
        for parent, mine in ((one, child[from_one]), (two, child[~from_one])):
            where = [int(np.flatnonzero(parent == v)[0]) for v in mine]
            drops = sum(b < a for a, b in zip(where, where[1:] + where[:1]))
            assert drops <= 1
        turn = np.flatnonzero(from_one != np.roll(from_one, 1))
        assert len(turn) == 2
    assert len(shapes) == clusters - 1
