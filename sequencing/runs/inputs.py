"""What a run was planned with, kept in its folder: it can be read, shown and exported elsewhere.

inputs/inputs.json   which file is the station, which the robot, and the hash of every file
inputs/station/…     station.yaml and the files that it names, at the same places
inputs/robot/…       URDF (a xacro file expanded), robot.yaml, meshes
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dmoc.errors import InputError
from dmoc.input_file import read_yaml
from dmoc.robot.robot import Robot
from planning.station.template import copy_robot
from sequencing.runs.archive import json_text, remove_unfinished, sha256_of, write_atomic

_FOLDER = "inputs"
_PAGES = ("report.html", "scene.html", "curves.png")
_PROGRAMS = (".script", ".mod", ".src", ".csv", ".json")


def named_files(source: Path) -> dict[str, Path]:
    """The station file and every file that it names, by the place relative to its folder."""
    if not source.is_file():
        return {}
    found = {source.name: source}
    for text in set(_texts(read_yaml(source).data)):
        path = source.parent / text
        if len(text) < 250 and text.isprintable() and path.is_file():
            found[Path(text).as_posix()] = path
    return found


def _texts(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, (dict, list)):
        for value in tree.values() if isinstance(tree, dict) else tree:
            yield from _texts(value)


def keep_inputs(out: Path, robot: Robot, source: Path | None) -> None:
    """Copy the robot and, of a station, its files to `out`/inputs; what lay there before goes.

    Planning the kept station again into the same folder copies nothing: it is there already.
    """
    target = out / _FOLDER
    if source is not None and source.resolve().is_relative_to(target.resolve()):
        return
    out.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(dir=out, prefix=f".{_FOLDER}."))
    handle = os.open(fresh, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)  # until it is in place: `remove_unfinished`
        own = set() if source is None else set(named_files(source).items())
        for name, path in sorted(own):
            if path.resolve() != robot.urdf:
                (fresh / "station" / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, fresh / "station" / name)
        urdf = copy_robot(robot, fresh / "robot")
        files = {
            path.relative_to(fresh).as_posix(): sha256_of(path)
            for path in sorted(fresh.rglob("*"))
            if path.is_file()
        }
        listed = {
            "station": None if source is None or not own else f"station/{source.name}",
            "robot": urdf.relative_to(fresh).as_posix(),
            "files": files,
        }
        write_atomic(fresh / "inputs.json", json_text(listed))
        os.chmod(fresh, 0o755)
        if target.exists():
            shutil.rmtree(target)
        os.replace(fresh, target)
    finally:
        os.close(handle)
        shutil.rmtree(fresh, ignore_errors=True)


def kept_inputs(folder: Path) -> tuple[Path | None, Path | None]:
    """Station file and robot file that the run in `folder` keeps; None where it keeps none.

    Files that are not the ones that were kept count as absent: they were changed since.
    """
    root = folder / _FOLDER
    try:
        listed = json.loads((root / "inputs.json").read_text(encoding="utf-8"))
        files, names = listed["files"], (listed["station"], listed["robot"])
        whole = all(sha256_of(root / name) == digest for name, digest in files.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None, None
    if not whole:
        return None, None
    station, robot = (root / name if name in files else None for name in names)
    return station, robot


def forget_pages(out: Path) -> None:
    """Remove pages and programs that were made of an older result."""
    for name in _PAGES:
        (out / name).unlink(missing_ok=True)
    for path in sorted((out / "export").glob("*")):
        own = path.stem in ("dm_weld", "dm_welds")  # the plant's routines
        if path.suffix in _PROGRAMS and path.is_file() and not own:
            path.unlink()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the run folder for one plan; `InputError` run-locked while another one has it.

    The system gives the lock up when the process ends, however it ends; what a killed one left
    half written is removed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w", encoding="utf-8") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError.of(
                "run-locked",
                str(folder),
                "out",
                "another plan writes to this folder",
                "one plan at a time",
                "wait for it, or give another --out",
            ) from error
        remove_unfinished(folder)
        yield
