"""What a process and those that it started cost: processor time and wake-ups by thread, memory. From /proc."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class ThreadCost:
    """Since the thread's start."""

    name: str
    cpu_s: float
    wakeups: int  # it went to sleep so often, and was woken


@dataclass(frozen=True, slots=True)
class Memory:
    resident_mb: float
    proportional_mb: float  # a page that several processes share counts by their number


@dataclass(frozen=True, slots=True)
class GroupCost:
    """Threads of one name between two looks, per second."""

    name: str
    threads: int
    cpu_share: float  # of one core
    wakeups_hz: float


def family(pid: int) -> list[int]:
    """The process and all its descendants that live now."""
    children: dict[int, list[int]] = defaultdict(list)
    for entry in _PROC.iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                # The command may hold spaces and brackets; the parent is the second field behind it
                fields = (entry / "stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
                children[int(fields[1])].append(int(entry.name))
    found, waiting = [], [pid]
    while waiting:
        found.append(waiting.pop())
        waiting += children[found[-1]]
    return found


def command_line(pid: int) -> list[str]:
    """Empty where the process is gone."""
    with suppress(OSError):
        return (_PROC / str(pid) / "cmdline").read_text(encoding="utf-8", errors="replace").split("\0")
    return []


def threads(pids: Iterable[int]) -> dict[int, ThreadCost]:
    """All threads of these processes, by thread id."""
    found: dict[int, ThreadCost] = {}
    for pid in pids:
        with suppress(OSError):
            for task in (_PROC / str(pid) / "task").iterdir():
                with suppress(OSError):
                    run_ns = int((task / "schedstat").read_text(encoding="ascii").split()[0])
                    status = (task / "status").read_text(encoding="utf-8", errors="replace")
                    found[int(task.name)] = thread_cost(status, run_ns)
    return found


def thread_cost(status: str, run_ns: int) -> ThreadCost:
    """Of the text of /proc/<pid>/task/<tid>/status, and the time that the thread ran."""
    fields = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    return ThreadCost(fields["Name"], run_ns / 1e9, int(fields["voluntary_ctxt_switches"]))


def niceness(pid: int) -> int | None:
    """0 is usual, 19 comes last; None where the process is gone."""
    with suppress(OSError):
        return os.getpriority(os.PRIO_PROCESS, pid)
    return None


def between(before: dict[int, ThreadCost], after: dict[int, ThreadCost], elapsed_s: float) -> list[GroupCost]:
    """What the threads cost from one look to the next, dearest first; those that ended meanwhile are not counted."""
    cpu_s: dict[str, float] = defaultdict(float)
    runs: dict[str, int] = defaultdict(int)
    count: dict[str, int] = defaultdict(int)
    for thread_id, now in after.items():
        then = before.get(thread_id, ThreadCost(now.name, 0.0, 0))
        cpu_s[now.name] += now.cpu_s - then.cpu_s
        runs[now.name] += now.wakeups - then.wakeups
        count[now.name] += 1
    groups = [GroupCost(name, count[name], cpu_s[name] / elapsed_s, runs[name] / elapsed_s) for name in count]
    return sorted(groups, key=lambda group: -group.cpu_share)


def memory(pids: Iterable[int]) -> Memory:
    """Of these processes together."""
    resident_kb = proportional_kb = 0
    for pid in pids:
        with suppress(OSError):
            for line in (_PROC / str(pid) / "smaps_rollup").read_text(encoding="ascii", errors="replace").splitlines():
                key, _, value = line.partition(":")
                if key == "Rss":
                    resident_kb += int(value.split()[0])
                elif key == "Pss":
                    proportional_kb += int(value.split()[0])
    return Memory(resident_kb / 1024, proportional_kb / 1024)
