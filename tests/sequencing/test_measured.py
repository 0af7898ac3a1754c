"""A controller log against a plan: our own export, a shifted one, and a real recording."""

import os
from pathlib import Path

import numpy as np
import pytest

from dmoc.errors import InputError
from dmoc.motion.cost import ElectricalCost
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import Robot, Tool, load_robot
from sequencing.cycle_types import CycleMotion
from sequencing.export.exporting import export_run
from sequencing.report.measured_tables import measured_markdown
from sequencing.runs.folder import Run, write_motions
from sequencing.runs.measured import measured_against_plan
from sequencing.runs.measured_log import read_controller_log
from studies.ur3.bezier_problem import BezierProblem

DATA = Path(os.environ.get("DMOC_DATA", Path(__file__).parents[3] / "shared" / "data"))
START = np.deg2rad([-45.0, -75, 95, -110, -90, 0])
GOAL = np.deg2rad([45.0, -65, 80, -105, -80, 20])


def one_motion(
    name: str, curve: JointTrajectory, robot: Robot, energy_j: float, folder: Path
) -> Run:
    motion = Motion(Status.CONVERGED, "refined", curve, cost=energy_j)
    item = CycleMotion("m000", "start", "goal", "travel", motion)
    cost = ElectricalCost(time=0.0, torque_smoothing=0.0)
    return write_motions(name, robot, [item], cost, folder, 0)


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = load_robot("ur3e_class")
    problem = BezierProblem(robot, START, GOAL)
    curve = problem.motion(problem.straight).trajectory(robot, 150)
    folder = tmp_path_factory.mktemp("run")
    run = one_motion("move", curve, robot, 20.0, folder)
    export_run(run, "rtde", folder, 0.008)
    return folder


def test_own_export_agrees_with_itself(run_dir: Path) -> None:
    report = measured_against_plan(run_dir / "move.rtde.csv", run_dir)
    assert report["source"] == "target"
    assert abs(report["shift_s"]) < 1e-3
    assert max(report["position"]["largest_rad"]) < 1e-3
    assert abs(report["time"]["difference_s"]) < 0.03
    assert report["energy"]["planned_with_base_j"] > report["energy"]["planned_j"] + 100
    assert report["current"] is None


def test_shift_and_error_of_a_doctored_log_are_found(run_dir: Path, tmp_path: Path) -> None:
    record = read_controller_log(run_dir / "move.rtde.csv")
    late = 0.4375
    t = np.concatenate([np.arange(0, late, 0.008), late + record.t_s])
    q = np.vstack([np.tile(record.q_rad[0], (len(t) - len(record.t_s), 1)), record.q_rad])
    q[200:, 2] += 0.01
    header = [
        "timestamp",
        *(f"actual_q_{j}" for j in range(6)),
        *(f"actual_current_{j}" for j in range(6)),
        "actual_robot_voltage",
        "actual_robot_current",
    ]
    body = np.column_stack([100.0 + t, q, np.full((len(t), 6), 0.5), np.full((len(t), 2), 2.0)])
    text = "\r".join([",".join(header), *(",".join(map(repr, row)) for row in body.tolist())])
    path = tmp_path / "log.csv"
    path.write_text(text, newline="")
    report = measured_against_plan(path, run_dir)
    assert report["source"] == "actual"
    assert report["shift_s"] == pytest.approx(late, abs=0.01)
    assert report["position"]["largest_rad"][2] == pytest.approx(0.01, rel=0.3)
    assert report["position"]["largest_rad"][0] < 0.01
    length = t[-1]
    assert report["energy"]["logged_dc_j"] == pytest.approx(4.0 * length, rel=1e-6)
    assert report["energy"]["logged_iv_absolute_j"] == pytest.approx(6 * 24 * length, rel=1e-6)
    np.testing.assert_allclose(report["current"]["logged_rms_a"], 0.5)


HEAD = "timestamp,actual_q_0,actual_qd_0,actual_current_0\n"


def table(change=lambda rows: rows, head: str = HEAD, sep: str = ",") -> str:
    t = 0.04 * np.arange(80)
    rows = np.column_stack([t, np.sin(t), np.cos(t), np.full(80, 0.5)])
    text = [sep.join(f"{x:.9g}" for x in row) for row in change(rows)]
    return head.replace(",", sep) + "\n".join(text) + "\n"


def cell(row: int, column: int, value: float):
    def change(rows):
        rows[row, column] = value
        return rows

    return change


