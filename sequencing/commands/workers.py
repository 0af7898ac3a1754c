"""Worker processes of a command: spawned, deaf to Ctrl-C, and gone when the command goes."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")
PR_SET_PDEATHSIG = 1


def _prepare_worker() -> None:
    # The parent decides what an interrupt means; a worker that dies of it would break the pool.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform == "linux":  # a parent that is killed cannot end its workers: the kernel does
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


class WorkerPool(Executor):
    """Spawned processes that can be replaced: one that is killed breaks the pool for good."""

    def __init__(self, workers: int) -> None:
        self._max_workers = workers
        self._pool = self._fresh()

    def _fresh(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._max_workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_prepare_worker,
        )

    def submit(self, function: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        """As of every executor."""
        return self._pool.submit(function, *given, **named)

    def renew(self) -> None:
        """End what is left of the workers and start others."""
        self.end()
        self._pool = self._fresh()

    def end(self) -> None:
        """End the workers at once: what they are at is lost."""
        processes = list((self._pool._processes or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of every executor."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


@contextmanager
def worker_pool(workers: int) -> Iterator[Executor | None]:
    """A spawn pool of `workers` processes (0: one per core); None where one process is enough."""
    count = workers or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    pool = WorkerPool(count)
    try:
        yield pool
    except BaseException:
        pool.end()  # edges in flight are lost, finished ones are in the store
        raise
    else:
        pool.shutdown()
