"""The refinement loop on the planar arm: half-spaces, boxes, backtracking, repair, fallback."""

import dataclasses
import itertools

import numpy as np
import pytest

from dmoc.errors import ProblemError
from dmoc.motion.clearance import Certificate, CertificateFailure
from dmoc.motion.motion import MotionProblem
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointPath
from dmoc.refinement import RefineParams, refine
from dmoc.robot.robot import load_robot
from studies.stud_welding.planar_world import PlanarWorld

WORLD = PlanarWorld([1.0, 0.8], [[1.35, 0.75]], [0.25])
PATH = JointPath(np.array([[-0.5, 0.3], [-0.5, 2.4], [1.6, 2.4], [1.6, -0.3]]))


@pytest.fixture(scope="module")
def problem():
    robot = load_robot("planar2")
    return MotionProblem(robot, PATH.q_rad[0], PATH.q_rad[-1], num_intervals=20)


@pytest.fixture(scope="module")
def halfspaces(problem):
    records = []
    return refine(problem, PATH, WORLD, trace=records.append), records


def dense_phi(motion):
    times = np.linspace(0, motion.duration_s, 4000)
    return WORLD.phi(motion.trajectory.sample(times).q_rad)


def test_the_scene_is_what_the_tests_think(problem):
    share = np.linspace(0, 1, 200)[:, None]
    legs = [a + share * (b - a) for a, b in itertools.pairwise(PATH.q_rad)]
    assert WORLD.phi(np.vstack(legs)).min() > 0.2
    free = refine(problem, None, WORLD, method="none")
    assert free.status is Status.UNCERTIFIED
    assert free.certified is False
    assert "disc_1" in free.note
    assert dense_phi(free).min() < 0


def test_half_spaces_end_certified_and_optimal(problem, halfspaces):
    motion, records = halfspaces
    assert motion.status is Status.CONVERGED
    assert motion.source == "refined"
    assert motion.certified
    assert dense_phi(motion).min() > WORLD.margin_m
    assert motion.max_defect <= 1e-6
    accepted = [r.cost for r in records if r.accepted]
    assert accepted[-1] < 0.85 * accepted[0]
    free = refine(problem, None, WORLD, method="none")
    assert motion.cost > free.cost


def test_refinement_is_deterministic(problem, halfspaces):
    again = refine(problem, PATH, WORLD)
    np.testing.assert_array_equal(again.trajectory.q_rad, halfspaces[0].trajectory.q_rad)
    assert again.cost == halfspaces[0].cost


def test_half_spaces_get_out_of_a_colliding_seed(problem, halfspaces):
    """The straight line drives through the disc; demands grow by `push_out_m` a step."""
    touching = JointPath(np.array([[-0.5, 0.3], [0.0, 2.0], [1.0, 2.2], [1.6, -0.3]]))
    motion = refine(problem, touching, WORLD)
    assert motion.certified
    assert motion.cost == pytest.approx(halfspaces[0].cost, rel=0.03)


def test_finer_grid_agrees(problem, halfspaces):
    fine = refine(problem.replace(num_intervals=40), halfspaces[0].trajectory, WORLD)
    assert fine.certified
    assert fine.cost == pytest.approx(halfspaces[0].cost, rel=0.03)


def test_boxes_with_sub_points_end_certified_but_dearer(problem, halfspaces):
    motion = refine(problem, PATH, WORLD, method="boxes", params=RefineParams(stop_fraction=1e-3))
    assert motion.certified
    assert motion.source == "refined"
    assert dense_phi(motion).min() > WORLD.margin_m
    assert halfspaces[0].cost * 0.999 <= motion.cost < 1.1 * halfspaces[0].cost


def test_paper_boxes_hold_the_knots_only(problem):
    """As printed: every knot keeps d_c; between the knots nothing is promised."""
    records = []
    refine(problem, PATH, WORLD, method="boxes", params=RefineParams.paper(), trace=records.append)
    accepted = [r for r in records if r.accepted]
    assert accepted
    for record in accepted:
        assert WORLD.phi(record.q_rad[1:-1]).min() >= RefineParams().clearance_m - 1e-6
        assert np.all(record.q_rad >= record.lower_rad - 1e-7)
        assert np.all(record.q_rad <= record.upper_rad + 1e-7)


