"""Tables 1 and 2 of Björkenstam et al. as they are stored: their own sums and savings."""

from __future__ import annotations

import pytest

from studies.stud_welding.paper import paper_tables


def test_bjorkenstam2014_table1_has_twenty_studs_and_307_alternatives() -> None:
    studs = paper_tables()["studs"]
    assert [row[0] for row in studs] == list(range(1, 21))
    assert sum(row[1] for row in studs) == 307
    assert (min(row[1] for row in studs), max(row[1] for row in studs)) == (6, 36)


def test_bjorkenstam2014_table2_saves_over_forty_percent_mostly_standing_still() -> None:
    tables = paper_tables()
    old, new = tables["old_sequence"], tables["new_sequence"]
    for row in (old, new):
        # The paper rounds each number by itself.
        assert row["travel"] + row["welding"] == pytest.approx(row["total"], abs=0.11)
    assert 1 - new["total"] / old["total"] == pytest.approx(0.429, abs=5e-4)
    assert old["welding"] - new["welding"] > old["travel"] - new["travel"]


def test_bjorkenstam2014_new_welding_is_nearly_the_sum_of_the_cheapest_poses() -> None:
    tables = paper_tables()
    low = sum(row[2] for row in tables["studs"])
    high = sum(row[3] for row in tables["studs"])
    assert low == pytest.approx(2311.5, abs=0.1)
    assert high == pytest.approx(5806, abs=1)
    place = [
        (tables[key]["welding"] - low) / (high - low) for key in ("old_sequence", "new_sequence")
    ]
    assert place[0] == pytest.approx(0.65, abs=0.01)
    assert place[1] < 0.005
