"""Every example runs as it stands, in an empty folder, and says what it found."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"
#: A sentence of what each prints, as a pattern of parts.
SAYS = {
    "around_an_obstacle": ("proven to keep", "half-spaces"),
    "exporting": ("urscript", "rapid", "krl", "ros", "csv", "rtde"),
    "one_motion": ("J = ", "simulated: joints off by at most"),
    "own_gtsp_matrix": ("proven optimal: True", "heuristic"),
    "own_station": ("left", "right", "certified free of collision"),
    "two_robots_on_a_link": ("as-fast-as-possible", "general"),
}


def test_every_example_is_known_and_short() -> None:
    files = sorted(FOLDER.glob("*.py"))
    assert [path.stem for path in files] == sorted(SAYS)
    for path in files:
        assert len(path.read_text(encoding="utf-8").splitlines()) < 40, path.name


@pytest.mark.parametrize("name", SAYS)
def test_example(name: str, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    printed = capsys.readouterr().out
    for part in SAYS[name]:
        assert part in printed
