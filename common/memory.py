"""Returns freed memory to the system, also where blocks in use lie above it on the heap."""

from __future__ import annotations

import ctypes

_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU C library


def give_back() -> None:
    """Takes some milliseconds: not for a thread with a fixed period."""
    if _trim is not None:
        _trim(0)