def test_knot_only_boxes_tunnel_where_sub_points_do_not(problem):
    """A thin disc fits between two knots."""
    thin = PlanarWorld([1.0, 0.8], [[1.5, 0.55]], [0.02], link_radius_m=0.01)
    coarse = problem.replace(num_intervals=8)
    knots = refine(coarse, PATH, thin, method="boxes", params=RefineParams.paper())
    assert not (knots.certified and knots.source == "refined")
    rows = refine(coarse, PATH, thin)
    assert rows.certified
    assert rows.source == "refined"


@pytest.mark.parametrize(
    ("settings", "scale"), [(RefineParams.paper(), 0.3), (RefineParams(stop_fraction=1e-3), 0.1)]
)
def test_backtracking_fires_and_cures_wrong_weights(problem, settings, scale):
    """With weights of 0.3 the boxes are 3.3 times too wide: knots violate, boxes shrink. With
    sub-points a knot's box is the least of nine, which hides 0.3 but not 0.1."""
    wrong = dataclasses.replace(WORLD, weight_scale=scale)
    records = []
    motion = refine(problem, PATH, wrong, method="boxes", params=settings, trace=records.append)
    assert any(r.backtracks > 0 for r in records)
    for record in records:
        if record.accepted:
            assert WORLD.phi(record.q_rad[1:-1]).min() >= 0.02 - 1e-6
    right = refine(problem, PATH, WORLD, method="boxes", params=settings)
    accepted = [r.cost for r in records if r.accepted]
    assert accepted[-1] < 1.1 * right.cost
    if settings.fractions != (0.0,):
        assert motion.certified


class _Stubborn:
    """The planar world, but the certificate fails `times` times at one place."""

    def __init__(self, times):
        self.left, self.asked = times, []

    def __getattr__(self, name):
        return getattr(WORLD, name)

    def certify(self, trajectory):
        place = trajectory.sample(trajectory.t_s[9] + 0.4 * trajectory.t_s[1]).q_rad
        self.asked.append(float(WORLD.phi(place)[0]))
        if self.left:
            self.left -= 1
            failure = CertificateFailure(9, 0.4, ("link_2", "disc_1"), self.asked[-1])
            return Certificate(False, (failure,), self.asked[-1], 1)
        return WORLD.certify(trajectory)


def test_repair_moves_away_from_where_the_certificate_failed(problem):
    stubborn = _Stubborn(times=2)
    motion = refine(problem, PATH, stubborn)
    assert motion.certified
    assert len(stubborn.asked) == 3
    assert stubborn.asked[-1] >= min(stubborn.asked[0] + 0.01, 0.035)


def test_never_called_certified_against_the_certificate(problem):
    stubborn = _Stubborn(times=10**6)
    motion = refine(problem, PATH, stubborn, params=RefineParams(repair_rounds=1))
    assert motion.certified is False
    assert motion.status is Status.UNCERTIFIED
    assert not motion.status.ok
    assert "link_2 - disc_1" in motion.note


def test_fallback_is_the_certified_time_scaled_path(problem):
    """Refinement may not take a step: the path itself is what is left, and says so."""
    idle = RefineParams(max_outer=0, trust_rad=1e-6, repair_rounds=0)
    motion = refine(problem, PATH, WORLD, params=idle)
    assert motion.source == "fallback"
    assert motion.certified
    assert motion.status.ok
    assert motion.max_defect is None
    assert dense_phi(motion).min() > WORLD.margin_m
    np.testing.assert_allclose(motion.trajectory.q_rad[[0, -1]], PATH.q_rad[[0, -1]], atol=1e-9)
    limit = problem.robot.torque_limit_nm
    assert np.all(np.abs(motion.trajectory.torque_nm) <= limit * 1.001)
    best = refine(problem, PATH, WORLD)
    assert motion.cost > best.cost


def test_unknown_method_is_refused(problem):
    with pytest.raises(ProblemError, match="halfspaces"):
        refine(problem, PATH, WORLD, method="sphere")
