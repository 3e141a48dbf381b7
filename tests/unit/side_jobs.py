"""Work for the tests of `side_work`, as a process of its own loads it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable


def counting(first: str = "0") -> Callable[[str], tuple[str, int]]:
    """Returns each job with how many there were, counted from `first`; some jobs are traps."""
    count = int(first)

    def work(job: str) -> tuple[str, int]:
        nonlocal count
        count += 1
        if job == "die":
            os._exit(3)
        if job == "raise":
            raise ValueError("no such job")
        if job == "slow":
            time.sleep(0.3)
        if job == "hang":
            time.sleep(600.0)
        if job == "print":
            print("a library that prints")
            os.write(1, b"and one that does so below Python\n")
        return job, count

    return work


def priority() -> Callable[[None], tuple[int, int]]:
    return lambda _: (os.getpriority(os.PRIO_PROCESS, 0), os.sched_getscheduler(0))


def echo() -> Callable[[bytes], bytes]:
    return lambda job: job
