"""What runs the edges of a command: spawned processes that go with it, threads, or a cluster."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import (
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import contextmanager
from typing import Any, TypeVar

from dmoc.errors import ProblemError

T = TypeVar("T")
PR_SET_PDEATHSIG = 1
KINDS = ("processes", "threads", "serial", "dask")
CONNECT_S, RETRIES = 30, 2


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
def worker_pool(workers: int, kind: str = "processes") -> Iterator[Executor | None]:
    """What runs the edges; None where this process is enough.

    `kind`: `processes` (`workers` spawned ones; 0: one per core), `threads`, `serial`, `dask` (a
    cluster of `workers` processes on this machine) or `dask://HOST:PORT` (a scheduler that runs).
    """
    name, _, address = kind.partition("://")
    if name not in KINDS or (address and name != "dask") or kind.endswith("://"):
        raise ProblemError.of(
            "executor",
            field="--executor",
            value=kind,
            legal=f"{', '.join(KINDS)} or dask://HOST:PORT",
            fix="name one of these",
        )
    count = workers or os.cpu_count() or 1
    if name == "dask":
        with _dask(count, address) as cluster:
            yield cluster
        return
    if name == "serial" or count == 1:
        yield None
        return
    if name == "threads":
        with ThreadPoolExecutor(count) as threads:
            yield threads
        return
    pool = WorkerPool(count)
    try:
        yield pool
    except BaseException:
        pool.end()  # edges in flight are lost, finished ones are in the store
        raise
    else:
        pool.shutdown()


@contextmanager
def _dask(workers: int, address: str) -> Iterator[Executor]:
    """An executor of the cluster at `address`, or of one on this machine where that is empty."""
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise ProblemError.of(
            "dask-missing",
            field="--executor",
            value="dask",
            legal="an environment that has dask.distributed",
            fix="pip install 'dmoc[cluster]'",
        ) from error
    try:
        if address:
            client = Client(f"tcp://{address}", timeout=CONNECT_S)
        else:
            client = Client(n_workers=workers, threads_per_worker=1, dashboard_address=None)
    except (OSError, ValueError) as error:
        raise ProblemError.of(
            "no-cluster",
            field="--executor",
            value=f"dask://{address}",
            legal="the address of a scheduler that answers",
            fix=f"start one there with `dask scheduler` ({type(error).__name__})",
        ) from error
    # Every edge is a pure function of its job; a worker that dies costs a new try elsewhere.
    with client, client.get_executor(pure=False, retries=RETRIES) as executor:
        try:
            yield executor
        except (KilledWorker, CancelledError) as error:
            raise ProblemError.of(
                "workers-gone",
                field="--executor",
                value=f"{address or 'local cluster'}: {type(error).__name__}",
                legal="a scheduler that stays, and edges that do not kill worker after worker",
                fix="run again: finished edges are kept",
            ) from error
