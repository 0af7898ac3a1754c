"""The edge store survives a kill, and its bytes are read back as the same motion."""

from __future__ import annotations

import io
import json
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import time
import zipfile

import numpy as np
import pytest

from dmoc.errors import InputError
from dmoc.motion.motion import Motion
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointTrajectory
from dmoc.robot.robot import load_robot
from sequencing.edges.store import EdgeStore, decode_motion, encode_motion


def _motion() -> Motion:
    rng = np.random.default_rng(3)
    trajectory = JointTrajectory(
        np.linspace(0.0, 1.0, 5),
        rng.normal(size=(5, 6)),
        rng.normal(size=(5, 6)),
        rng.normal(size=(4, 6)),
    )
    return Motion(
        Status.CONVERGED, "refined", trajectory, 12.5, 0.1, 17, 1e-9, 2e-3, 0.031, True, "note",
        solver="structured", planner="ompl", method="boxes",
    )  # fmt: skip


def test_a_motion_comes_back_bit_for_bit() -> None:
    robot = load_robot("ur10e_class")
    motion = _motion()
    again = decode_motion(encode_motion(motion), robot)
    assert encode_motion(again) == encode_motion(motion)
    assert again.status is Status.CONVERGED
    assert again.certified is True
    assert (again.solver, again.planner, again.method) == ("structured", "ompl", "boxes")
    assert again.trajectory is not None
    assert again.trajectory.robot is robot
    np.testing.assert_array_equal(again.trajectory.q_rad, motion.trajectory.q_rad)


def test_a_failed_motion_comes_back_without_trajectory() -> None:
    motion = Motion(Status.NO_PATH, "fallback", None, float("inf"), note="tool, clamp_2")
    again = decode_motion(encode_motion(motion), load_robot("ur10e_class"))
    assert again == motion


def test_a_pickle_is_refused(tmp_path) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, meta=np.array([{"a": object}], dtype=object))
    with pytest.raises(ValueError, match="object"):
        decode_motion(buffer.getvalue(), load_robot("ur10e_class"))


def test_put_get_replace_and_reopen(tmp_path) -> None:
    with EdgeStore(tmp_path / "deep" / "edges.sqlite") as store:
        assert store.get("a") is None
        store.put("a", b"1")
        store.put("a", b"2")
        store.put("b", b"")
        assert len(store) == 2
    with EdgeStore(tmp_path / "deep" / "edges.sqlite") as store:
        assert store.get("a") == b"2"
        assert store.get("b") == b""


