"""Work beside a loop: one mechanism in a process, on a thread, and deferred; what each does when the work fails."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from math import inf
from typing import Any

import pytest

from common import side_process
from common.side_process import ProcessWorker
from common.side_work import DeferredWorker, JobOutcome, SideWorker, ThreadWorker, WorkLost
from tests.unit.side_jobs import counting

DEADLINE_S = 20.0
Counted = tuple[str, int]
JOBS = "tests.unit.side_jobs:"


def process() -> ProcessWorker[str, Counted]:
    return ProcessWorker("counting", f"{JOBS}counting", "10")


def thread() -> ThreadWorker[str, Counted]:
    return ThreadWorker("counting", lambda: counting("10"), errors=(ValueError,))


def deferred() -> DeferredWorker[str, Counted]:
    return DeferredWorker(lambda: counting("10"), errors=(ValueError,))


@pytest.fixture(params=[process, thread, deferred])
def worker(request: pytest.FixtureRequest) -> Iterator[SideWorker[str, Counted]]:
    made = request.param()
    yield made
    made.close()


def result_of(worker: SideWorker[Any, Any]) -> JobOutcome[Any]:
    end_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < end_s:
        outcome = worker.result(0.0)
        if outcome is not None:
            return outcome
        time.sleep(0.005)
    raise AssertionError(f"no result within {DEADLINE_S:.0f} s")


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def test_results_come_in_the_order_of_the_jobs_and_the_work_keeps_its_state(worker: SideWorker[str, Counted]) -> None:
    for name in ("a", "b", "c"):
        worker.begin(name, 0.0)
    assert worker.pending == 3
    assert [result_of(worker).value for _ in range(3)] == [("a", 11), ("b", 12), ("c", 13)]
    assert not worker.busy
    assert worker.result(0.0) is None


def test_a_job_that_fails_is_an_outcome_and_the_next_one_is_done(worker: SideWorker[str, Counted]) -> None:
    worker.begin("raise", 0.0)
    worker.begin("a", 0.0)
    failed, done = result_of(worker), result_of(worker)
    assert failed.value is None
    assert isinstance(failed.error, WorkLost | ValueError)
    assert done.value is not None
    assert done.value[0] == "a"


def test_it_says_when_to_look_for_a_result(worker: SideWorker[str, Counted]) -> None:
    assert worker.due_s(5.0) == inf
    worker.begin("a", 5.0)
    assert 5.0 <= worker.due_s(5.0) < 5.1
    until(lambda: worker.result(5.1) is not None)
    assert worker.due_s(5.1) == inf


def test_it_becomes_ready_before_its_first_job(worker: SideWorker[str, Counted]) -> None:
    until(lambda: worker.ready)


# In a process


def test_a_process_that_dies_is_replaced_without_its_state_and_its_job_is_lost() -> None:
    worker = process()
    try:
        for name in ("a", "die", "b"):
            worker.begin(name, 0.0)
        assert result_of(worker).value == ("a", 11)
        assert isinstance(result_of(worker).error, WorkLost)
        assert result_of(worker).value == ("b", 11)
    finally:
        worker.close()


def test_a_process_that_was_killed_meanwhile_costs_one_job() -> None:
    worker = process()
    try:
        until(lambda: worker.ready)
        os.kill(worker.pid, 9)
        worker.begin("a", 0.0)
        worker.begin("b", 0.0)
        assert isinstance(result_of(worker).error, WorkLost)
        assert result_of(worker).value == ("b", 11)
    finally:
        worker.close()


def test_a_process_that_hangs_is_killed_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_process, "CLOSE_S", 0.2)
    worker = process()
    worker.begin("hang", 0.0)
    until(lambda: worker.ready)
    pid = worker.pid
    outcome = worker.close()
    assert outcome is None or isinstance(outcome.error, WorkLost)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_what_the_work_prints_is_no_result() -> None:
    worker = process()
    try:
        worker.begin("print", 0.0)
        assert result_of(worker).value == ("print", 11)
    finally:
        worker.close()


def test_a_process_has_the_lowest_priority_and_its_parent_keeps_its_own() -> None:
    before = os.getpriority(os.PRIO_PROCESS, 0)
    worker: ProcessWorker[None, tuple[int, int]] = ProcessWorker("priority", f"{JOBS}priority")
    try:
        worker.begin(None, 0.0)
        assert result_of(worker).value == (19, os.SCHED_IDLE)
        assert os.getpriority(os.PRIO_PROCESS, 0) == before
    finally:
        worker.close()


def test_nobody_waits_for_a_job_that_fills_the_pipe() -> None:
    worker: ProcessWorker[bytes, bytes] = ProcessWorker("echo", f"{JOBS}echo")
    job = bytes(20_000_000)
    try:
        began_s = time.monotonic()
        for _ in range(3):
            worker.begin(job, 0.0)
        assert time.monotonic() - began_s < 1.0
        assert [len(result_of(worker).value) for _ in range(3)] == [len(job)] * 3
    finally:
        worker.close()


# On a thread


def test_an_error_of_the_thread_that_is_no_outcome_is_raised() -> None:
    worker = ThreadWorker("counting", counting)
    worker.begin("raise", 0.0)
    with pytest.raises(ValueError, match="no such job"):
        result_of(worker)
    worker.close()


def test_the_end_waits_for_the_job_that_runs_and_drops_those_behind_it() -> None:
    done = []

    def work(job: str) -> str:
        time.sleep(0.1)
        done.append(job)
        return job

    worker = ThreadWorker("slow", lambda: work)
    worker.begin("a", 0.0)
    worker.begin("b", 0.0)
    until(lambda: worker.ready)
    time.sleep(0.02)
    outcome = worker.close()
    assert outcome is not None
    assert outcome.value == "a"
    assert done == ["a"]


# Deferred


def test_a_deferred_result_comes_after_a_fixed_time_whenever_the_work_is_done() -> None:
    for done_between_the_steps in (False, True):
        worker = DeferredWorker(counting, latency_s=0.4)
        worker.begin("a", 10.0)
        worker.begin("b", 10.2)
        if done_between_the_steps:
            worker.work()
        assert worker.due_s(10.0) == 10.4
        assert worker.result(10.3) is None
        assert worker.result(10.4) == JobOutcome(("a", 1))
        assert worker.due_s(10.4) == pytest.approx(10.6)
        assert worker.result(10.5) is None
        assert worker.result(10.7) == JobOutcome(("b", 2))


def test_deferred_work_is_loaded_for_the_first_job() -> None:
    loaded = []
    worker: DeferredWorker[int, int] = DeferredWorker(lambda: loaded.append(1) or (lambda job: job))  # type: ignore[func-returns-value]
    assert not loaded
    worker.begin(3, 0.0)
    assert worker.result(0.0) == JobOutcome(3)
    assert loaded
