"""Work on a disk beside a node's loop (`side_work`): it may take seconds for a write; what it refuses is an outcome.

The node hands a job over, goes on, and looks for its outcome in a later step.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from typing import Any, TypeVar

from common.side_work import DeferredWorker, SideWorker, ThreadWorker, Work

T = TypeVar("T")

DISK_ERRORS = (OSError, sqlite3.Error)


def disk_worker(name: str, *, at_once: bool = False) -> SideWorker[Callable[[], Any], Any]:
    """Its jobs are called. `at_once`: for lockstep, where a run must repeat to the bit."""
    if at_once:
        return DeferredWorker(_calls, errors=DISK_ERRORS)
    return ThreadWorker(f"{name}-disk", _calls, errors=DISK_ERRORS)


def _calls() -> Work[Callable[[], Any], Any]:
    return lambda job: job()
