"""Checksums of the files that a station was read from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from planning.station import Station
from sequencing.run_archive import sha256_of


def input_hashes(station: Station) -> dict[str, str]:
    """Name → sha256 of station.yaml, of every file that it names, and of the robot's two files.

    Names are relative to the station's folder (`robot/…` for the robot's), so that equal inputs
    give equal entries wherever they lie. A station that was built without files gives the
    robot's only.
    """
    hashes: dict[str, str] = {}
    source = Path(station.source)
    if source.is_file():
        folder = source.parent
        hashes[source.name] = sha256_of(source)
        tree = yaml.safe_load(source.read_text(encoding="utf-8"))
        for text in set(_texts(tree)):
            path = folder / text
            if len(text) < 250 and "\n" not in text and path.is_file():
                hashes[Path(text).as_posix()] = sha256_of(path)
    urdf = Path(station.robot.urdf)
    for path in (urdf, urdf.with_name("robot.yaml")):
        if path.is_file():
            hashes[f"robot/{path.name}"] = sha256_of(path)
    return dict(sorted(hashes.items()))


def _texts(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, dict):
        for value in tree.values():
            yield from _texts(value)
    elif isinstance(tree, list):
        for value in tree:
            yield from _texts(value)
