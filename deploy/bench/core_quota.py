"""Processes on one core that is slower than it is: a stand-in for the board's, made of a share of a core here.

As root a competitor takes the core by turns (`deploy.bench.competitor`): what is due waits for 4.2 ms at most at a
fifteenth of the speed, so that priorities among the processes hold, as they do on a slow core. Elsewhere they are
stopped and continued by signals, all at once and for 28 ms, which knows no priorities.

Not by a quota of a control group, which the kernel enforces late. Measured with 1 ms in each 15 ms: a busy loop ran for
up to 2.4 ms, then all stood for up to 43 ms, bridge and comm as well, for a step of mmu.
Nor by a simulated clock that goes faster: the shared one waits for who is late.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from deploy.bench import competitor
from deploy.bench.waiting import BenchFailed

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
        return ByTurns(core, factor)
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


class ByTurns:
    """By a competitor of real-time priority. Raises OSError where none may have it."""

    def __init__(self, core: int, factor: float) -> None:
        self._core = core
        period_ms = 1000 * competitor.TURN_S * factor
        self.what = f"{1000 * competitor.TURN_S:.1f} ms in each {period_ms:.1f} ms, by turns with a competitor"
        command = [sys.executable, competitor.__file__, str(core), str(factor)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            self.close()
            raise PermissionError("no real-time priority")

    def add(self, pids: Iterable[int]) -> None:
        pin(pids, [self._core])

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


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
