"""Who comes first where a computer has one slow core: bridge and comm by their units, and who comes after them here."""

from __future__ import annotations

import contextlib
import os
import threading

LAST_NICENESS = 19


def leave_priority_to_comm() -> None:
    """For a thread that comm's process has besides: what the unit gives to the process is for comm and the mesh."""
    thread = threading.get_native_id()
    if os.getpriority(os.PRIO_PROCESS, thread) < 0:
        os.setpriority(os.PRIO_PROCESS, thread, 0)


def come_last() -> None:
    """For a process, whatever the priority of the one that started it: it gets the time that nobody else wants."""
    os.setpriority(os.PRIO_PROCESS, 0, LAST_NICENESS)
    with contextlib.suppress(OSError):  # some containers refuse it
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
