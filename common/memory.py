"""Memory that was needed for a moment goes back to the system, whatever still lies above it on the heap."""

from __future__ import annotations

import ctypes

_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU C library


def give_back() -> None:
    """Takes some milliseconds: not for a thread that keeps a rhythm."""
    if _trim is not None:
        _trim(0)
