"""What a process does, apart from where it runs: on the mesh (`process`), or with all others in one program."""

from __future__ import annotations

from typing import Protocol

from common.bus import Bus


class Node(Protocol):
    """Never asks the time, never sees where its bus ends."""

    name: str
    period_s: float

    def step(self, bus: Bus, now_s: float) -> None: ...

    def close(self) -> None: ...
