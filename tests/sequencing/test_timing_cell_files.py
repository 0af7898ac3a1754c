"""Hostile cell files and trajectory files: coded faults that name the place, or honest cells."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import planning
from dmoc.errors import InputError
from dmoc.motion.trajectory import JointTrajectory
from sequencing.timing.cell.read import load_cell
from sequencing.timing.power.along_path import path_torque_nm
from sequencing.timing.search.prepared import prepare_cell
from studies.pallet_cell.study import pallet_cell

AUTHORED = Path(planning.__file__).parent / "stations" / "pallet_cell"
MOTIONS = pallet_cell().robots[0].trajectories[:2]


@pytest.fixture
def folder(tmp_path):
    """The pallet cell with three trajectories a robot."""
    for name in ("north", "west", "east"):
        rows = (AUTHORED / name / "waypoints.csv").read_text(encoding="utf-8").splitlines()[:5]
        (tmp_path / name).mkdir()
        (tmp_path / name / "waypoints.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    text = (AUTHORED / "cell.yaml").read_text(encoding="utf-8")
    text = text[: text.index("handovers:")]
    text += "handovers:\n  - {from: north/0, to: west/1}\n  - {from: west/1, to: east/2}\n"
    (tmp_path / "cell.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def edit(folder: Path, old: str, new: str) -> None:
    text = (folder / "cell.yaml").read_text(encoding="utf-8")
    assert old in text
    (folder / "cell.yaml").write_text(text.replace(old, new, 1), encoding="utf-8")


def codes(folder: Path) -> set[str]:
    with pytest.raises(InputError) as caught:
        load_cell(folder)
    for fault in caught.value.faults:
        assert fault.file
        assert fault.legal
        assert fault.field or fault.line
    return {fault.code for fault in caught.value.faults}


NORTH = "trajectories: north"


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("capacitance_f: 6.0e-3", "capacitance_f: .nan", "number-not-finite"),
        ("capacitance_f: 6.0e-3", "capacitance_f: 1e300", "value-range"),
        ("voltage_v: 560.0", "voltage_v: '560'", "type"),
        ("chopper_v: 760.0", "chopper_v: 760.0, chopper_off_v: 800.0", "link-order"),
        ("chopper_v: 760.0", "chopper_v: 760.0, rectifier_drop_v: 900.0", "link-value"),
        (NORTH, "trajectories: /nowhere/at/all", "motions-missing"),
        (NORTH, "trajectories: north/waypoints.csv", "motions-missing"),
        (NORTH, NORTH + "\n    run: north", "motions-choice"),
        (NORTH, "run: north", "run-field"),
        (NORTH, NORTH + "\n    order: random", "value-illegal"),
        (NORTH, NORTH + "\n    loads: [{trajectories: [3], payload_kg: 3}]", "load-trajectory"),
        (NORTH, NORTH + "\n    loads: [{trajectories: [0]}]", "load-empty"),
        (NORTH, NORTH + "\n    loads: [{trajectories: [0], payload_kg: -3}]", "value-range"),
        (NORTH, NORTH + "\n    loads: [{trajectories: [0], force_n: [1, 2]}]", "length"),
        (NORTH, NORTH + "\n    loads: [{trajectories: [0.5], payload_kg: 2}]", "type"),
        ("north/0", "north/-1", "handover"),
        ("north/0", "north/²", "handover"),
        ("north/0, to: west/1", "east/2, to: west/1", "handover-circle"),
        ("west/1, to: east/2", "east/2, to: east/2", "handover-circle"),
        ("inertia_kg_m2: [[0.73", "inertia_kg_m2: [[-0.73", "inertia"),
        ("model: irb6640_class", "urdf: ../../passwd", "path-outside"),
        ("shared: true", "shared: [[north, west, east, south]]", "link-groups"),
        ("base_load_w: 0.0", "base_load_w: -5", "value-range"),
    ],
)
def test_faults_of_the_cell_file_are_coded(folder, old, new, code) -> None:
    edit(folder, old, new)
    assert code in codes(folder)


def rows(change):
    def apply(folder: Path) -> None:
        file = folder / "north" / "waypoints.csv"
        file.write_text(change(file.read_text(encoding="utf-8")), encoding="utf-8")

    return apply


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (rows(lambda s: s.replace(s.splitlines()[2].split(",")[1], "nan", 1)), "csv-value"),
        (rows(lambda s: s.replace(s.splitlines()[2].split(",")[1], "abc", 1)), "csv-value"),
        (rows(lambda s: s + "x,1,2\n"), "csv-value"),
        (rows(lambda s: s + s.splitlines()[1] + ",1,2,3\n"), "csv-value"),
        (rows(lambda s: s.replace(",45\n", ",-45\n")), "csv-value"),
        (rows(lambda s: s.splitlines()[0] + "\n"), "csv-rows"),
        (rows(lambda s: ""), "csv-columns"),
        (rows(lambda s: s.replace(",", ";").replace(".", ",", 1) + "x;0.5"), "csv-decimal"),
        (rows(lambda s: s.replace(s.splitlines()[2].split(",")[1], "1_0", 1)), "csv-value"),
        (rows(lambda s: s.replace("q2_rad", "q1_rad")), "csv-columns"),
        (rows(lambda s: s + s.splitlines()[-1] + "\n"), "no-motion"),
        (rows(lambda s: s + "x,90,0,0,0,300,0,0\n"), "joint-limit"),
        (rows(lambda s: s + "x" * 200_000 + ",0,0,0,0,0,0,0\n"), "csv-syntax"),
        (
            lambda f: (f / "north" / "waypoints.csv").write_bytes(bytes(range(256))),
            "file-encoding",
        ),
    ],
)
def test_faults_of_waypoints_are_coded(folder, damage, code) -> None:
    damage(folder)
    assert code in codes(folder)


def archive(folder: Path, change=None) -> Path:
    arrays = {
        f"m{k:03d}/{name}": np.array(getattr(motion, name))
        for k, motion in enumerate(MOTIONS)
        for name in ("t_s", "q_rad", "velocity_rad_s", "torque_nm")
    }
    for key, value in (change or {}).items():
        arrays[key] = value(arrays.get(key))
    (folder / "north" / "waypoints.csv").unlink()
    np.savez(folder / "north" / "motions.npz", **{k: v for k, v in arrays.items() if v is not None})
    return folder / "north" / "motions.npz"


def put(index, value):
    def change(array):
        out = array.copy()
        out[index] = value
        return out

    return change


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"m000/q_rad": put((3, 1), np.nan)}, "array"),
        ({"m000/velocity_rad_s": put((3, 1), np.inf)}, "array"),
        ({"m000/t_s": put(3, 0.0)}, "trajectory-time"),
        ({"m000/t_s": lambda t: t[:-1]}, "motions-arrays"),
        ({"m000/t_s": lambda t: t.astype(str)}, "motions-arrays"),
        ({"m000/q_rad": lambda q: q.astype(complex)}, "motions-arrays"),
        ({"m000/q_rad": lambda q: q[:, :5]}, "motions-arrays"),
        ({"m000/velocity_rad_s": lambda v: None}, "motions-arrays"),
        ({"m000/torque_nm": lambda u: u[:3]}, "motions-arrays"),
        ({"stranger": lambda _: np.zeros(3)}, "motions-arrays"),
        ({"m001/q_rad": lambda q: q + np.linspace(0, 20, len(q))[:, None]}, "joint-limit"),
        ({"m000/velocity_rad_s": put((-1, 0), 0.5)}, "motions-moving"),
        ({"m000/t_s": lambda t: 1e6 * t}, "motions-duration"),
        (
            {"m000/t_s": lambda t: 0.01 * t, "m000/velocity_rad_s": lambda v: 100 * v},
            "velocity-limit",
        ),
    ],
)
def test_faults_of_archives_are_coded(folder, change, code) -> None:
    archive(folder, change)
    assert code in codes(folder)


@pytest.mark.parametrize("keep", [0, 3000])
def test_cut_off_archives_are_coded(folder, keep) -> None:
    file = archive(folder)
    file.write_bytes(file.read_bytes()[:keep])
    assert codes(folder) == {"motions-damaged"}


def test_archives_without_torques_and_tables_with_a_byte_order_mark_are_read(folder) -> None:
    archive(folder, {"m000/torque_nm": lambda u: None})
    west = folder / "west" / "waypoints.csv"
    west.write_text("\ufeff" + west.read_text(encoding="utf-8"), encoding="utf-8")
    assert [len(r.trajectories) for r in load_cell(folder).robots] == [2, 3, 3]


def test_loads_change_payload_and_wrench_of_the_trajectories_named(folder) -> None:
    plain = prepare_cell(load_cell(folder))
    edit(
        folder,
        NORTH,
        NORTH + "\n    loads: [{trajectories: [0, 1], payload_kg: 10}, {trajectories: [1, 2], "
        "payload_kg: 60, force_n: [0, 0, -200], torque_nm: [5, 0, 0]}]",
    )
    cell = load_cell(folder)
    north = cell.robots[0]
    assert [w is None for w in north.wrench] == [True, False, False]
    masses = [pin.computeTotalMass(arm.model) for arm in north.loaded]
    assert masses[1] - masses[0] == pytest.approx(50.0)
    prepared = prepare_cell(cell)
    assert prepared.tables[2].energy_j(1.0) != pytest.approx(plain.tables[2].energy_j(1.0))
    # Torque at full speed is inverse dynamics of the loaded arm with the wrench on its flange.
    path, arm = prepared.paths[1], north.loaded[1]
    model, data = arm.model, arm.model.createData()
    flange = arm.flange_id
    for k in range(0, path.num_samples, 40):
        q, v, a = path.q_rad[k], path.velocity_rad_s[k], path.acceleration_rad_s2[k]
        jacobian = pin.computeFrameJacobian(
            model, data, q, flange, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        expected = pin.rnea(model, data, q, v, a) - jacobian.T @ np.array([0, 0, -200, 5, 0, 0])
        np.testing.assert_allclose(path_torque_nm(path)[k], expected, atol=1e-8)
    # The trajectory's own torques are those of the load that it carries.
    motion = north.trajectories[1]
    bare = JointTrajectory(motion.t_s, motion.q_rad, motion.velocity_rad_s, motion.torque_nm)
    q, v, a, _ = bare.sample(0.5 * (motion.t_s[1:] + motion.t_s[:-1]))
    np.testing.assert_allclose(motion.torque_nm[3], pin.rnea(model, data, q[3], v[3], a[3]))


def test_free_order_is_read(folder) -> None:
    edit(folder, NORTH, NORTH + "\n    order: free")
    assert [robot.free_order for robot in load_cell(folder).robots] == [True, False, False]
