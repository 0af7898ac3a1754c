"""Files that are no files: pipes, devices, folders; and archives that grow when unpacked."""

from __future__ import annotations

import io
import os
import signal
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dmoc.arrays import MOST_BYTES, arrays_of
from dmoc.errors import DmocError
from dmoc.input_file import content_of, read_yaml
from dmoc.robot.robot import load_robot
from dmoc.robot.xml_file import read_xml
from planning.geometry.convex import read_pieces
from planning.geometry.mesh import load_mesh
from planning.station.studs import read_studs
from sequencing.gtsp.gtsplib import read_gtsplib
from sequencing.runs.folder import read_run
from sequencing.runs.measured_log import read_controller_log
from sequencing.timing.cell.trajectories import read_trajectories

ROBOT = load_robot("ur10e_class")
READERS: dict[str, Callable[[Path], object]] = {
    "urdf": read_xml,
    "yaml": read_yaml,
    "studs.csv": read_studs,
    "x.gtsp": read_gtsplib,
    "x.stl": lambda path: load_mesh(path.name, path.parent, "m"),
    "pieces.obj": lambda path: read_pieces(path, 1.0, str(path), "pieces"),
    "log.csv": read_controller_log,
    "result.json": lambda path: read_run(path.parent),
    "motions.npz": lambda path: read_trajectories(path.parent, ROBOT),
}


def in_five_seconds(read: Callable[[], object]) -> None:
    """A reader that waits is interrupted and fails."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("still waiting after 5 s"))
    signal.alarm(5)
    try:
        with pytest.raises(DmocError):
            read()
    finally:
        signal.alarm(0)


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_refused_and_not_waited_for(name, tmp_path) -> None:
    os.mkfifo(tmp_path / name)
    in_five_seconds(lambda: READERS[name](tmp_path / name))


@pytest.mark.parametrize("name", READERS)
def test_a_folder_is_refused(name, tmp_path) -> None:
    (tmp_path / name).mkdir()
    in_five_seconds(lambda: READERS[name](tmp_path / name))


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null", "/proc"])
def test_devices_are_no_files(path) -> None:
    with pytest.raises(OSError):
        content_of(Path(path))


def test_a_file_that_is_too_large_is_not_read(tmp_path) -> None:
    with open(tmp_path / "sparse", "wb") as stream:
        stream.truncate(MOST_BYTES + 1)
    with pytest.raises(OSError, match="more than"):
        content_of(tmp_path / "sparse")


def archive_with(name: str, content: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


def test_arrays_come_back() -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, a=np.arange(6.0).reshape(2, 3), b=np.array("text"))
    found = arrays_of(buffer.getvalue())
    np.testing.assert_array_equal(found["a"], np.arange(6.0).reshape(2, 3))
    assert str(found["b"]) == "text"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"PK\x03\x04",
        archive_with("a.npy", b""),
        archive_with("a.npy", b"\x93NUMPY\x01\x00"),
        archive_with("a.npy", b"\x93NUMPY\x09\x00\x10\x00" + b" " * 16),
        archive_with("a.npy", b"not an array"),
        archive_with("../a", b"x"),
    ],
)
def test_what_is_no_archive_of_arrays_is_one_kind_of_error(content) -> None:
    with pytest.raises(ValueError):
        arrays_of(content)
