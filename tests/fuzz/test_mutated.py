"""No mutated input ends in anything but a value or a coded error; more with `make fuzz`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOUND = {"pieces": 56, "log": 7, "obj": 19, "ply": 162, "glb": 223, "gtsp": 0, "studs": 0}
COUNT = int(os.environ.get("DMOC_FUZZ", "20"))


@pytest.mark.parametrize("kind", FOUND)
def test_mutated_inputs_are_read_or_refused(kind) -> None:
    """From a case that once ended in a traceback on."""
    script = Path(__file__).with_name("mutated.py")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(script), kind, str(FOUND[kind]), str(COUNT)],
        env=os.environ | {"PYTHONPATH": str(script.parents[2])},
        capture_output=True,
        text=True,
        check=False,
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0, (lines[-1:], done.stderr)
    assert [line for line in lines if line.startswith("[")] == []
