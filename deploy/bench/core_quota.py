"""Processes on one core that is slower than it is: a stand-in for the board's, made of a share of a core here.

Where control groups can be written (as root), the kernel grants the processes so much time in each period; priorities
among them hold. Elsewhere they are stopped and continued by signals, all at once, which knows no priorities.
Both are coarser than a slow core: what is due while the share is used up waits until the period ends.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from deploy.bench.waiting import BenchFailed

_ROOT = Path("/sys/fs/cgroup")
_QUOTA_US = 1000  # in each period: the least that the kernel takes
_RUN_S = 0.002  # of a period by signals: shorter ones are not kept


class ThrottledCore(Protocol):
    """`add` processes; those that they start later belong to it too."""

    what: str  # how it is done, for people

    def add(self, pids: Iterable[int]) -> None:
        """Those that are there already, or gone, may be named again."""

    def close(self) -> None:
        """At full speed from now on."""


def throttled_core(core: int, factor: float) -> ThrottledCore:
    """That core at 1 / factor of its speed."""
    try:
        return GroupQuota(core, factor)
    except OSError:
        return DutyCycle(core, factor)


def pin(pids: Iterable[int], cores: Iterable[int]) -> None:
    """All threads of these processes onto these cores; those that are gone are left out."""
    wanted = set(cores)
    for pid in pids:
        with suppress(OSError):
            for task in Path(f"/proc/{pid}/task").iterdir():
                with suppress(OSError):
                    os.sched_setaffinity(int(task.name), wanted)


class GroupQuota:
    """By a control group of version 1 or 2. Raises OSError where none can be made."""

    def __init__(self, core: int, factor: float) -> None:
        self._core = core
        period_us = round(_QUOTA_US * factor)
        name = f"indoor-mapping-{os.getpid()}-{core}"
        if (_ROOT / "cgroup.controllers").exists():
            (_ROOT / "cgroup.subtree_control").write_text("+cpu", encoding="ascii")
            self._group, settings = _ROOT / name, {"cpu.max": f"{_QUOTA_US} {period_us}"}
        else:
            self._group = _ROOT / "cpu" / name
            settings = {"cpu.cfs_period_us": str(period_us), "cpu.cfs_quota_us": str(_QUOTA_US)}
        self.what = f"{_QUOTA_US / 1000:.0f} ms in each {period_us / 1000:.0f} ms by a control group"
        self._group.mkdir()
        try:
            for file, value in settings.items():
                (self._group / file).write_text(value, encoding="ascii")
        except OSError:
            self._group.rmdir()
            raise

    def add(self, pids: Iterable[int]) -> None:
        inside = set((self._group / "cgroup.procs").read_text(encoding="ascii").split())
        new = [pid for pid in pids if str(pid) not in inside]
        pin(new, [self._core])
        for pid in new:
            with suppress(OSError):  # it is gone
                (self._group / "cgroup.procs").write_text(str(pid), encoding="ascii")

    def close(self) -> None:
        for pid in (self._group / "cgroup.procs").read_text(encoding="ascii").split():
            with suppress(OSError):
                (self._group.parent / "cgroup.procs").write_text(pid, encoding="ascii")
        self._group.rmdir()


class DutyCycle:
    """By SIGSTOP and SIGCONT, from a thread here."""

    def __init__(self, core: int, factor: float) -> None:
        self._core, self._pause_s = core, _RUN_S * (factor - 1.0)
        self.what = f"{1000 * _RUN_S:.0f} ms in each {1000 * _RUN_S * factor:.0f} ms by signals"
        self._pids: set[int] = set()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, pids: Iterable[int]) -> None:
        pids = set(pids)
        pin(pids - self._pids, [self._core])
        self._pids = self._pids | pids

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.is_set():
            self._signal(signal.SIGCONT)
            time.sleep(_RUN_S)
            self._signal(signal.SIGSTOP)
            self._ended.wait(self._pause_s)
        self._signal(signal.SIGCONT)

    def _signal(self, number: signal.Signals) -> None:
        for pid in self._pids:
            with suppress(OSError):
                os.kill(pid, number)


def cores() -> tuple[int, set[int]]:
    """The core to slow down, and those for everything else. Raises BenchFailed on a machine with one core."""
    usable = sorted(os.sched_getaffinity(0))
    if len(usable) < 2:
        raise BenchFailed("A second core is needed for what does not run on the board; this machine has one.")
    return usable[-1], set(usable[:-1])
