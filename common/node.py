"""What a process does, apart from where it runs: on the mesh (`process`), or with all others in one program.

A node sleeps until something is due: a message of `wakes_on` came, or the time that its last step returned is there.
"""

from __future__ import annotations

from math import inf
from typing import Any, Protocol, runtime_checkable

from common.bus import Bus
from common.messages.topics import Topic

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

    def settle_s(self, now_s: float) -> float:
        """From the first byte, which comes now, to the step (s): what comes within is taken together."""


class Agenda:
    """When a node is stepped. Pure; the time is given, and `woken` is set for it."""

    def __init__(self, node: Node, begin_s: float) -> None:
        self.woken = False  # a message came of those to wake on
        self._node = node
        # Once: what checks a protocol at run time costs more than the rest of a wait
        self._of_file = node if isinstance(node, FileNode) else None
        self._deadline_s = begin_s
        self.earliest_s = begin_s  # it is not stepped before that, whatever arrives
        self._settled_s = inf

    @property
    def due_s(self) -> float:
        """When it is stepped, as far as is known now."""
        woken_s = self.earliest_s if self.woken else inf
        return min(self._deadline_s, woken_s, max(self._settled_s, self.earliest_s))

    def fileno(self) -> int | None:
        """The file to watch; None where there is none, or where it has something already."""
        return self._of_file.fileno() if self._of_file is not None and self._settled_s == inf else None

    def file_has(self, now_s: float) -> None:
        """Something has arrived at the file."""
        assert self._of_file is not None
        self._settled_s = now_s + self._of_file.settle_s(now_s)

    def begin_step(self) -> None:
        """What wakes it from now on is not taken by this step for certain."""
        self.woken, self._settled_s = False, inf

    def stepped(self, now_s: float, due_s: float | None) -> None:
        """It was stepped at `now_s`, and returned `due_s`."""
        self.earliest_s = now_s + STEP_GAP_S
        period_s = self._node.period_s
        periodic_s = round(self._deadline_s + period_s, 9)  # no error adds up
        if due_s is None:
            self._deadline_s = periodic_s if periodic_s > now_s else now_s + period_s
        else:
            self._deadline_s = min(max(due_s, self.earliest_s), now_s + period_s)
