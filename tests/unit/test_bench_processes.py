"""Benchmarks find the programs of the board by their command lines, and what threads cost in the text of /proc."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from deploy.bench.mission import board_program
from deploy.bench.process_cost import ThreadCost, between, memory, niceness, thread_cost, threads

STATUS = "Name:\tmmu\nState:\tS (sleeping)\nvoluntary_ctxt_switches:\t120\nnonvoluntary_ctxt_switches:\t7\n"


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("python -m onboard.comm --parent 7 --config robot.toml", "comm"),
        ("python -m onboard comm+mmu+planner --parent 7", "comm+mmu+planner"),
        ("/a/.venv/bin/python3 -u -m onboard.bridge", "bridge"),
        ("python -m onboard.poi --config robot.toml", ""),
        ("python -m offboard.recorder --run-dir onboard.comm", ""),
        ("python -c from multiprocessing.spawn import spawn_main", ""),
        ("python -m", ""),
    ],
)
def test_program_of_the_board_by_its_command_line(words: str, name: str) -> None:
    assert board_program(words.split()) == name


def test_a_wake_up_is_a_sleep_that_ended_and_not_a_core_that_was_taken_away() -> None:
    assert thread_cost(STATUS, 2_500_000_000) == ThreadCost("mmu", 2.5, 120)


def test_threads_of_one_name_cost_together_and_only_what_came_between_the_looks() -> None:
    before = {1: ThreadCost("tokio", 1.0, 100), 2: ThreadCost("mmu", 5.0, 50)}
    after = {1: ThreadCost("tokio", 1.5, 200), 2: ThreadCost("mmu", 7.0, 70), 3: ThreadCost("tokio", 0.5, 20)}
    mmu, tokio = between(before, after, 10.0)
    assert (mmu.name, mmu.threads, mmu.cpu_share, mmu.wakeups_hz) == ("mmu", 1, 0.2, 2.0)
    assert (tokio.name, tokio.threads, tokio.cpu_share, tokio.wakeups_hz) == ("tokio", 2, 0.1, 12.0)


def test_a_busy_process_costs_and_a_sleeping_one_does_not() -> None:
    busy = subprocess.Popen([sys.executable, "-c", "print(flush=True)\nwhile True: pass"], stdout=subprocess.PIPE)
    asleep = subprocess.Popen([sys.executable, "-c", "print(flush=True)\nimport time; time.sleep(60)"], stdout=-1)
    try:
        for process in (busy, asleep):
            assert process.stdout is not None
            process.stdout.readline()
        before = [threads([process.pid]) for process in (busy, asleep)]
        time.sleep(0.5)
        of_busy, of_asleep = (
            between(seen, threads([process.pid]), 0.5)[0].cpu_share
            for seen, process in zip(before, (busy, asleep), strict=True)
        )
        assert of_busy > 5 * of_asleep
        assert memory([busy.pid]).resident_mb >= memory([busy.pid]).proportional_mb > 0
    finally:
        for process in (busy, asleep):
            process.kill()
            process.communicate()


def test_what_is_gone_costs_nothing() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert threads([ended.pid]) == {}
    assert niceness(ended.pid) is None
    assert niceness(os.getpid()) is not None
