"""Today's build gives what is recorded: numbers within the tolerance, makers by name."""

from __future__ import annotations

import pytest

from sequencing.runs.compare import differences
from tests.regression.record import BASELINES, DATA, FOLDER, plain, read

CASES = [
    pytest.param(name, id=name, marks=[] if quick else [pytest.mark.slow])
    for name, (_, _, quick) in BASELINES.items()
]
EDGES = [name for name in BASELINES if name.startswith("edges_")]


def compared(name: str, quick: bool, folder) -> list[str]:
    """What differs from the baseline of `name`."""
    known = read(name)
    values = known["values"]
    rows = values if name in EDGES else None
    found = plain(BASELINES[name][0](rows, quick, folder))
    if rows is not None and quick:
        values = [row for row in values if row["quick"]]
    return differences(values, found, known["tolerance"])


@pytest.mark.parametrize("name", CASES)
def test_as_recorded(name, tmp_path) -> None:
    if name.startswith("gtsplib") and not DATA.is_dir():
        pytest.skip("benchmark data not found")
    if not BASELINES[name][2] and not (FOLDER / f"{name}.json").is_file():
        pytest.skip(f"not recorded: python -m tests.regression.record {name}")
    assert compared(name, True, tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", EDGES)
def test_every_edge_as_recorded(name, tmp_path) -> None:
    assert compared(name, False, tmp_path) == []


def test_edges_of_every_kind_are_among_the_quick_ones() -> None:
    rows = [row for name in EDGES for row in read(name)["values"] if row["quick"]]
    assert {row["method"] for row in rows} >= {"free", "half-spaces", "boxes"}
    assert {row["planner"] for row in rows} >= {"none", "ompl"}
    assert {row["quality"] for row in rows} == {"screen", "final"}