def row_text(number: int, old: str, new: str) -> str:
    lines = table().splitlines()
    assert old in lines[number]
    lines[number] = lines[number].replace(old, new, 1)
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("a,b\n1,2\n", "log-columns", None),
        ("timestamp,actual_q_0\n0,x\n", "log-value", 2),
        ("timestamp,actual_q_0\n0,1\n1,1\n", "log-samples", None),
        ("timestamp,actual_q_0\n0,1\n2,1\n1,1\n3,1\n4,1\n", "log-time", 4),
        ("", "log-columns", None),
        ("timestamp,actual_q_0,actual_q_2\n0,1,1\n1,1,1\n2,1,1\n3,1,1", "log-unit", None),
        ("timestamp,actual_q_0,actual_q_0\n0,1,1\n", "log-columns", None),
        (table(cell(7, 1, np.nan)), "log-value", 9),
        (table(cell(7, 1, np.inf)), "log-value", 9),
        (table(cell(0, 0, np.nan)), "log-value", 2),
        (table(cell(5, 3, -np.inf)), "log-value", 7),
        ("# made by us\n" + table(cell(5, 3, np.nan)), "log-value", 8),
        (row_text(9, ",0.5", ","), "log-value", 10),
        (row_text(9, ",0.5", ""), "log-row", 10),
        (row_text(9, ",0.5", ",0.5,1"), "log-row", 10),
        (row_text(9, "0.5", "0_5"), "log-value", 10),
        (row_text(9, "0.5", "0x5"), "log-value", 10),
        (row_text(9, "0.5", "0,5"), "log-row", 10),
        (table(lambda r: r * [1, 57.3, 57.3, 1]), "log-unit", None),
        (table(lambda r: r * [1, 57.3, 1, 1]), "log-unit", None),
        (table(lambda r: r * [1000, 1, 1, 1]), "log-unit", None),
        (table(lambda r: r * [20, 1, 1, 1]), "log-unit", None),
        (table(lambda r: r * [1, 1, 1, 1000]), "log-unit", 2),
        (table(lambda r: np.delete(r, slice(20, 30), axis=0)), "log-gap", 22),
        (table(sep=";").replace("0.5\n", "0,5\n", 1), "csv-decimal", None),
        (table(head=HEAD.replace("qd_0", "q_2")), "log-columns", None),
        (table(head=HEAD.replace("actual_qd_0", "actual_q_1")), "log-columns", None),
    ],
)
def test_bad_logs_are_named(text: str, code: str, line: int | None, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_controller_log(path)
    fault = caught.value.faults[0]
    assert (fault.code, fault.file) == (code, str(path))
    assert line is None or fault.line == line
    assert fault.legal
    assert fault.fix


@pytest.mark.parametrize(
    "text",
    [
        table(sep=" "),
        table(sep="\t"),
        table(sep=";"),
        table(sep=";").replace(".", ","),
        "\ufeff" + table().replace("\n", "\r\n"),
        "sep=;\n" + table(sep=";"),
        table(sep=" ").replace(" ", "   ").replace("\n", "  \n"),
        "# ours\n\n" + table().replace("\n", ",note\n", 1).replace("0.5\n", '0.5,"a, b"\n'),
        table().replace("\n", ",actual_joint_voltage_0\n", 1).replace("0.5\n", "0.5,\n"),
    ],
)
def test_logs_as_recorders_and_spreadsheets_write_them(text: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8", newline="")
    record = read_controller_log(path)
    t = 0.04 * np.arange(80)
    np.testing.assert_allclose(record.t_s, t, rtol=1e-9)
    np.testing.assert_allclose(record.q_rad[:, 0], np.sin(t), rtol=1e-8)
    np.testing.assert_allclose(record.current_a, 0.5)
    assert record.joint_voltage_v is None


def test_a_wide_text_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(table(sep="\t").replace(".", ","), encoding="utf-16")
    assert len(read_controller_log(path).t_s) == 80


def test_numbers_are_those_of_python(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=2000) * 10.0 ** rng.integers(-12, 1, 2000)
    forms = ["{:.17g}", "{:.6e}", "{:+.4f}", "{:.3E}"]
    cells = [forms[k % 4].format(x) for k, x in enumerate(values)]
    cells[:4] = ["1.", ".5", "-.5e+1", "00.25"]
    path = tmp_path / "log.csv"
    text = [f"{1e9 + 0.01 * k:.6f},{c}" for k, c in enumerate(cells)]
    path.write_text("timestamp,actual_q_0\n" + "\n".join(text))
    found = read_controller_log(path).q_rad[:, 0]
    np.testing.assert_allclose(found, [float(c) for c in cells], rtol=4e-16, atol=0)


def test_a_log_in_degrees_near_zero_is_known_by_the_plan(run_dir: Path, tmp_path: Path) -> None:
    lines = (run_dir / "move.rtde.csv").read_text().splitlines()
    header, *rows = (line for line in lines if not line.startswith("#"))
    names = header.split(",")
    keep = [k for k, n in enumerate(names) if n == "timestamp" or n.startswith("target_q_")]
    cells = [[float(row.split(",")[k]) for k in keep] for row in rows]
    scaled = [[t, *(0.1 * np.degrees(q))] for t, *q in ((r[0], *r[1:]) for r in cells)]
    path = tmp_path / "log.csv"
    text = [",".join(map(repr, map(float, row))) for row in scaled]
    path.write_text("\n".join([",".join(names[k] for k in keep), *text]))
    measured_against_plan(path, run_dir)  # neither radians nor degrees: another motion
    degrees = np.array(cells)
    degrees[:, 1:] = np.degrees(degrees[:, 1:])
    text = [",".join(map(repr, row)) for row in degrees.tolist()]
    path.write_text("\n".join([",".join(names[k] for k in keep), *text]))
    with pytest.raises(InputError, match="log-unit"):
        measured_against_plan(path, run_dir)


def test_missing_log_and_other_robot(tmp_path: Path, run_dir: Path) -> None:
    with pytest.raises(InputError, match="file-missing"):
        measured_against_plan(tmp_path / "none.csv", run_dir)
    path = tmp_path / "two.csv"
    rows = "\n".join(f"{0.1 * k},0,0" for k in range(9))
    path.write_text(f"timestamp,actual_q_0,actual_q_1\n{rows}\n")
    with pytest.raises(InputError, match="log-joints"):
        measured_against_plan(path, run_dir)


@pytest.mark.data
@pytest.mark.skipif(not (DATA / "ur3e_power").is_dir(), reason="no benchmark data folder")
def test_real_recording_against_a_plan_made_of_its_targets(tmp_path: Path) -> None:
    path = DATA / "ur3e_power" / "L3L4.csv"
    record = read_controller_log(path)
    assert record.q_rad.shape == (len(record.t_s), 6)
    text = path.read_bytes().decode().replace("\r", "\n")
    header, *rows = (line.split(",") for line in text.split("\n") if line)

    def column(name: str) -> np.ndarray:
        index = [header.index(f"{name}_{j}") for j in range(6)]
        return np.array([[float(row[k]) for k in index] for row in rows])

    tool = Tool(1.07, np.array([0.0, 0.0, 0.058]))
    robot = (
        load_robot("ur3e_class").with_tool(tool).with_limits(q_lower_rad=-20.0, q_upper_rad=20.0)
    )
    torque = np.zeros((len(rows) - 1, 6))
    plan = JointTrajectory(record.t_s, column("target_q"), column("target_qd"), torque, robot)
    one_motion("L3L4", plan, robot, 0.0, tmp_path)
    report = measured_against_plan(path, tmp_path, robot)
    assert max(report["position"]["largest_rad"]) < 0.02
    assert abs(report["time"]["difference_s"]) <= 0.08
    energy = report["energy"]
    # Published parameters and a plan, nothing of this log: DC energy within 5 %.
    assert energy["planned_with_base_j"] == pytest.approx(energy["logged_dc_j"], rel=0.05)
    # The paper's metric is not energy: both readings are far from the DC side's joules above base.
    assert energy["logged_iv_absolute_j"] > 1.8 * (energy["logged_dc_j"] - 36 * record.duration_s)


def test_tables_for_a_person_doubt_a_log_of_another_motion(run_dir: Path, tmp_path: Path) -> None:
    text = measured_markdown(measured_against_plan(run_dir / "move.rtde.csv", run_dir))
    assert "warning" not in text
    assert "| 6 |" in text
    lines = (run_dir / "move.rtde.csv").read_text().splitlines()
    header, *rows = (line for line in lines if not line.startswith("#"))
    column = header.split(",").index("target_q_1")
    cells = [row.split(",") for row in rows]
    for cell in cells:
        cell[column] = str(float(cell[column]) + 1.0)
    path = tmp_path / "other.csv"
    path.write_text("\n".join([header, *(",".join(cell) for cell in cells)]))
    assert "is this the log of this run?" in measured_markdown(measured_against_plan(path, run_dir))
