"""Where a core is short, bridge and comm come first; `test_side_work` has who comes last."""

from __future__ import annotations

import os
import threading

import pytest

from common.priority import leave_priority_to_comm
from deploy.boards.units import niceness


def niceness_afterwards(begins_with: int) -> int:
    """Of a thread that leaves the priority to comm."""
    found: list[int] = []

    def run() -> None:
        thread = threading.get_native_id()
        try:
            os.setpriority(os.PRIO_PROCESS, thread, begins_with)
        except PermissionError:
            return
        leave_priority_to_comm()
        found.append(os.getpriority(os.PRIO_PROCESS, thread))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    if not found:
        pytest.skip("no priority above the usual one may be taken here")
    return found[0]


def test_the_unit_s_priority_is_left_to_comm_and_a_lower_one_is_kept() -> None:
    assert niceness_afterwards(5) == 5
    assert niceness_afterwards(-5) == 0


def test_bridge_comes_before_comm_s_process_and_that_before_all_others() -> None:
    assert niceness("bridge") < niceness("comm+mmu+planner") < 0 == niceness("mmu+planner")