def test_kill_loses_nothing_that_was_put(tmp_path) -> None:
    """A writer is killed with SIGKILL at four moments; every key it reported must be there."""
    program = textwrap.dedent(
        """
        import sys
        from sequencing.edges.store import EdgeStore
        store = EdgeStore(sys.argv[1])
        for k in range(100000):
            store.put(f"{sys.argv[2]}-{k}", b"x" * 500)
            sys.stdout.write(f"{sys.argv[2]}-{k}\\n"); sys.stdout.flush()
        """
    )
    path = tmp_path / "edges.sqlite"
    for turn in range(4):
        process = subprocess.Popen(
            [sys.executable, "-c", program, str(path), str(turn)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.02 * turn)
        os.kill(process.pid, signal.SIGKILL)
        told = [line.strip() for line in process.stdout.read().splitlines()]
        process.wait()
        with EdgeStore(path) as store:
            assert all(store.get(key) is not None for key in told if key)
            assert store.get(f"{turn}-0") is not None


ROBOT = load_robot("ur10e_class")


def payload_with(**changes) -> bytes:
    """A motion's bytes with other arrays or, for names that are no arrays, other scalars."""
    with np.load(io.BytesIO(encode_motion(_motion()))) as archive:
        arrays = {name: archive[name] for name in archive.files}
    meta = json.loads(str(arrays["meta"]))
    for name, value in changes.items():
        if name in arrays:
            arrays[name] = value
        elif value is None:
            meta.pop(name)
        else:
            meta[name] = value
    arrays["meta"] = np.array(json.dumps(meta))
    buffer = io.BytesIO()
    np.savez(buffer, **{name: value for name, value in arrays.items() if value is not None})
    return buffer.getvalue()


WHOLE = _motion().trajectory
IMPOSSIBLE = {
    "negative cost": {"cost": -1.0},
    "NaN cost": {"cost": float("nan")},
    "endless cost of a motion": {"cost": float("inf")},
    "cost as text": {"cost": "1"},
    "no cost": {"cost": None},
    "a field more": {"colour": 1},
    "certified by a word": {"certified": "yes"},
    "negative clearance proven": {"proven_clearance_m": -0.1},
    "unknown status": {"status": "perfect"},
    "unknown source": {"source": "dream"},
    "half an iteration": {"iterations": 0.5},
    "three of six joints": {"q_rad": WHOLE.q_rad[:, :3]},
    "three of six velocities": {"velocity_rad_s": WHOLE.velocity_rad_s[:, :3]},
    "torque of another length": {"torque_nm": WHOLE.torque_nm[:-1]},
    "NaN angle": {"q_rad": np.full_like(WHOLE.q_rad, np.nan)},
    "time that stands": {"t_s": np.zeros_like(WHOLE.t_s)},
    "whole numbers": {"q_rad": np.zeros(WHOLE.q_rad.shape, dtype=int)},
    "no angles": {"q_rad": None},
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_no_motion_can_be_is_absent(name, tmp_path) -> None:
    payload = payload_with(**IMPOSSIBLE[name])
    with pytest.raises(ValueError):
        decode_motion(payload, ROBOT)
    with EdgeStore(tmp_path / "edges.sqlite") as store:
        store.put("k", payload)
        assert store.motion("k", ROBOT) is None
        store.put("k", payload_with())
        assert store.motion("k", ROBOT) is not None


def raw(path, statement: str, *values) -> None:
    with sqlite3.connect(path) as database:
        database.execute(statement, values)
    database.close()


def test_every_flipped_bit_of_an_entry_is_noticed(tmp_path) -> None:
    path = tmp_path / "edges.sqlite"
    with EdgeStore(path) as store:
        store.put("k", encode_motion(_motion()))
    with sqlite3.connect(path) as database:
        whole = database.execute("SELECT payload FROM edges").fetchone()[0]
    rng = np.random.default_rng(0)
    for bit in rng.integers(0, 8 * len(whole), 200):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << (bit % 8)
        raw(path, "UPDATE edges SET payload = ?", bytes(flipped))
        with EdgeStore(path) as store:
            assert store.get("k") is None


@pytest.mark.parametrize("value", [b"", b"short", "text", 7])
def test_an_entry_of_another_kind_is_absent(value, tmp_path) -> None:
    path = tmp_path / "edges.sqlite"
    with EdgeStore(path) as store:
        store.put("k", b"x")
    raw(path, "UPDATE edges SET payload = ?", value)
    with EdgeStore(path) as store:
        assert store.get("k") is None
        assert store.motion("k", ROBOT) is None


def test_an_entry_under_another_key_is_absent(tmp_path) -> None:
    path = tmp_path / "edges.sqlite"
    with EdgeStore(path) as store:
        store.put("k", b"x")
    raw(path, "UPDATE edges SET key = 'l'")
    with EdgeStore(path) as store:
        assert store.get("l") is None


def test_an_archive_that_unpacks_to_more_than_it_may_is_not_unpacked() -> None:
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("t_s.npy", "w", force_zip64=True) as member,
    ):
        for _ in range(300):
            member.write(bytes(1 << 20))
    with pytest.raises(ValueError, match="when unpacked"):
        decode_motion(buffer.getvalue(), ROBOT)


def test_an_array_that_says_it_is_longer_than_its_bytes_is_refused() -> None:
    member = io.BytesIO()
    np.save(member, np.zeros(4))
    lie = member.getvalue().replace(b"(4,), }        ", b"(400000000,), }")
    assert lie != member.getvalue()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("t_s.npy", lie)
    with pytest.raises(ValueError):
        decode_motion(buffer.getvalue(), ROBOT)


def code_of(path) -> str:
    def use() -> None:
        with EdgeStore(path) as store:
            store.put("k", b"x" * 100_000)
            store.get("k")

    with pytest.raises(InputError) as caught:
        use()
    (fault,) = caught.value.faults
    assert fault.file == str(path)
    return fault.code


def test_each_damage_of_the_file_has_one_code(tmp_path) -> None:
    newer, other, broken, cut = (tmp_path / f"{k}.sqlite" for k in range(4))
    raw(newer, "PRAGMA user_version=2")
    assert code_of(newer) == "store-version"
    raw(other, "CREATE TABLE edges (key TEXT, cost REAL, payload BLOB)")
    assert code_of(other) == "store-damaged"
    broken.write_bytes(b"no database at all" * 100)
    assert code_of(broken) == "store-damaged"
    with EdgeStore(cut) as store:
        for k in range(200):
            store.put(f"k{k}", b"x" * 1000)
    content = bytearray(cut.read_bytes())
    content[4096:] = b"\xff" * (len(content) - 4096)
    cut.write_bytes(content)
    assert code_of(cut) == "store-damaged"
    assert code_of("/proc/none/edges.sqlite") == "store-write"


def test_a_full_disk_is_coded_and_keeps_what_was_put(tmp_path) -> None:
    path = tmp_path / "edges.sqlite"
    with EdgeStore(path) as store:
        store.put("first", b"1")
        store._db.execute("PRAGMA max_page_count=8")
        with pytest.raises(InputError, match="store-write"):
            store.put("second", b"x" * 1_000_000)
        assert store.get("first") == b"1"
        store._db.execute("PRAGMA query_only=1")
        with pytest.raises(InputError, match="store-write"):
            store.put("third", b"x")
    with EdgeStore(path) as store:
        assert store.get("first") == b"1"
        assert store.get("second") is None


def test_a_store_says_its_schema(tmp_path) -> None:
    with EdgeStore(tmp_path / "edges.sqlite"):
        pass
    with sqlite3.connect(tmp_path / "edges.sqlite") as database:
        assert database.execute("PRAGMA user_version").fetchone() == (1,)
