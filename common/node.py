"""What a process does, apart from where it runs: on the mesh (`process`), or with all others in one program.

A node sleeps until something is due: a message of `wakes_on` came, or the time that its last step returned is there.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from common.bus import Bus
from common.messages import Topic

# Two steps of a node are never nearer to each other: what arrives between them is taken together
STEP_GAP_S = 0.01


class Node(Protocol):
    """Reads no clock: the time is an argument of `step`. The kind of bus is hidden behind `Bus`."""

    name: str
    period_s: float  # the longest time between two steps
    wakes_on: tuple[Topic[Any], ...]  # their messages make a step due

    def step(self, bus: Bus, now_s: float) -> float | None:
        """Takes what arrived, computes, publishes. Returns when it must be stepped though nothing arrives (seconds on
        the clock of `now_s`); None: `period_s` from now."""

    def close(self) -> None: ...


@runtime_checkable
class FileNode(Protocol):
    """A node that is also woken by what arrives at a file."""

    def fileno(self) -> int | None:
        """The descriptor to wait on now; None where there is none."""


class Agenda:
    """When a node is stepped. Pure; the time is given."""

    def __init__(self, node: Node, begin_s: float) -> None:
        self.due_s = begin_s  # it is stepped then at the latest
        self.earliest_s = begin_s  # and not before, whatever arrives
        self._period_s = node.period_s

    def stepped(self, now_s: float, due_s: float | None) -> None:
        """It was stepped at `now_s`, and returned `due_s`."""
        self.earliest_s = now_s + STEP_GAP_S
        periodic_s = round(self.due_s + self._period_s, 9)  # no error adds up
        if due_s is None:
            self.due_s = periodic_s if periodic_s > now_s else now_s + self._period_s
        else:
            self.due_s = min(max(due_s, self.earliest_s), now_s + self._period_s)
