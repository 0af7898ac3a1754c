"""The whole way on a small station: certified cycle, resumable, equal whatever runs the edges."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise, permutations, product
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from mujoco_arm import mujoco_model

from planning.collision.second_look import SecondLook, Touch
from planning.collision.world import CollisionWorld
from planning.station.build import demo_station
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing import gtsp
from sequencing.cycle.baseline import middle_place, undirected
from sequencing.cycle.lazy import LazyStop, solve_lazily
from sequencing.cycle.plan import NoCycle, PlanStop, plan_station
from sequencing.cycle_types import Cycle
from sequencing.edges.nodes import station_nodes
from sequencing.edges.oracle import StationEdges
from sequencing.edges.store import EdgeStore
from sequencing.runs.folder import write_run

STOP = PlanStop(training_edges=10, coverage_edges=6, baseline_draws=2)


def small_station(count: int = 3, spin_steps: int = 3) -> Station:
    whole = demo_station("stud_welding_a_8")
    return replace(whole, studs=whole.studs[:count], spin_steps=spin_steps, precedence=())


@pytest.fixture(scope="module")
def station() -> Station:
    return small_station()


@pytest.fixture(scope="module")
def store_path(tmp_path_factory):
    return tmp_path_factory.mktemp("store") / "edges.sqlite"


@pytest.fixture(scope="module")
def cycle(station, store_path) -> Cycle:
    return plan_station(station, stop=STOP, store=store_path)


def test_every_stud_once_and_home_at_both_ends(cycle, station) -> None:
    assert sorted(weld.stud for weld in cycle.welds) == sorted(stud.id for stud in station.studs)
    assert [m.origin for m in cycle.motions[1:]] == [w.stud for w in cycle.welds]
    assert [m.target for m in cycle.motions[:-1]] == [w.stud for w in cycle.welds]
    assert cycle.motions[0].origin == cycle.motions[-1].target == "home"
    assert [m.kind for m in cycle.motions] == ["home", "travel", "travel", "home"]


def test_every_motion_is_certified_and_meets_the_discrete_equations(cycle) -> None:
    for item in cycle.motions:
        assert item.motion.certified
        if item.motion.source == "refined":
            assert item.motion.max_defect <= 1e-6
            assert item.motion.trajectory.num_intervals == 40


def test_a_motion_that_the_second_engine_refuses_is_not_delivered(
    cycle, station, store_path, monkeypatch
) -> None:
    assert cycle.second_look.motions == len(cycle.motions)
    assert cycle.second_look.contacts == 0
    bad = cycle.motions[1]
    ends = bad.motion.trajectory.q_rad[[0, -1]]

    def touch(look, trajectory, lines):
        again = trajectory.q_rad[[0, -1]]
        same = np.allclose(again, ends) or np.allclose(again[::-1], ends)
        return Touch(("clamp_1", "gun_tip"), 0.5) if same else None

    monkeypatch.setattr(SecondLook, "touch", touch)
    other = plan_station(station, stop=STOP, store=store_path)
    assert all(m.motion.certified for m in other.motions)
    for item in other.motions:
        found = item.motion.trajectory.q_rad[[0, -1]]
        assert not np.allclose(found, ends)
        assert not np.allclose(found[::-1], ends)
    assert other.second_look.contacts == 0
    (text,) = other.second_look.refused
    assert "clamp_1 and gun_tip in contact at 0.500 s" in text
    assert {bad.origin, bad.target} == set(text.split(":")[0].split(" → "))


def test_motions_join_at_rest(cycle) -> None:
    poses = {weld.stud: weld.q_rad for weld in cycle.welds} | {"home": cycle.station.home_rad}
    for item in cycle.motions:
        trajectory = item.motion.trajectory
        np.testing.assert_allclose(trajectory.q_rad[0], poses[item.origin], atol=1e-9)
        np.testing.assert_allclose(trajectory.q_rad[-1], poses[item.target], atol=1e-9)
        assert np.abs(trajectory.velocity_rad_s[[0, -1]]).max() < 1e-6


def test_another_engine_sees_no_contact_away_from_the_welds(cycle, station) -> None:
    world = CollisionWorld(station, engine="fcl")
    for item in cycle.motions:
        trajectory = item.motion.trajectory
        times = np.arange(0.0, trajectory.duration_s, 0.01)
        away = (times > 0.3) & (times < trajectory.duration_s - 0.3)
        for q in trajectory.sample(times[away]).q_rad:
            assert world.collide(q) is None


def test_mujoco_drives_the_motions_of_the_cycle(cycle) -> None:
    """Open loop over four intervals, and the whole motion with a controller's feedback."""
    model = cycle.station.robot.model
    data = model.createData()
    for item in cycle.motions:
        trajectory = item.motion.trajectory
        steps = 8
        h = trajectory.duration_s / trajectory.num_intervals / steps
        arm = mujoco_model(model, h)
        state, worst = mujoco.MjData(arm), 0.0
        for k in range(0, trajectory.num_intervals, 4):
            state.qpos[:], state.qvel[:] = trajectory.q_rad[k], trajectory.velocity_rad_s[k]
            for j in range(4):
                state.qfrc_applied[:] = trajectory.torque_nm[k + j]
                mujoco.mj_step(arm, state, steps)
            worst = max(worst, float(np.abs(state.qpos - trajectory.q_rad[k + 4]).max()))
        assert worst < 0.02
        assert item.motion.replay_error_rad == pytest.approx(worst, rel=0.05, abs=1e-4)
        state.qpos[:], state.qvel[:] = trajectory.q_rad[0], trajectory.velocity_rad_s[0]
        strayed, width = 0.0, 15.0
        for i in range(trajectory.num_intervals * steps):
            wanted = trajectory.sample(trajectory.t_s[0] + i * h)
            error, slip = wanted.q_rad[0] - state.qpos, wanted.velocity_rad_s[0] - state.qvel
            push = wanted.acceleration_rad_s2[0] + width**2 * error + 2 * width * slip
            state.qfrc_applied[:] = pin.rnea(model, data, state.qpos, state.qvel, push)
            mujoco.mj_step(arm, state)
            strayed = max(strayed, float(np.abs(error).max()))
        assert strayed < 5e-3


