"""Where `now_s` comes from: the machine's monotonic clock, or one simulated clock that all processes share.

Under `local --speed N` the simulator leads: it publishes `CLOCK` every TICK_S of simulated time and goes on while no
follower is more than WINDOW_S behind. A follower answers `CLOCK_ACK` once per round of its own steps, with the time
before which it has nothing to do. One that owes its answer for SILENT_S of wall time is no longer waited for, until it
speaks again: a dead or frozen process cannot stop the clock. The message passing itself is the bus's.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

TICK_S = 0.02
WINDOW_S = 0.06  # simulated; below the 0.1 s that is allowed, so that a status of 10 Hz never looks old to the watchdog
SILENT_S = 1.0  # wall time
_POLL_S = 0.2  # how soon a wait notices that the process shall end
_LOST_PACE_S = 0.1  # wall time behind the pace that is forgotten instead of made up by a rush

_log = logging.getLogger("clock")

Send = Callable[[float], None]


class Clock(Protocol):
    def now_s(self) -> float: ...

    def begin(self, stop: threading.Event) -> float:
        """The time of the first step; waits until there is one."""

    def wait_until(self, t_s: float, stop: threading.Event) -> float:
        """Waits for `t_s` or for `stop`; returns the time that the step belongs to."""


class FreeClock:
    """The monotonic clock of this machine."""

    def now_s(self) -> float:
        return time.monotonic()

    def begin(self, stop: threading.Event) -> float:
        return time.monotonic()

    def wait_until(self, t_s: float, stop: threading.Event) -> float:
        remaining_s = t_s - time.monotonic()
        if remaining_s > 0:
            stop.wait(remaining_s)
        return time.monotonic()


class FollowerClock:
    """Simulated time as the leader tells it. `tick` is called by the bus's own thread."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._changed = threading.Condition()
        self.send_ack: Send = lambda t_s: None

    def tick(self, t_s: float) -> None:
        with self._changed:
            if t_s > self._now_s:
                self._now_s = t_s
                self._changed.notify_all()

    def now_s(self) -> float:
        return self._now_s

    def begin(self, stop: threading.Event) -> float:
        """Who joins late begins with the present, and is waited for from its first answer on."""
        self._wait_for(TICK_S, stop)
        return self._now_s

    def wait_until(self, t_s: float, stop: threading.Event) -> float:
        if self._now_s < t_s:
            self.send_ack(t_s)
            self._wait_for(t_s, stop)
        return t_s

    def _wait_for(self, t_s: float, stop: threading.Event) -> None:
        with self._changed:
            while self._now_s < t_s and not stop.is_set():
                self._changed.wait(_POLL_S)


class FollowerTable:
    """Who must be waited for; pure, wall time is given. `silent` names those that are not waited for any more."""

    def __init__(self) -> None:
        self.silent: set[str] = set()
        self._idle_until_s: dict[str, float] = {}
        self._owes_since_s: dict[str, float] = {}

    def heard(self, module: str, idle_until_s: float) -> None:
        self._idle_until_s[module] = idle_until_s
        self._owes_since_s.pop(module, None)
        self.silent.discard(module)

    def holds(self, t_s: float, wall_s: float) -> bool:
        """Some follower that still speaks would fall more than WINDOW_S behind if the clock went to `t_s`."""
        held = False
        for module, idle_until_s in self._idle_until_s.items():
            if t_s <= idle_until_s + WINDOW_S:
                continue
            since_s = self._owes_since_s.setdefault(module, wall_s)
            if wall_s - since_s < SILENT_S:
                held = True
            else:
                self.silent.add(module)
        return held


class LeaderClock:
    """Simulated time at up to `speed` times the wall's, held by followers that are late. `ack` comes from the bus."""

    def __init__(self, speed: float, wall_s: Callable[[], float] = time.monotonic) -> None:
        self.speed = speed
        self._wall_s = wall_s
        self._now_s = 0.0
        self._tick_due_s = TICK_S
        self._anchor_s = wall_s()  # wall time at which simulated time 0 would have been, at this pace
        self._table = FollowerTable()
        self._acked = threading.Condition()
        self.send_tick: Send = lambda t_s: None

    def ack(self, module: str, idle_until_s: float) -> None:
        with self._acked:
            self._table.heard(module, idle_until_s)
            self._acked.notify_all()

    def now_s(self) -> float:
        return self._now_s

    def begin(self, stop: threading.Event) -> float:
        return self._now_s

    def wait_until(self, t_s: float, stop: threading.Event) -> float:
        while self._now_s < t_s and not stop.is_set():
            target_s = min(t_s, self._tick_due_s)
            self._keep_pace(target_s, stop)
            self._await_followers(target_s, stop)
            self._now_s = target_s
            if target_s >= self._tick_due_s:
                self.send_tick(target_s)
                self._tick_due_s = round(self._tick_due_s + TICK_S, 9)  # no error adds up: followers compare
        return t_s

    def _await_followers(self, target_s: float, stop: threading.Event) -> None:
        with self._acked:
            before = set(self._table.silent)
            while self._table.holds(target_s, self._wall_s()) and not stop.is_set():
                self._acked.wait(_POLL_S)
            for module in self._table.silent - before:
                _log.warning("not waited for any more module=%s now_s=%.2f", module, self._now_s)

    def _keep_pace(self, target_s: float, stop: threading.Event) -> None:
        ahead_s = self._anchor_s + target_s / self.speed - self._wall_s()
        if ahead_s > 0:
            stop.wait(ahead_s)
        elif ahead_s < -_LOST_PACE_S:
            self._anchor_s -= ahead_s
