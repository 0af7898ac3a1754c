"""Batches: same motions for any executor."""

from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import pytest
from random_arms import random_problems

from dmoc.robot.robot import load_robot
from dmoc.solving.solver import solve, solve_many


def fingerprint(motions):
    return [
        (
            m.status,
            m.cost,
            m.iterations,
            m.max_defect,
            m.trajectory.q_rad.tobytes(),
            m.trajectory.torque_nm.tobytes(),
            m.trajectory.velocity_rad_s.tobytes(),
        )
        for m in motions
    ]


@pytest.fixture(scope="module")
def problems():
    return random_problems(load_robot("ur10e_class"), 20, seed=21)


@pytest.fixture(scope="module")
def alone(problems):
    return fingerprint([solve(problem) for problem in problems])


class Backwards(Executor):
    """Runs everything last to first when the first result is asked for."""

    def map(self, fn, *iterables, timeout=None, chunksize=1):
        jobs = list(zip(*iterables))
        results = [fn(*job) for job in reversed(jobs)]
        return iter(reversed(results))

    def submit(self, fn, *args, **kwargs):
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_order_of_work_does_not_matter(problems, alone) -> None:
    assert fingerprint(solve_many(problems)) == alone
    assert fingerprint(solve_many(problems, Backwards())) == alone
    shuffled = problems[::-1]
    assert fingerprint(solve_many(shuffled))[::-1] == alone


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_processes(problems, alone, workers) -> None:
    with ProcessPoolExecutor(workers) as executor:
        motions = solve_many(problems, executor)
    assert fingerprint(motions) == alone
    assert all(m.trajectory.robot is p.robot for m, p in zip(motions, problems))


def test_threads(problems, alone) -> None:
    with ThreadPoolExecutor(3) as executor:
        assert fingerprint(solve_many(problems, executor)) == alone


def test_progress_and_nothing(problems) -> None:
    seen = []
    solve_many(problems[:9], progress=lambda done, total: seen.append((done, total)))
    assert seen == [(8, 9), (9, 9)]
    assert solve_many([]) == []
