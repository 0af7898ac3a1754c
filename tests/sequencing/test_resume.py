"""A killed run, run again, ends with the bytes of a run that nobody touched."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

SPAWN_SAFE = "if __name__ == '__main__':\n    from sequencing.cli import main\n    main()\n"


def stored(folder: Path) -> dict[str, bytes]:
    with sqlite3.connect(f"file:{folder / 'edges.sqlite'}?mode=ro", uri=True) as database:
        return {row[0]: bytes(row[1]) for row in database.execute("select * from edges")}


def edges_so_far(folder: Path) -> int:
    try:
        return len(stored(folder))
    except sqlite3.OperationalError:  # not there yet, or being written
        return 0


@pytest.mark.slow
@pytest.mark.parametrize("edges", [40, 150])
def test_kill_and_resume_gives_the_same_bytes(tmp_path: Path, edges: int) -> None:
    """coal's hidden state once made 16 of 294 edges differ in the ninth digit."""
    script = tmp_path / "run.py"
    script.write_text(SPAWN_SAFE)
    command = [sys.executable, str(script), "demo", "--out"]
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([*command, str(whole)], check=True, **quiet)
    process = subprocess.Popen([*command, str(cut)], start_new_session=True, **quiet)
    while edges_so_far(cut) < edges:
        assert process.poll() is None, "the run ended before it could be killed"
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert edges_so_far(cut) < len(stored(whole))
    subprocess.run([*command, str(cut)], check=True, **quiet)
    first, second = stored(whole), stored(cut)
    assert first.keys() == second.keys()
    assert [key for key in first if first[key] != second[key]] == []
    for name in ("result.json", "motions.npz"):
        assert (whole / name).read_bytes() == (cut / name).read_bytes(), name