def test_costs_add_up(cycle) -> None:
    tables = cycle.tables
    travel = sum(item.motion.cost for item in cycle.motions)
    welding = sum(weld.cost for weld in cycle.welds)
    assert tables.energy_based.travel == pytest.approx(travel)
    assert tables.energy_based.welding == pytest.approx(welding)
    station = cycle.station
    for weld in cycle.welds:
        torque = station.robot.gravity_torque_nm(weld.q_rad)
        rate = station.cost.time + station.cost.effort * float(torque @ torque)
        assert weld.cost == pytest.approx(weld.time_s * rate)


def test_new_is_no_worse_than_old_and_bounds_hold(cycle) -> None:
    assert cycle.tables.energy_based.total <= cycle.tables.time_based.total * 1.01
    assert cycle.search.bound_is_proven
    assert cycle.search.lower_bound <= cycle.tour.cost * (1 + 1e-9)


def test_the_old_method_never_looks_worse_than_its_median(cycle) -> None:
    assert [middle_place(count) for count in range(1, 7)] == [0, 0, 1, 1, 2, 2]
    totals = sorted(cycle.tables.time_based_totals)
    assert cycle.tables.time_based.total == totals[middle_place(len(totals))]


def test_a_cycle_driven_backwards_is_no_other_sequence() -> None:
    way = (4, 7, 1, 9)
    assert undirected(way) == undirected((1, 9, 4, 7)) == undirected((9, 1, 7, 4)) == (1, 7, 4, 9)
    assert undirected(way) != undirected((4, 1, 7, 9))
    assert undirected((3,)) == (3,)


