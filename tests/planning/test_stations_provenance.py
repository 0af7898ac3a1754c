"""Every number of the embedded stations says where it comes from."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import planning.stations

FOLDER = Path(planning.stations.__file__).parent
FOLDERS = ("stud_welding_a", "stud_welding_b", "stud_welding_c")
#: Fields that are no numbers of the station, or that name the file in which they are.
WORDS = {"schema_version", "name", "studs", "obstacles", "robot", "tool"}


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_number_is_tagged(folder: str) -> None:
    tags = yaml.safe_load((FOLDER / folder / "provenance.yaml").read_text())
    for tag in tags.values():
        assert tag.split(":")[0] in ("published", "assumed", "measured")
    for path in sorted((FOLDER / folder).glob("station*.yaml")):
        data = yaml.safe_load(path.read_text())
        for field in set(data) - WORDS:
            assert field in tags, (path.name, field)
        for section in ("robot", "tool"):
            for field in set(data[section]) - {"model", "q_upper_rad"}:
                assert f"{section}.{field}" in tags, (path.name, field)
        names = {body["name"].split("_")[0] for body in data["obstacles"]}
        assert {f"obstacles.{n.replace('clamp', 'clamps')}" for n in names} <= set(tags)
