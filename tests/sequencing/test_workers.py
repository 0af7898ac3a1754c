"""Workers end with the command, also when it is killed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from test_cycle import small_station

from dmoc.errors import ProblemError
from planning.collision.world import CollisionWorld
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives
from sequencing.commands.workers import WorkerPool, worker_pool
from sequencing.edges import jobs as jobs_module
from sequencing.edges import worker
from sequencing.edges.nodes import station_nodes
from sequencing.edges.oracle import EdgeEvent, StationEdges
from sequencing.edges.store import EdgeStore

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


KILLS = "DMOC_TEST_KILLS"


def deadly(job: worker.EdgeJob) -> worker.EdgeResult:
    """Kills its process at the edges to the stud named in KILLS; as often as that file says."""
    stud, _, counter = os.environ[KILLS].partition(":")
    result = worker.EdgeResult(job.key, None, 0.0)
    if job.bundle is not None:
        worker._keep(worker._bundles, job.context, job.bundle)
    if job.context in worker._bundles:
        left = int(Path(counter).read_text())
        if job.target == stud and left > 0:
            Path(counter).write_text(str(left - 1))
            os.kill(os.getpid(), signal.SIGKILL)
        result = worker.EdgeResult(job.key, job.key.encode(), 0.0)
    return result


@pytest.fixture(scope="module")
def station() -> Station:
    return small_station(3, 2)


def oracle_of(station: Station, store: EdgeStore, executor) -> StationEdges:
    world = CollisionWorld(station)
    nodes = station_nodes(station, alternatives(station, world))
    return StationEdges(station, world, nodes, store, executor=executor)


@pytest.mark.parametrize(("deaths", "lost"), [(1, 0), (99, 1)])
def test_a_killed_worker_costs_its_edge_at_most(
    station, deaths, lost, tmp_path, monkeypatch
) -> None:
    """Once: nothing. Again and again: the poisonous edge is named after two tries."""
    counter = tmp_path / "left"
    counter.write_text(str(deaths))
    pool = WorkerPool(2)
    monkeypatch.setenv(KILLS, f"{station.studs[2].id}:{counter}")
    monkeypatch.setattr(jobs_module, "solve_edge", deadly)
    with EdgeStore(tmp_path / "edges.sqlite") as store:
        oracle = oracle_of(station, store, pool)
        studs = oracle.nodes.stud
        pairs = [tuple(map(int, pair)) for pair in oracle.nodes.usable_pairs()]
        poisonous = [pair for pair in pairs if studs[pair[1]] == station.studs[2].id][:1]
        chosen = [p for p in pairs if studs[p[1]] != station.studs[2].id][:20] + poisonous
        wanted = [oracle.jobs.job(*pair, "screen") for pair in chosen]
        try:
            done = list(oracle.jobs.solve(wanted))
        finally:
            pool.shutdown()
        assert sorted(done) == sorted(job.key for job in wanted)
        assert len(store) == len(wanted) - lost
    assert len(oracle.jobs.lost) == lost
    for motion in oracle.jobs.lost.values():
        assert motion.note.endswith(f"{station.studs[2].id} killed its worker twice")
        assert oracle.reuse().lost == (motion.note,)
        assert not np.isfinite(motion.cost)
    assert int(counter.read_text()) == deaths - (2 if lost else 1)


def test_a_pool_that_cannot_be_renewed_ends_in_a_coded_error(
    station, tmp_path, monkeypatch
) -> None:
    counter = tmp_path / "left"
    counter.write_text("99")
    monkeypatch.setenv(KILLS, f"{station.studs[2].id}:{counter}")
    monkeypatch.setattr(jobs_module, "solve_edge", deadly)
    with EdgeStore(":memory:") as store, WorkerPool(1)._pool as pool:
        oracle = oracle_of(station, store, pool)
        pairs = oracle.nodes.usable_pairs()
        studs = np.array(oracle.nodes.stud)
        bad = pairs[studs[pairs[:, 1]] == station.studs[2].id][0]
        with pytest.raises(ProblemError, match="workers-gone") as caught:
            list(oracle.jobs.solve([oracle.jobs.job(*bad, "screen")]))
        assert station.studs[2].id in str(caught.value)


def test_four_threads_give_the_bytes_of_one(station, tmp_path) -> None:
    with EdgeStore(":memory:") as one, EdgeStore(":memory:") as four:
        alone = oracle_of(station, one, None)
        with ThreadPoolExecutor(4) as threads:
            together = oracle_of(station, four, threads)
            pairs = together.nodes.usable_pairs()[::7][:16]
            together.evaluate(pairs)
        alone.evaluate(pairs)
        keys = [alone.keys.key(*pair, "screen") for pair in pairs]
        assert keys == [together.keys.key(*pair, "screen") for pair in pairs]
        assert [one.get(key) for key in keys] == [four.get(key) for key in keys]
        assert None not in [one.get(key) for key in keys]


def test_a_world_refuses_another_thread(station) -> None:
    world = CollisionWorld(station)
    q = np.array(station.home_rad)
    assert world.collide(q) is None
    with ThreadPoolExecutor(1) as threads:
        with pytest.raises(ProblemError, match="world-thread"):
            threads.submit(world.collide, q).result()
        assert threads.submit(lambda: CollisionWorld(station).collide(q)).result() is None


def test_no_file_is_left_for_workers(station, tmp_path, monkeypatch) -> None:
    """What a killed run cannot remove does not exist: the station goes with the jobs."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with EdgeStore(":memory:") as store:
        oracle = oracle_of(station, store, None)
        oracle.evaluate(oracle.nodes.usable_pairs()[:1])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["cluster", "dask:", "dask://", "threads://here:1"])
