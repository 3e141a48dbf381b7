"""Memory of a process that lives long: what is freed goes back to the system, what stays is not looked at again."""

from __future__ import annotations

import ctypes
import gc

_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU C library


def give_back() -> None:
    """Takes some milliseconds: not for a thread with a fixed period."""
    if _trim is not None:
        _trim(0)


def keep_what_is_there() -> None:
    """To be called once all is imported and built. It stays: no pass of the garbage collector looks at it again.

    A full pass over what a program imports takes 5 ms here and holds every thread, in the middle of whichever step.
    """
    gc.collect()
    gc.freeze()
