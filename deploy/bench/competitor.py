"""A process that takes from a core what a slower core would lack, and leaves the rest to all others there.

    python deploy/bench/competitor.py CORE FACTOR

By turns it sleeps for TURN_S, in which the others run, and keeps the core until they have had 1 / FACTOR of the time.
It has a real-time priority, so that it takes the core from whoever has it, at once; what the machine needs for the
changes counts as its own. It prints a line once it has begun, and ends with its parent.
"""

from __future__ import annotations

import gc
import os
import sys
import time

# Shorter turns are dearer for the others, whose caches are cold at the beginning of each: coding and decoding of
# messages takes 5 % more processor time with this one, 26 % with 0.1 ms
TURN_S = 0.0003
_PRIORITY = 90
_FORGET_S = 0.01  # what was taken from this process is made up for so far
_LOOK_EVERY = 500  # turns: whether its parent is still there


def compete(core: int, factor: float, parent: int) -> None:
    """Until the parent has ended. Raises OSError where it may not have the priority."""
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    gc.disable()
    sys.stdout.write("begun\n")
    sys.stdout.flush()
    used_s, now_s, sleep = time.thread_time, time.monotonic, time.sleep
    share = 1.0 - 1.0 / factor
    ahead_s = used_s() - share * now_s()
    while os.getppid() == parent:
        for _ in range(_LOOK_EVERY):
            sleep(TURN_S)
            while (behind_s := ahead_s + share * now_s() - used_s()) > 0.0:
                if behind_s > _FORGET_S:
                    ahead_s -= behind_s


if __name__ == "__main__":
    compete(int(sys.argv[1]), float(sys.argv[2]), os.getppid())
