"""Work beside a run in lockstep, in another process: on simulated time, whatever it takes in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from common.side_work import Work
from offboard.simulator.run.awaited_work import AwaitedWorker, WorkFailed
from offboard.simulator.stopwatch import BESIDE, Stopwatch
from tests.unit.side_jobs import counting

LATENCY_S = 0.4


@pytest.fixture
def made() -> Iterator[Callable[..., AwaitedWorker]]:
    workers: list[AwaitedWorker] = []

    def make(load: Callable[[], Work] = counting, stopwatch: Stopwatch | None = None) -> AwaitedWorker:
        workers.append(AwaitedWorker(stopwatch or Stopwatch(), LATENCY_S, load))
        return workers[-1]

    yield make
    for worker in workers:
        worker.close()


def test_a_result_comes_at_its_time_however_fast_or_slow_the_work_is(made: Callable[..., AwaitedWorker]) -> None:
    worker = made()
    worker.begin("fast", 10.0)
    worker.begin("slow", 10.1)
    time.sleep(0.1)
    assert worker.result(10.39) is None, "it is there, but not due"
    outcome = worker.result(10.41)
    assert outcome is not None
    assert outcome.value == ("fast", 1)
    assert (worker.pending, worker.due_s(10.41)) == (1, pytest.approx(10.5))
    outcome = worker.result(10.51)
    assert outcome is not None, "it is waited for"
    assert outcome.value == ("slow", 2)
    assert not worker.busy


def test_waiting_is_on_an_account_of_its_own(made: Callable[..., AwaitedWorker]) -> None:
    stopwatch = Stopwatch()
    worker = made(stopwatch=stopwatch)
    stopwatch.enter("planner")
    worker.begin("slow", 0.0)
    worker.result(1.0)
    assert stopwatch.spent_s()[BESIDE] > 0.2


def test_large_jobs_and_results_do_not_hold_each_other_up(made: Callable[..., AwaitedWorker]) -> None:
    worker = made(lambda: lambda job: job)
    jobs = [bytes([i]) * 3_000_000 for i in range(4)]
    for job in jobs:
        worker.begin(job, 0.0)
    outcomes = [worker.result(1.0) for _ in jobs]
    assert [outcome.value for outcome in outcomes if outcome is not None] == jobs


def test_a_process_that_ends_ends_the_run_in_one_sentence(made: Callable[..., AwaitedWorker]) -> None:
    worker = made()
    worker.begin("die", 0.0)
    with pytest.raises(WorkFailed, match=r"has ended by itself \(exit code 3\)"):
        worker.result(1.0)
    assert worker.close() is None


def test_closing_gives_what_is_still_due(made: Callable[..., AwaitedWorker]) -> None:
    worker = made()
    worker.begin("last", 0.0)
    outcome = worker.close()
    assert outcome is not None
    assert outcome.value == ("last", 1)
