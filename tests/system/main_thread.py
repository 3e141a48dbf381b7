"""Holds the main thread of a process, and nothing else of it: its loop is stuck while Zenoh's own threads live on."""

from __future__ import annotations

import ctypes
import os

_SEIZE, _INTERRUPT, _DETACH = 0x4206, 0x4207, 17  # of ptrace
_ALL_THREADS = 0x40000000  # __WALL: a thread that is no child of ours can be waited for too
_libc = ctypes.CDLL(None, use_errno=True)


def _ptrace(request: int, thread: int) -> None:
    nothing = ctypes.c_void_p(0)
    if _libc.ptrace(ctypes.c_long(request), ctypes.c_long(thread), nothing, nothing):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def hold_main_thread(pid: int) -> None:
    """Until `let_go`, which must come from the same thread. The process must be a descendant of this one."""
    _ptrace(_SEIZE, pid)
    _ptrace(_INTERRUPT, pid)
    os.waitpid(pid, _ALL_THREADS)


def let_go(pid: int) -> None:
    _ptrace(_DETACH, pid)
