"""Mutated files for every reader: `python mutated.py KIND FIRST COUNT`, a process of its own.

A case is a kind and a number; it writes the number before it begins, so that a process that dies
names its case, and a line of JSON for every outcome that is neither a value nor a coded error.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from dmoc.arrays import arrays_of
from dmoc.errors import DmocError
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.robot.robot import load_robot
from planning.geometry.convex import read_pieces
from planning.geometry.mesh import load_mesh
from planning.station.build import load_station
from planning.station.srdf import read_srdf
from planning.station.studs import read_studs
from sequencing.edges.store import decode_motion, encode_motion
from sequencing.gtsp.gtsplib import read_gtsplib
from sequencing.gtsp.problem import GtspProblem
from sequencing.runs.folder import read_run
from sequencing.runs.measured_log import read_controller_log
from sequencing.timing.cell.read import load_cell
from sequencing.timing.cell.trajectories import read_trajectories

PATIENCE_S = 5
ROOT = Path(__file__).resolve().parents[2]
STATION = ROOT / "planning" / "stations" / "stud_welding_a"
ROBOT = load_robot("ur10e_class")
WORDS = (
    b"nan",
    b"inf",
    b"-inf",
    b"-1",
    b"0",
    b"1e308",
    b"1e-320",
    b"1e400",
    b"9" * 40,
    b"true",
    b"~",
    b"null",
    b"[]",
    b"{}",
    b"\x00",
    b"\xff\xfe",
    b"\n",
    b"\t",
    b",",
    b":",
    b'"',
    b"<",
    b">",
    b"/",
    b"..",
    b"1/0/0",
    b"-7",
    b"99999999",
    b"&x;",
    b"%s",
    b"0x10",
    b"1_000",
)


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """One to four changes: bytes, numbers, lines, pieces."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        if not data:
            break
        at, kind = int(rng.integers(len(data))), int(rng.integers(7))
        end = min(len(data), at + int(rng.integers(1, 40)))
        word = WORDS[int(rng.integers(len(WORDS)))]
        if kind == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del data[at:end]
        elif kind == 2:
            data[at:at] = word
        elif kind == 3:  # another word in the place of one
            while at > 0 and chr(data[at - 1]).isalnum():
                at -= 1
            end = at
            while end < len(data) and (chr(data[end]).isalnum() or data[end] in b".-+"):
                end += 1
            data[at:end] = word
        elif kind == 4:
            data[at:at] = data[at:end] * int(rng.integers(1, 4))
        elif kind == 5:
            lines = data.split(b"\n")
            one, two = rng.integers(len(lines), size=2)
            lines[one], lines[two] = lines[two], lines[one]
            data = bytearray(b"\n".join(lines))
        else:
            del data[at:]
    return bytes(data)


def _mesh(suffix: str) -> bytes:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    made = ball.export(file_type=suffix)
    return made if isinstance(made, bytes) else made.encode()


def _gtsp() -> bytes:
    from sequencing.gtsp.gtsplib import write_gtsplib

    rng = np.random.default_rng(0)
    problem = GtspProblem(cost=rng.uniform(1, 9, (6, 6)), cluster_of=np.array([0, 0, 1, 1, 2, 2]))
    with tempfile.TemporaryDirectory() as folder:
        write_gtsplib(problem, Path(folder) / "x.gtsp")
        return (Path(folder) / "x.gtsp").read_bytes()


def _log() -> bytes:
    times = np.linspace(0.0, 1.0, 30)
    names = ["timestamp", *(f"actual_q_{j}" for j in range(6))]
    rows = [[f"{t:.4f}", *(f"{np.sin(t + j):.6f}" for j in range(6))] for t in times]
    return "\n".join([",".join(names), *(",".join(row) for row in rows)]).encode()


def _run(folder: Path) -> None:
    sys.path.insert(0, str(ROOT / "tests" / "sequencing"))
    from sample_cycle import sample_cycle

    from sequencing.runs.folder import write_run

    write_run(sample_cycle(), folder, {})


def _station(folder: Path) -> None:
    for path in STATION.iterdir():
        if path.is_file():
            shutil.copy(path, folder / path.name)


def _robot(folder: Path) -> None:
    for path in ROBOT.urdf.parent.iterdir():
        if path.is_file():
            shutil.copy(path, folder / path.name)