def test_an_executor_that_does_not_exist_is_named(kind) -> None:
    with pytest.raises(ProblemError, match="executor") as caught, worker_pool(2, kind):
        pass
    assert kind in str(caught.value)


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch) -> None:
    monkeypatch.setattr("sequencing.commands.workers.CONNECT_S", 1)
    with pytest.raises(ProblemError, match="no-cluster"), worker_pool(2, "dask://127.0.0.1:9"):
        pass


def _started(arguments: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """A part of a cluster that keeps all that it writes in a folder of its own."""
    folder.mkdir()
    own = {**os.environ, "HOME": str(folder), "TMPDIR": str(folder)}
    command = [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]]
    with open(folder / "log", "wb") as log:
        return subprocess.Popen(command, cwd=folder, env=own, stdout=log, stderr=log)


@pytest.mark.slow
def test_a_cluster_without_a_common_folder_gives_the_same_bytes(station, tmp_path) -> None:
    """Workers of one and of three threads; one is killed when the first edge is there."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    port = address.rpartition(":")[2]
    scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]
    worker_of = ["dask_worker", f"tcp://{address}", "--no-nanny", "--no-dashboard", "--nthreads"]
    parts = [_started(scheduler, tmp_path / "scheduler")]
    try:
        parts += [_started([*worker_of, n], tmp_path / f"worker{n}") for n in ("1", "3")]
        with EdgeStore(":memory:") as one, EdgeStore(":memory:") as many:
            alone = oracle_of(station, one, None)
            pairs = alone.nodes.usable_pairs()[::7][:12]
            alone.evaluate(pairs)
            with worker_pool(2, f"dask://{address}") as cluster:
                together = oracle_of(station, many, cluster)
                seen: list[EdgeEvent] = []

                def kill_one(event: EdgeEvent) -> None:
                    seen.append(event)
                    if len(seen) == 1:
                        parts[1].kill()

                together.progress = kill_one
                together.evaluate(pairs)
            assert len(seen) == len(pairs)
            assert parts[1].wait(10) == -signal.SIGKILL
            keys = [alone.keys.key(*pair, "screen") for pair in pairs]
            assert [one.get(key) for key in keys] == [many.get(key) for key in keys]
            assert None not in [one.get(key) for key in keys]
    finally:
        for part in parts:
            part.kill()
            part.wait()
