"""Worker processes of a command: spawned, deaf to Ctrl-C, and gone when the command goes."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

PR_SET_PDEATHSIG = 1


def _prepare_worker() -> None:
    # The parent decides what an interrupt means; a worker that dies of it would break the pool.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform == "linux":  # a parent that is killed cannot end its workers: the kernel does
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


@contextmanager
def worker_pool(workers: int) -> Iterator[Executor | None]:
    """A spawn pool of `workers` processes (0: one per core); None where one process is enough."""
    count = workers or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    pool = ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_worker
    )
    try:
        yield pool
    except BaseException:
        # Edges in flight are lost, finished ones are in the store: end the workers at once.
        processes = list(pool._processes.values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        raise
    else:
        pool.shutdown()
