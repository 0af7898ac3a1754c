"""The stud-welding study on four studs: its figures agree with each other and do not change."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict, replace
from itertools import permutations, product
from types import SimpleNamespace

import numpy as np
import pytest

from dmoc.errors import InputError
from dmoc.motion.cost import Cost
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import load_robot
from sequencing.cycle_types import CycleCost
from sequencing.edges.nodes import StationNodes
from sequencing.edges.store import EdgeStore
from sequencing.runs.folder import read_run, write_run
from studies.command import STATIONS as COMMAND_STATIONS
from studies.stud_welding.changes import (
    CHANGES,
    FEW_CHANGES,
    compare_orders,
    keep_row,
    kept_row,
    rows_file,
)
from studies.stud_welding.departure import CHOSEN
from studies.stud_welding.model import Model, priced_nodes, scaled_masses
from studies.stud_welding.page import study_entry, write_study
from studies.stud_welding.search import best_poses, best_sequence, from_home, sequence_by
from studies.stud_welding.shares import shapley, with_poses
from studies.stud_welding.study import STATIONS, Budget, run_stud_welding_study, study_station
from studies.stud_welding.tables import stud_welding_markdown
from studies.stud_welding.trade_offs import mark_front
from studies.stud_welding.types import ChangeRow, TradeOff, Use
from studies.stud_welding.weights import WeightEdges, friction_cost

BUDGET = Budget(
    training_edges=8,
    coverage_edges=4,
    draws=2,
    edges_per_change=3,
    changes=("masses × 1.25", "time weight c_t × 10", "friction × 1"),
)


@pytest.fixture(scope="module")
def store_path(tmp_path_factory):
    return tmp_path_factory.mktemp("study") / "edges.sqlite"


@pytest.fixture(scope="module")
def run(store_path):
    with EdgeStore(store_path) as store:
        return run_stud_welding_study("A", store, reduced=True, budget=BUDGET)


@pytest.fixture(scope="module")
def study(run):
    return run.study


class FakeEdges:
    """Edges whose true costs are a table; some have no motion."""

    symmetric = True
    seed = 0

    def __init__(self, true) -> None:
        self.true, self.costs, self.asked = true, {}, 0

    def evaluate(self, pairs):
        for i, j in pairs:
            pair = (min(i, j), max(i, j))
            self.asked += pair not in self.costs
            self.costs[pair] = float(self.true[pair])
        return np.array([self.costs[min(i, j), max(i, j)] for i, j in pairs])

    def motions(self, pairs):
        raise AssertionError("costs only")

    def close(self) -> None:
        pass


def fake_model(seed: int, clusters: int = 4, poses: int = 3, holes: float = 0.0) -> Model:
    """Home and `clusters` studs with random costs; `holes` of the travels are impossible."""
    rng = np.random.default_rng(seed)
    size = clusters * poses + 1
    cost = rng.uniform(1.0, 10.0, (size, size))
    cost = np.minimum(cost, cost.T)
    cost[np.triu(rng.random((size, size)) < holes, 1)] = np.inf
    cost = np.triu(cost) + np.triu(cost, 1).T
    labels = np.repeat(np.arange(clusters + 1), poses)[:size]
    cost[labels[:, None] == labels[None, :]] = np.inf
    names = tuple("home" if v == size - 1 else f"S{labels[v]}" for v in range(size))
    weld = np.append(rng.uniform(0.0, 5.0, size - 1), 0.0)
    nodes = StationNodes(
        q_rad=rng.random((size, 2)),
        line_end_rad=rng.random((size, 2)),
        weld_cost=weld,
        cluster_of=labels,
        stud=names,
        alternative=np.arange(size),
        home=size - 1,
        studs=tuple(f"S{k}" for k in range(clusters)),
    )
    station = SimpleNamespace(name="fake", precedence=())
    return Model("fake", station, nodes, FakeEdges(cost), cost.copy())  # type: ignore[arg-type]


def naive_best(model: Model, order=None):
    """Least cost over all orders (or one) and all poses."""
    clusters = range(len(model.nodes.studs))
    home, best = model.nodes.home, np.inf
    for chosen in [order] if order is not None else permutations(clusters):
        layers = [np.flatnonzero(model.nodes.cluster_of == c) for c in chosen]
        for poses in product(*layers):
            cycle = (home, *poses)
            steps = zip(cycle, [*cycle[1:], cycle[0]])
            total = sum(model.edges.true[i, j] for i, j in steps)
            best = min(best, total + sum(model.nodes.weld_cost[v] for v in poses))
    return best


@pytest.mark.parametrize("seed", range(5))
def test_best_poses_of_an_order_equal_brute_force(seed: int) -> None:
    model = fake_model(seed, holes=0.1)
    guess = model.rough * np.random.default_rng(seed).uniform(0.9, 1.0, model.rough.shape)
    guess = np.where(np.isfinite(guess), np.minimum(guess, guess.T), 1.0)
    order = [2, 0, 3, 1]
    cycle = best_poses(model, guess, [4, *order])
    assert cycle is not None
    assert [int(model.nodes.cluster_of[v]) for v in cycle] == [4, *order]
    cost = model.cost_of(cycle)
    assert cost is not None
    # A way through the poses is kept only once it is solved throughout and still the cheapest
    # under estimates; with estimates that stray by 10 % it may miss the best by as much.
    assert naive_best(model, order) <= cost.total <= 1.15 * naive_best(model, order)
    exact = best_poses(fake_model(seed, holes=0.1), model.rough, [4, *order])
    assert exact is not None
    found = model.cost_of(exact)
    assert found is not None
    assert found.total == pytest.approx(naive_best(model, order), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_search_solves_few_edges_and_is_never_dearer_than_what_it_is_given(seed: int) -> None:
    model = fake_model(seed)
    given = (12, 0, 3, 6, 9)
    found = best_sequence(model, model.rough, [given], limit=40, gap=0.0)
    assert found is not None
    first = model.cost_of(given)
    assert first is not None
    assert found.cost.total <= first.total
    assert found.cost.total == pytest.approx(naive_best(model), rel=1e-6)
    assert model.edges.asked < len(model.nodes.usable_pairs())


def test_old_poses_can_be_reordered_alone() -> None:
    model = fake_model(3)
    given = (12, 1, 4, 7, 10)
    found = best_sequence(model, model.rough, [given], limit=40, gap=0.0, only=given)
    assert found is not None
    assert set(found.nodes) == set(given)
    assert found.nodes[0] == 12


def test_a_sequence_by_estimate_avoids_travels_without_motion() -> None:
    model = fake_model(1, holes=0.3)
    cycle = sequence_by(model, np.ones(model.rough.shape))
    assert cycle is None or model.cost_of(cycle) is not None


def test_shapley_parts_add_up_and_favour_none() -> None:
    cost = {
        "": 100.0,
        "a": 90.0,
        "b": 80.0,
        "c": 99.0,
        "a+b": 60.0,
        "a+c": 85.0,
        "b+c": 80.0,
        "a+b+c": 50.0,
    }
    parts = shapley(("a", "b", "c"), cost)
    assert sum(parts.values()) == pytest.approx(50.0)
    # Mean over the six orders, by hand: b gives 20, 30, 20, 5, 30, 35 … on its places.
    by_orders = dict.fromkeys("abc", 0.0)
    for order in permutations("abc"):
        done: list[str] = []
        for part in order:
            before = cost["+".join(sorted(done))]
            done.append(part)
            by_orders[part] += (before - cost["+".join(sorted(done))]) / 6.0
    assert parts == pytest.approx(by_orders)


def test_mixed_sequences_take_order_and_poses_from_where_they_should() -> None:
    model = fake_model(0)
    assert with_poses(model, (12, 0, 3, 6, 9), (12, 10, 7, 4, 1)) == (12, 1, 4, 7, 10)


def test_neighbours_are_compared_without_direction() -> None:
    model = fake_model(0)
    forward, back = (12, 0, 3, 6, 9), (12, 9, 6, 3, 0)
    assert compare_orders(model, forward, model, back) == (100.0, 4)
    share, alike = compare_orders(model, forward, model, (12, 3, 0, 6, 10))
    assert 0 < share < 100
    assert alike == 3


def test_the_front_holds_what_nothing_beats() -> None:
    def point(time, energy):
        return TradeOff("", "new", None, Use(time, time, 0.0, 0.0, 0.0, energy))

    marked = mark_front(
        [point(1, 9), point(2, 5), point(3, 6), point(2, 5)], lambda use: use.total_j
    )
    assert [p.on_front for p in marked] == [True, True, False, True]


def test_cycles_begin_at_home() -> None:
    assert from_home((3, 1, 7, 2), 7) == (7, 2, 3, 1)
    assert from_home((3, 1), None) == (3, 1)


def test_scaled_masses_scale_gravity_and_weld_costs() -> None:
    station = study_station("A", reduced=True)
    robot = scaled_masses(station.robot, 1.25)
    q = np.array([0.1, 0.3, -0.2, 0.4, 0.5, 0.6])
    np.testing.assert_allclose(
        robot.gravity_torque_nm(q), 1.25 * station.robot.gravity_torque_nm(q), atol=1e-6
    )


def test_new_is_not_dearer_than_old_and_all_motions_are_certified(run) -> None:
    assert run.study.new.total <= run.study.old.total
    for cycle in (run.new, run.old):
        assert cycle.certified == len(cycle.motions)
        assert sorted(w.stud for w in cycle.welds) == ["S01", "S06", "S11", "S16"]
    assert run.new.tables == run.old.tables
    assert run.study.saving_percent == pytest.approx(run.new.tables.saving_percent)


def test_the_ablation_starts_at_the_old_and_ends_at_the_new(study) -> None:
    first, *middle, last = study.ablation
    assert first.against_old_percent == 0.0
    assert last.against_new_percent == 0.0
    assert len(middle) == 5
    by_name = {row.name: row.cost for row in study.ablation}
    old = first.cost.total
    assert by_name["old poses, best order"].total <= old + 1e-9
    assert by_name["old order, best poses"].total <= old * (1 + 1e-9)
    static = by_name["old order, cheapest weld pose of each stud"]
    assert static.welding == pytest.approx(sum(row.lowest_cost for row in study.studs))


def test_shares_add_up_to_the_saving(study) -> None:
    assert len(study.shares) == 2
    for shares in study.shares:
        assert sum(shares.parts.values()) == pytest.approx(shares.total, abs=1e-9)
    same, fast = study.shares
    assert fast.costs["motions"] == same.costs[""]
    assert fast.costs["poses+order+motions"] == same.costs["poses+order"]
    # A motion made for J is not dearer than the same path at full speed.
    assert fast.costs[""] >= fast.costs["motions"]


def test_every_change_is_priced_and_never_regrets_less_than_nothing(study) -> None:
    assert [row.name for row in study.changes] == list(BUDGET.changes)
    for row in study.changes:
        assert row.regret_percent >= -1e-9
        assert row.best.total <= row.old.total + 1e-9
        assert 0 <= row.same_poses <= 4
        assert sorted(row.order) == ["S01", "S06", "S11", "S16"]
    masses = study.changes[0]
    assert masses.nominal.welding > study.new.welding


def test_a_nominal_motion_stays_where_it_is_cheaper_under_other_weights() -> None:
    """Edge (0, 1): the solve under the new weights is the worse optimum; (0, 2): the better one;
    (1, 2): the nominal station has no motion."""
    times, way = np.array([0.0, 0.5, 1.0]), np.array([[0.0], [0.2], [0.5]])
    nominal_motion = SimpleNamespace(
        cost=10.0, trajectory=SimpleNamespace(t_s=times, q_rad=way, duration_s=1.0)
    )

    def model(costs, motion, **weights):
        edges = SimpleNamespace(
            seed=0,
            costs=costs,
            motions=lambda pairs: [motion] * len(pairs),
            evaluate=lambda pairs: [costs[tuple(pair)] for pair in pairs.tolist()],
        )
        return SimpleNamespace(edges=edges, station=SimpleNamespace(cost=Cost(**weights)))

    nominal = model({(0, 1): 10.0, (0, 2): 10.0, (1, 2): np.inf}, nominal_motion)
    changed = model({(0, 1): 9.9, (0, 2): 9.0, (1, 2): 7.0}, "solved", time=0.5, velocity=2.0)
    edges = WeightEdges(changed, nominal)
    price = 10.0 - 0.5 * 1.0 + 1.0 * (0.2**2 + 0.3**2) / 0.5
    pairs = np.array([[1, 0], [0, 2], [1, 2]])
    assert edges.evaluate(pairs).tolist() == pytest.approx([price, 9.0, 7.0])
    assert edges.motions(pairs) == [nominal_motion, "solved", "solved"]


def test_faster_weights_make_faster_cycles(study) -> None:
    points = {(p.name, p.sequence): p.use for p in study.trade_offs}
    nominal, quick = points["nominal weights", "new"], points["time weight c_t × 10", "new"]
    full = points["full speed", "new"]
    assert full.duration_s < quick.duration_s < nominal.duration_s
    assert nominal.net_j <= nominal.drive_j <= nominal.total_j
    assert any(p.on_front for p in study.trade_offs)


def test_leaving_on_a_line_costs_and_a_stop_is_no_line(study) -> None:
    rows = {row.name: row for row in study.departures}
    assert rows["no line (no gun can)"].ratio == 1.0
    assert all(row.ratio >= 1.0 for row in study.departures)
    chosen = rows.pop(CHOSEN)
    fixed = [row for name, row in rows.items() if name.startswith("line in")]
    assert all(chosen.travel[k] <= row.travel[k] for row in fixed for k in chosen.travel)
    speeds = [row.end_speed_m_s for row in list(rows.values())[1:]]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-2] <= chosen.end_speed_m_s <= speeds[0]


def test_the_study_again_reads_its_edges_and_says_the_same(run, store_path, tmp_path) -> None:
    with EdgeStore(store_path) as store:
        before = len(store)
        rows = store.path.with_name("change_rows.json")
        kept = rows.read_bytes()
        names = {row["name"] for row in json.loads(kept).values()}
        assert names == {row.name for row in run.study.changes if row.group != "friction"}
        again = run_stud_welding_study("A", store, reduced=True, budget=BUDGET)
        assert len(store) == before
        assert rows.read_bytes() == kept
    assert again.study == run.study
    write_run(run.new, tmp_path, timing={})
    assert read_run(tmp_path).result["tables"]["saving_percent"] == run.study.saving_percent


def test_the_files_of_a_study(study, tmp_path) -> None:
    files = write_study(study, tmp_path)
    entry = json.loads((tmp_path / "study.json").read_text())
    assert entry == json.loads(json.dumps(json.loads((tmp_path / "study.json").read_text())))
    assert entry["saving_percent"] == study.saving_percent
    assert study_entry(study)["old"] == asdict(study.old)
    with (tmp_path / "tables" / "ablation.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["j_total"]) for row in rows] == [r.cost.total for r in study.ablation]
    page = (tmp_path / "study.html").read_text()
    assert page.count("<img") == 7
    assert "http" not in page.replace("http-equiv", "")
    again = {path: path.read_bytes() for path in files}
    write_study(study, tmp_path)
    assert all(path.read_bytes() == data for path, data in again.items())


def test_a_sequence_without_a_motion_is_a_dash_in_the_tables(study) -> None:
    row = replace(study.ablation[1], cost=None, against_old_percent=None, against_new_percent=None)
    text = stud_welding_markdown(replace(study, ablation=(study.ablation[0], row)))
    assert f"| {row.name} | – | – | – | – | – |" in text


def test_friction_raises_the_price_of_lifting_by_what_the_formula_says() -> None:
    robot = load_robot("irb6640_class")
    drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 5)
    curve = SimpleNamespace(
        t_s=t, q_rad=rng.normal(size=(5, 6)), torque_nm=1000 * rng.normal(size=(4, 6))
    )
    cost, expected = Cost(), 0.0
    for k in range(4):
        speed = (curve.q_rad[k + 1] - curve.q_rad[k]) / 0.25
        friction = 2.0 * (drive.coulomb_nm * np.sign(speed) + drive.viscous_nm_s * speed)
        with_it = np.sum((curve.torque_nm[k] + friction) ** 2)
        expected += 0.25 * 1e-6 * (with_it - np.sum(curve.torque_nm[k] ** 2))
    assert friction_cost(curve, cost, drive, 2.0) == pytest.approx(expected)  # type: ignore[arg-type]


def test_weights_change_weld_costs_only_where_they_hold(study) -> None:
    station = study_station("A", reduced=True)
    model = fake_model(0)
    nodes = replace(
        model.nodes, q_rad=np.zeros((13, 6)), stud=(*(["S01"] * 12), "home"), studs=("S01",)
    )
    priced = priced_nodes(nodes, station.replace(cost=Cost(time=3.0, effort=0.0)))
    np.testing.assert_allclose(priced.weld_cost, [*([6.0] * 12), 0.0])
    assert isinstance(study.new, CycleCost)


def test_names_that_two_places_share() -> None:
    assert COMMAND_STATIONS == STATIONS
    assert set(FEW_CHANGES) <= {change.name for change in CHANGES}
    assert len({change.name for change in CHANGES}) == len(CHANGES)


def test_rows_are_kept_beside_the_store_and_damage_is_named(tmp_path) -> None:
    with EdgeStore(tmp_path / "edges.sqlite") as store:
        path = rows_file(store)
        row = ChangeRow(
            "masses",
            "masses × 2",
            CycleCost(1.5, 2.0),
            None,
            CycleCost(0.1, 0.2),
            None,
            3.0,
            None,
            0.9,
            50.0,
            2,
            ("S1", "S2"),
            7,
            Use(1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
            None,
            "none",
        )
        keep_row(path, "a", row)
        keep_row(path, "b", replace(row, edges=8))
        assert kept_row(path, "a") == row
        assert kept_row(path, "b").edges == 8
        assert kept_row(path, "c") is None
        assert len(store) == 0
    path.write_text("{")
    with pytest.raises(InputError, match="rows-damaged"):
        kept_row(path, "a")
