"""A cheap sample of the mutants, and that each of them still has its place in the sources."""

from __future__ import annotations

import pytest

from tests.mutants import BACKWARDS, BASELINE, MUTANTS, ROOT, Mutant, copied, killed

SAMPLE = [m for m in MUTANTS if m.test == BACKWARDS]


def test_every_mutant_has_its_place() -> None:
    assert len(MUTANTS) >= 40
    assert len({(m.file, m.text, m.slip) for m in MUTANTS}) == len(MUTANTS)
    for mutant in MUTANTS:
        assert (ROOT / mutant.file).read_text(encoding="utf-8").count(mutant.text) == 1, mutant
        assert mutant.slip != mutant.text
        assert (ROOT / mutant.test.partition("::")[0]).is_file()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("sources")
    copied(place)
    return place


@pytest.mark.parametrize("mutant", SAMPLE, ids=lambda m: m.slip)
def test_a_mutant_is_killed(mutant, folder) -> None:
    assert killed(mutant, folder)


def test_a_mutant_that_says_the_same_survives(folder) -> None:
    """The judge can say no: a comment changes nothing."""
    text = "def undirected("
    harmless = Mutant(BASELINE, text, f"# the same\n{text}", BACKWARDS)
    assert not killed(harmless, folder)
