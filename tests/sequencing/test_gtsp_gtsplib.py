"""`.gtsp` files: every format, and faults with file and line."""

import numpy as np
import pytest

from dmoc.errors import InputError
from sequencing.gtsp import GtspProblem, read_gtsplib, run_gtsp_file, write_gtsplib
from tests.naive.gtsp import random_problem

SETS = "GTSP_SETS: 2\n"
TAIL = "GTSP_SET_SECTION\n1 1 2 -1\n2 3 4 -1\nEOF\n"
MATRIX = np.array([[0, 1, 2, 3], [1, 0, 4, 5], [2, 4, 0, 6], [3, 5, 6, 0]], dtype=float)


def write(tmp_path, text, name="x.gtsp"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("form", "numbers"),
    [
        ("FULL_MATRIX", "0 1 2 3 1 0 4 5 2 4 0 6 3 5 6 0"),
        ("UPPER_ROW", "1 2 3 4 5 6"),
        ("LOWER_ROW", "1 2 4 3 5 6"),
        ("UPPER_DIAG_ROW", "0 1 2 3 0 4 5 0 6 0"),
        ("LOWER_DIAG_ROW", "0 1 0 2 4 0 3 5 6 0"),
        ("UPPER_COL", "1 2 4 3 5 6"),
        ("LOWER_COL", "1 2 3 4 5 6"),
        ("UPPER_DIAG_COL", "0 1 0 2 4 0 3 5 6 0"),
        ("LOWER_DIAG_COL", "0 1 2 3 0 4 5 0 6 0"),
    ],
)
def test_explicit_formats(tmp_path, form, numbers):
    text = f"DIMENSION : 4\n{SETS}EDGE_WEIGHT_TYPE: EXPLICIT\nEDGE_WEIGHT_FORMAT: {form}\n"
    problem = read_gtsplib(write(tmp_path, text + f"EDGE_WEIGHT_SECTION\n{numbers}\n" + TAIL))
    assert np.array_equal(problem.cost, MATRIX)
    assert problem.clusters == ((0, 1), (2, 3))


@pytest.mark.parametrize(
    ("kind", "first", "second", "distance"),
    [
        ("EUC_2D", "0 0", "3 4", 5),
        ("EUC_2D", "0 0", "1 1", 1),
        ("CEIL_2D", "0 0", "1 1", 2),
        ("MAN_2D", "0 0", "-3 4.4", 7),
        ("MAX_2D", "0 0", "-3 4.4", 4),
        ("ATT", "0 0", "10 10", 5),
        ("EUC_3D", "0 0 0", "2 3 6", 7),
        ("MAN_3D", "0 0 0", "2 3 6", 11),
        ("MAX_3D", "0 0 0", "2 3 6", 6),
        ("XRAY1", "350 0 0", "10 5 7", 2000),
        ("XRAY2", "350 0 0", "10 5 7", 1600),
        # first two nodes of TSPLIB's ulysses16, whose matrix gives 509
        ("GEO", "38.24 20.42", "39.57 26.15", 509),
    ],
)
def test_metrics(tmp_path, kind, first, second, distance):
    text = f"DIMENSION: 2\n{SETS}EDGE_WEIGHT_TYPE: {kind}\nNODE_COORD_SECTION\n"
    text += f"1 {first}\n2 {second}\nGTSP_SET_SECTION\n1 1 -1\n2 2 -1\n"
    assert read_gtsplib(write(tmp_path, text)).cost[0, 1] == distance


@pytest.mark.parametrize("seed", range(30))
def test_written_problem_is_read_back(tmp_path, seed):
    problem = random_problem(seed)
    path = tmp_path / "p.gtsp"
    write_gtsplib(problem, path)
    back = read_gtsplib(path)
    for key in ("cost", "cluster_of", "node_cost", "exit_of"):
        assert np.array_equal(getattr(back, key), getattr(problem, key)), key
    for key in ("home", "start", "end", "path", "precedence"):
        assert getattr(back, key) == getattr(problem, key), key


