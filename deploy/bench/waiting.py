"""Benchmarks wait for a condition, and fail with one sentence where it does not come."""

from __future__ import annotations

import time
from collections.abc import Callable

_POLL_S = 0.005


class BenchFailed(Exception):
    """What was waited for did not come."""


def until(condition: Callable[[], bool], timeout_s: float, what: str) -> None:
    """Raises BenchFailed when the condition does not hold within the time."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise BenchFailed(f"{what} did not come within {timeout_s:.0f} s")
        time.sleep(_POLL_S)
