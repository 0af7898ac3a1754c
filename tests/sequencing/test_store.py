"""The edge store survives a kill, and its bytes are read back as the same motion."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

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
    import io

    buffer = io.BytesIO()
    np.savez(buffer, meta=np.array([{"a": object}], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
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