def _cell(folder: Path) -> None:
    shutil.copytree(ROOT / "planning" / "stations" / "pallet_cell", folder, dirs_exist_ok=True)


def _text(name: str, make: Callable[[], bytes]) -> Callable[[Path], None]:
    def prepare(folder: Path) -> None:
        (folder / name).write_bytes(make())

    return prepare


SRDF = b"""<robot name="a"><disable_collisions link1="link_1" link2="link_3" reason="Never"/>
<group name="g"><link name="link_1"/></group></robot>"""
KNOWN = {"link_1", "link_2", "link_3"}
WAYPOINTS = b"label,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad\na,0,0,0,0,0,0\nb,1,0,0,0,0,0\n"
MOTION = encode_motion(Motion(Status.NO_PATH, "fallback", None, float("inf")))

#: Kind: what prepares a folder, the file that is changed, and what reads it.
KINDS: dict[str, tuple[Callable[[Path], None], str, Callable[[Path], object]]] = {
    "station": (_station, "station_8.yaml", load_station),
    "station-studs": (
        _station,
        "studs_8.csv",
        lambda path: load_station(path.with_name("station_8.yaml")),
    ),
    "studs": (_station, "studs.csv", read_studs),
    "pieces": (
        _station,
        "underbody_pieces.obj",
        lambda path: read_pieces(path, 1.0, path.name, ""),
    ),
    "urdf": (_robot, ROBOT.urdf.name, load_robot),
    "robot-yaml": (_robot, "robot.yaml", lambda path: load_robot(path.with_name(ROBOT.urdf.name))),
    "srdf": (_text("a.srdf", lambda: SRDF), "a.srdf", lambda path: read_srdf(path, KNOWN, KNOWN)),
    "gtsp": (_text("x.gtsp", _gtsp), "x.gtsp", read_gtsplib),
    "log": (_text("log.csv", _log), "log.csv", read_controller_log),
    "waypoints": (
        _text("waypoints.csv", lambda: WAYPOINTS),
        "waypoints.csv",
        lambda path: read_trajectories(path.parent, ROBOT),
    ),
    "motions": (_run, "motions.npz", lambda path: read_trajectories(path.parent, ROBOT)),
    "archive": (_run, "motions.npz", lambda path: _valued(lambda: arrays_of(path.read_bytes()))),
    "edge": (
        _text("edge", lambda: MOTION),
        "edge",
        lambda path: _valued(lambda: decode_motion(path.read_bytes(), ROBOT)),
    ),
    "result": (_run, "result.json", lambda path: read_run(path.parent)),
    "cell": (_cell, "cell.yaml", load_cell),
}
for _suffix in ("stl", "obj", "ply", "glb"):
    KINDS[_suffix] = (
        _text(f"x.{_suffix}", lambda suffix=_suffix: _mesh(suffix)),
        f"x.{_suffix}",
        lambda path: load_mesh(path.name, path.parent, "m"),
    )


def _valued(read: Callable[[], object]) -> object:
    """Readers of bytes say `ValueError` for what is no such thing."""
    try:
        return read()
    except ValueError:
        return None


def _too_long(*_: object) -> None:
    raise TimeoutError(f"more than {PATIENCE_S} s")


def main(kind: str, first: int, count: int) -> None:
    prepare, name, read = KINDS[kind]
    signal.signal(signal.SIGALRM, _too_long)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        prepare(folder)
        original = (folder / name).read_bytes()
        with contextlib.suppress(DmocError):
            read(folder / name)  # kernels compile here, not under the alarm that would cut them
        for number in range(first, first + count):
            print(number, flush=True)
            rng = np.random.default_rng([number, *kind.encode()])
            (folder / name).write_bytes(mutated(original, rng))
            signal.alarm(PATIENCE_S)
            try:
                read(folder / name)
            except DmocError:
                pass  # a coded error is what a broken file should get
            except OSError as error:  # the command line codes these as file-access
                if isinstance(error, TimeoutError):
                    print(json.dumps([number, "hang", str(error)]), flush=True)
            except Exception:  # what must not happen, whatever it is
                print(json.dumps([number, "traceback", traceback.format_exc()]), flush=True)
            finally:
                signal.alarm(0)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