GOOD = (
    f"DIMENSION: 4\n{SETS}EDGE_WEIGHT_TYPE: EXPLICIT\nEDGE_WEIGHT_FORMAT: UPPER_ROW\n"
    "EDGE_WEIGHT_SECTION\n1 2 3 4 5 6\n" + TAIL
)


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("DIMENSION: 4\n", "", "gtsp-key-missing", None),
        ("DIMENSION: 4", "DIMENSION: four", "gtsp-not-integer", 1),
        ("DIMENSION: 4", "DIMENSION: 99999999", "gtsp-range", 1),
        ("UPPER_ROW", "SIDEWAYS", "gtsp-format", None),
        ("EXPLICIT", "SPECIAL", "gtsp-metric", None),
        ("1 2 3 4 5 6", "1 2 3 4 5", "gtsp-count", 6),
        ("1 2 3 4 5 6", "1 2 3 4 5 x6", "gtsp-not-a-number", 6),
        ("1 2 3 4 5 6", "1 2 3 4 5 nan", "gtsp-cost-nan", None),
        ("2 3 4 -1", "2 3 9 -1", "gtsp-node-range", 9),
        ("2 3 4 -1", "2 3 2 4 -1", "gtsp-cluster-overlap", None),
        ("2 3 4 -1", "1 3 4 -1", "gtsp-set", 9),
        ("2 3 4 -1", "2 -1", "gtsp-cluster-empty", None),
        ("2 3 4 -1", "2 3 -1", "gtsp-node-without-cluster", None),
        ("2 3 4 -1\n", "", "gtsp-set", None),
        ("2 3 4 -1", "2 3 4", "gtsp-set", None),
        ("GTSP_SET_SECTION\n1 1 2 -1\n2 3 4 -1\n", "", "gtsp-section-missing", None),
        ("GTSP_SET_SECTION", "OTHER_SECTION", "gtsp-not-understood", 7),
        ("EOF", "FIXED_EDGES_SECTION\n1 3\n-1\nEOF", "gtsp-not-understood", 10),
        ("EOF", "START_GROUP_SECTION\n2\nEOF", "gtsp-not-understood", 10),
        ("EOF", "DEPOT_SECTION: 1 -1\nEOF", "gtsp-not-understood", 10),
        ("EOF", "GTSP_SET_ORDERING\n1 2 -1\nEOF", "gtsp-not-understood", 10),
        ("EOF", "CAPACITY:5\nEOF", "gtsp-not-understood", 10),
        ("EOF", "DIMENSION: 4\nEOF", "gtsp-twice", 10),
        ("EOF", "GTSP_SET_SECTION\n1 1 2 -1\nEOF", "gtsp-twice", 10),
        ("EOF", "TYPE: SOP\nEOF", "gtsp-type", 10),
        ("EOF", "PATH: perhaps\nEOF", "gtsp-path", 10),
        ("EOF", "PRECEDENCE_SECTION\n1 1.5\n-1\nEOF", "gtsp-not-integer", None),
        ("1 2 3 4 5 6", "1 2 -1 4 5 6", "gtsp-minus-one", 6),
        ("EXPLICIT", "EUC_2D", "gtsp-metric", None),
    ],
)
def test_faults_name_file_and_line(tmp_path, old, new, code, line):
    assert old in GOOD
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_gtsplib(path)
    fault = caught.value.faults[0]
    assert fault.code == code
    assert fault.file == str(path)
    assert line is None or fault.line == line


def test_a_colon_without_blank_and_a_cost_of_minus_one_are_read(tmp_path):
    text = GOOD.replace("1 2 3 4 5 6", "1 2 -1.0 4 5 6").replace("EOF", "HOME:3\nEOF")
    problem = read_gtsplib(write(tmp_path, text))
    assert problem.home == 2
    assert problem.cost[0, 3] == -1
    write_gtsplib(problem, tmp_path / "again.gtsp")
    assert np.array_equal(read_gtsplib(tmp_path / "again.gtsp").cost, problem.cost)


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(InputError):
        read_gtsplib(tmp_path / "absent.gtsp")
    path = tmp_path / "binary.gtsp"
    path.write_bytes(bytes(range(128, 256)))
    with pytest.raises(InputError):
        read_gtsplib(path)


def test_command_object(tmp_path):
    path = tmp_path / "p.gtsp"
    write_gtsplib(GtspProblem(MATRIX, [0, 0, 1, 1]), path)
    answer = run_gtsp_file(path)
    assert set(answer) == {"cost", "tour", "lower_bound", "proven", "method", "cpu_s"}
    assert answer["cost"] == 4
    assert sorted(answer["tour"]) == [1, 3]
    assert answer["proven"]