def test_a_second_run_solves_nothing_and_gives_the_same_bytes(
    cycle, station, store_path, tmp_path
) -> None:
    with EdgeStore(store_path) as store:
        before = len(store)
        again = plan_station(station, stop=STOP, store=store)
        assert len(store) == before
    write_run(cycle, tmp_path / "a", {})
    write_run(again, tmp_path / "b", {})
    for name in ("result.json", "motions.npz", "tables.md"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_two_processes_give_the_same_bytes(cycle, station, tmp_path) -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as executor:
        parallel = plan_station(
            station, stop=STOP, store=tmp_path / "edges.sqlite", executor=executor
        )
    write_run(cycle, tmp_path / "a", {})
    write_run(parallel, tmp_path / "b", {})
    for name in ("result.json", "motions.npz"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_an_edited_stud_solves_its_own_travels_and_lists_what_was_reused(
    cycle, station, store_path
) -> None:
    """Moved by a centimetre: the travels between the others come from the store, all of them."""
    events = []
    moved = replace(station.studs[0], position_m=station.studs[0].position_m + [0.0, 0.01, 0.0])
    edited = replace(station, studs=(moved, *station.studs[1:]))
    with EdgeStore(store_path) as store:
        before = len(store)
        changed = plan_station(edited, stop=STOP, store=store, progress=events.append)
        new = len(store) - before
    reuse = events[-1].reuse
    assert events[-1].phase == "done"
    assert changed.certified == len(changed.motions)
    assert new >= len(reuse.solved) > 0
    others = {f"{stud.id}/" for stud in station.studs[1:]} | {"home"}
    untouched = [
        pair
        for pair in (*reuse.reused, *reuse.solved)
        if all(end == "home" or f"{end.split('/')[0]}/" in others for end in pair)
    ]
    # The draw of edges does not move with the edit, so those between the others were solved before
    # unless the search, with other costs, asks for one more.
    assert len(set(untouched) & set(reuse.reused)) >= 0.7 * len(untouched)
    assert not [pair for pair in reuse.reused if f"{moved.id}/" in str(pair)]
    assert moved.id in reuse.summary()


def test_lazy_finds_the_optimum_of_the_full_matrix(tmp_path) -> None:
    """Every edge solved and every tour enumerated: nothing is cheaper than what lazy finds."""
    with _few_alternatives(4, 2, tmp_path) as oracle:
        nodes = oracle.nodes
        base = nodes.problem(np.zeros((nodes.num_nodes,) * 2), oracle.station)
        lazy = solve_lazily(base, oracle, LazyStop(0.0), symmetric=True)
        oracle.evaluate(nodes.usable_pairs())
        assert lazy.status == "proven"
        best = min(
            _tour_cost(oracle, order)
            for clusters in permutations(range(len(nodes.studs)))
            for order in product(*(np.flatnonzero(nodes.cluster_of == c) for c in clusters))
        )
        assert lazy.tour.cost == pytest.approx(best, rel=1e-9)
        pairs = nodes.usable_pairs()
        solved = np.array([oracle.costs[(int(i), int(j))] for i, j in pairs])
        assert np.all(oracle.bound(pairs) <= solved * (1 + 1e-6))


@pytest.mark.slow
@pytest.mark.parametrize(("studs", "most"), [(4, 5), (8, 4)])
def test_lazy_is_exact_at_full_size(studs, most, tmp_path) -> None:
    """The loop of `plan_station`, on the learned estimate, against all edges and the exact DP."""
    with _few_alternatives(studs, most, tmp_path) as oracle:
        nodes = oracle.nodes
        base = nodes.problem(np.zeros((nodes.num_nodes,) * 2), oracle.station)
        oracle.train(60, 60)
        factors, _ = oracle.floor_factors(0.01)
        lazy = solve_lazily(
            base,
            oracle,
            LazyStop(0.0, "conditional"),
            symmetric=True,
            known=dict(oracle.costs),
            factor=factors,
        )
        table = np.full((nodes.num_nodes,) * 2, np.inf)
        pairs = nodes.usable_pairs()
        table[pairs[:, 0], pairs[:, 1]] = oracle.evaluate(pairs)
        table = np.minimum(table, table.T)
        exact = gtsp.solve(nodes.problem(table, oracle.station), seed=0, method="exact")
        assert exact.proven
        assert lazy.tour.cost == pytest.approx(exact.cost, rel=1e-9)
        assert np.all(oracle.bound(pairs) <= table[pairs[:, 0], pairs[:, 1]] * (1 + 1e-6))


@contextmanager
def _few_alternatives(studs: int, most: int, folder: Path) -> Iterator[StationEdges]:
    """The oracle of the first studs with up to `most` alternatives each."""
    station = small_station(studs)
    world = CollisionWorld(station)
    found = alternatives(station, world)
    few = tuple(replace(item, alternatives=item.alternatives[:most]) for item in found)
    with EdgeStore(folder / "edges.sqlite") as store:
        oracle = StationEdges(station, world, station_nodes(station, few), store)
        yield oracle


def _tour_cost(oracle: StationEdges, order: tuple[int, ...]) -> float:
    nodes = oracle.nodes
    stops = [nodes.home, *order, nodes.home]
    travel = sum(oracle.costs[tuple(sorted(pair))] for pair in pairwise(stops))
    return float(travel + nodes.weld_cost[list(order)].sum())


def test_the_store_may_be_named_by_a_text(station, tmp_path) -> None:
    far = replace(station.studs[0], position_m=np.array([9.0, 0.0, 0.8]))
    path = tmp_path / "deep" / "edges.sqlite"
    with pytest.raises(NoCycle):
        plan_station(replace(station, studs=(far,)), stop=STOP, store=str(path))
    assert path.is_file()
    cycle = plan_station(small_station(1), stop=STOP, store=str(path))
    with EdgeStore(path) as store:
        assert len(store) > 0
    assert len(cycle.welds) == 1


def test_boxes_end_certified() -> None:
    cycle = plan_station(
        small_station(2, 2),
        method="boxes",
        stop=PlanStop(training_edges=3, coverage_edges=2, baseline_draws=1),
    )
    assert cycle.method == "boxes"
    assert all(item.motion.certified for item in cycle.motions)


def test_without_home_the_cycle_closes_on_the_first_weld(store_path) -> None:
    station = replace(small_station(), home_rad=None)
    cycle = plan_station(station, stop=STOP, store=store_path)
    assert len(cycle.motions) == len(cycle.welds) == 3
    assert cycle.motions[-1].target == cycle.welds[0].stud
    assert {item.kind for item in cycle.motions} == {"travel"}


def test_precedence_is_kept(station, store_path) -> None:
    first, _, last = (stud.id for stud in station.studs)
    for pair in ((first, last), (last, first)):
        cycle = plan_station(replace(station, precedence=(pair,)), stop=STOP, store=store_path)
        order = [weld.stud for weld in cycle.welds]
        assert order.index(pair[0]) < order.index(pair[1])


def test_a_stud_out_of_reach_is_left_out_with_its_reason(station, store_path) -> None:
    far = replace(station.studs[0], position_m=np.array([9.0, 0.0, 0.8]))
    cycle = plan_station(
        replace(station, studs=(far, *station.studs[1:])), stop=STOP, store=store_path
    )
    assert [stud for stud, _ in cycle.unreachable] == [far.id]
    assert "unreachable" in cycle.unreachable[0][1]
    assert len(cycle.welds) == 2


def test_nothing_reachable_is_no_cycle(station) -> None:
    studs = tuple(replace(s, position_m=np.array([9.0, 0.0, 0.8])) for s in station.studs)
    with pytest.raises(NoCycle, match="unreachable"):
        plan_station(replace(station, studs=studs), stop=STOP)
