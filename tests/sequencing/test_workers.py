"""Workers end with the command, also when it is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time

PROGRAM = textwrap.dedent(
    """
    import os, time
    from sequencing.commands.workers import worker_pool
    if __name__ == "__main__":
        with worker_pool(2) as pool:
            futures = [pool.submit(os.getpid) for _ in range(2)]
            print(futures[0].result(), flush=True)
            pool.submit(time.sleep, 120).result()
    """
)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as stat:
        return stat.read().split()[2] != "Z"


def test_a_killed_command_leaves_no_worker(tmp_path) -> None:
    script = tmp_path / "run.py"
    script.write_text(PROGRAM)
    process = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    worker = int(process.stdout.readline())
    assert _alive(worker)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    for _ in range(100):
        if not _alive(worker):
            break
        time.sleep(0.1)
    assert not _alive(worker)
    process.stdout.close()
