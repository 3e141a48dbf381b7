"""Where `now_s` comes from: the machine's monotonic clock, or one simulated clock that all processes share.

Under `local --speed N` the simulator leads: it publishes `CLOCK` every TICK_S of simulated time and goes on while no
follower is more than WINDOW_S behind. A follower answers `CLOCK_ACK` once per round of its own steps, with the time
before which it has nothing to do; during a long step it repeats now and then that it is still busy. A follower
that sends nothing for SILENT_S of wall time is no longer waited for, until it sends again: a dead or frozen process
cannot stop the clock. The message passing itself is the bus's.

Messages must not be later than the clock either, or on a busy machine sound modules appear silent. So every CLOCK_ACK
announces what its sender has published, every tick passes that on, and a follower begins no step before it has received
those messages.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

from common.alarm import Alarm
from common.constants import FREE_LEASE_S
from common.node import STEP_GAP_S

TICK_S = 0.02
WINDOW_S = 0.04  # simulated: 0.1 s between two statuses and twice this stay below the 0.2 s of the watchdog
SILENT_S = 1.0  # wall time
BUSY_MAX_S = 20.0  # wall time; a step that takes longer is taken for one that never ends
# The shared clock waits for who is late, so the lease must; who freezes is given up by SILENT_S and falls silent
SHARED_LEASE_S = 10.0
_POLL_S = 0.1  # how soon a wait notices that the process shall end, and repeats a message that may have been lost
_CATCH_UP_S = 0.1  # a follower that is later than this skips steps instead of making them up
_LOST_PACE_S = 0.1  # wall time behind the pace that is forgotten instead of made up by a rush

_log = logging.getLogger("clock")

Send = Callable[[float], None]


class Schedule(Protocol):
    """When the nodes of a loop are stepped (`node.Agenda`)."""

    @property
    def due_s(self) -> float:
        """The next step, as far as is known now: what rings the alarm may bring it nearer."""

    def fileno(self) -> int | None:
        """A file to watch."""

    def file_has(self, now_s: float) -> None:
        """Something has arrived there."""


class Clock(Protocol):
    lease_s: float  # wall time for which a process may be unreachable before the others give it up

    def now_s(self) -> float:
        """The newest time that is known; when a message arrived."""

    def step_s(self) -> float:
        """The time that the running step belongs to; up to it ages count."""

    def arrival_s(self, received_s: float) -> float:
        """When a message received at `received_s`, and seen by the running step first, counts as arrived."""

    def begin(self, stop: threading.Event) -> float:
        """The time of the first step; waits until there is one."""

    def wait(self, schedule: Schedule, alarm: Alarm, stop: threading.Event) -> float:
        """Sleeps until the next step is due, or `stop` is set; returns the time that the step belongs to."""


class FreeClock:
    """The monotonic clock of this machine."""

    lease_s = FREE_LEASE_S

    def now_s(self) -> float:
        return time.monotonic()

    def step_s(self) -> float:
        return time.monotonic()

    def arrival_s(self, received_s: float) -> float:
        return received_s

    def begin(self, stop: threading.Event) -> float:
        return time.monotonic()

    def wait(self, schedule: Schedule, alarm: Alarm, stop: threading.Event) -> float:
        while (now_s := time.monotonic()) < (due_s := schedule.due_s) and not stop.is_set():
            if not alarm.rung:
                if alarm.wait(due_s - now_s, schedule.fileno()):
                    schedule.file_has(time.monotonic())
            elif due_s - now_s <= STEP_GAP_S:
                time.sleep(due_s - now_s)  # what comes meanwhile is taken by the step that is due then
            else:
                alarm.reset()  # it rang for a message that was taken by a step before
        return now_s


Marks = tuple[tuple[str, ...], tuple[int, ...], tuple[int, ...]]  # topics, boot ids, sequence numbers


class Announcements:
    """The newest message of each topic by boot id and sequence number; used by the node's and by the bus's threads."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[int, int]] = {}
        self._lock = threading.Lock()

    def note(self, key: str, boot_id: int, sequence: int) -> None:
        with self._lock:
            self._newest[key] = (boot_id, sequence)

    def merge(self, marks: Marks) -> None:
        with self._lock:
            for key, boot_id, sequence in zip(*marks, strict=True):
                self._newest[key] = (boot_id, sequence)

    def take(self) -> Marks:
        """All of them, and none are left."""
        with self._lock:
            newest, self._newest = self._newest, {}
        return tuple(newest), tuple(b for b, _ in newest.values()), tuple(s for _, s in newest.values())


class FollowerClock:
    """Simulated time as the leader publishes it. `tick` is called by the bus's own thread."""

    lease_s = SHARED_LEASE_S

    def __init__(self) -> None:
        self._now_s = 0.0
        self._step_s = 0.0
        self._changed = threading.Condition()
        self._idle_until_s: float | None = None  # as of the last CLOCK_ACK
        self._working_since_wall_s: float | None = None
        self.send_ack: Send = lambda t_s: None
        self.await_messages: Callable[[threading.Event], None] = lambda stop: None

    def tick(self, t_s: float) -> None:
        with self._changed:
            if t_s > self._now_s:
                self._now_s = t_s
                self._changed.notify_all()

    def now_s(self) -> float:
        return self._now_s

    def step_s(self) -> float:
        return self._step_s

    def arrival_s(self, received_s: float) -> float:
        """Not before the running step: the clock may have gone on while the message waited for it."""
        return max(received_s, self._step_s)

    def begin(self, stop: threading.Event) -> float:
        """A late follower begins at the present time, and the clock waits for it from its first CLOCK_ACK on."""
        self._wait_for(TICK_S, stop)
        threading.Thread(target=self._report_busy, args=(stop,), daemon=True).start()
        return self._now_s

    def wait(self, schedule: Schedule, alarm: Alarm, stop: threading.Event) -> float:
        """Looks at what has arrived once per STEP_GAP_S of simulated time."""
        while not stop.is_set():
            look_s = max(min(schedule.due_s, round(self._step_s + STEP_GAP_S, 9)), self._now_s - _CATCH_UP_S)
            self.wait_until(look_s, stop)
            if (file := schedule.fileno()) is not None and alarm.wait(0.0, file):
                schedule.file_has(look_s)
            if look_s >= schedule.due_s:
                break
        return self._step_s

    def wait_until(self, t_s: float, stop: threading.Event) -> float:
        """Waits for `t_s` or for `stop`, then for all that was announced before; returns `t_s`."""
        self._working_since_wall_s = None
        if self._now_s < t_s:
            self._idle_until_s = t_s
            self._wait_for(t_s, stop, t_s)
        self._step_s = t_s
        self.await_messages(stop)
        self._working_since_wall_s = time.monotonic()
        return t_s

    def _report_busy(self, stop: threading.Event) -> None:
        """On a thread of its own, so that it also reports during a long step; it ends or freezes with the process."""
        while not stop.wait(SILENT_S / 4):
            since_s, idle_until_s = self._working_since_wall_s, self._idle_until_s
            if since_s is not None and idle_until_s is not None and time.monotonic() - since_s < BUSY_MAX_S:
                self.send_ack(idle_until_s)

    def _wait_for(self, t_s: float, stop: threading.Event, answer_s: float | None = None) -> None:
        while self._now_s < t_s and not stop.is_set():
            if answer_s is not None:
                self.send_ack(answer_s)
            with self._changed:
                self._changed.wait_for(lambda: self._now_s >= t_s, _POLL_S)


class FollowerTable:
    """Who must be waited for; pure, wall time is given. `silent` names those that are not waited for any more."""

    def __init__(self) -> None:
        self.silent: set[str] = set()
        self._idle_until_s: dict[str, float] = {}
        self._owes_since_s: dict[str, float] = {}

    def receive_ack(self, module: str, idle_until_s: float) -> None:
        self._idle_until_s[module] = idle_until_s
        self._owes_since_s.pop(module, None)
        self.silent.discard(module)

    def holds(self, t_s: float, wall_s: float) -> bool:
        """Some follower that is not silent would fall more than WINDOW_S behind if the clock went to `t_s`."""
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

    lease_s = SHARED_LEASE_S

    def __init__(self, speed: float, wall_s: Callable[[], float] = time.monotonic) -> None:
        self.speed = speed
        self._wall_s = wall_s
        self._now_s = 0.0
        self._tick_s, self._tick_due_s = 0.0, TICK_S
        self._anchor_s = wall_s()  # wall time at which simulated time 0 would have been, at this pace
        self._table = FollowerTable()
        self._acked = threading.Condition()
        self.send_tick: Send = lambda t_s: None

    def ack(self, module: str, idle_until_s: float) -> None:
        with self._acked:
            self._table.receive_ack(module, idle_until_s)
            self._acked.notify_all()

    def now_s(self) -> float:
        return self._now_s

    def step_s(self) -> float:
        return self._now_s

    def arrival_s(self, received_s: float) -> float:
        return received_s

    def begin(self, stop: threading.Event) -> float:
        return self._now_s

    def wait(self, schedule: Schedule, alarm: Alarm, stop: threading.Event) -> float:
        return self.wait_until(schedule.due_s, stop)

    def wait_until(self, t_s: float, stop: threading.Event) -> float:
        """Moves the clock to `t_s` as fast as pace and followers allow, or until `stop`; returns `t_s`."""
        while self._now_s < t_s and not stop.is_set():
            target_s = min(t_s, self._tick_due_s)
            self._keep_pace(target_s, stop)
            self._await_followers(target_s, stop)
            self._now_s = target_s
            if target_s >= self._tick_due_s:
                self._tick_s = target_s
                self.send_tick(target_s)
                self._tick_due_s = round(self._tick_due_s + TICK_S, 9)  # no error adds up: followers compare
        return t_s

    def _await_followers(self, target_s: float, stop: threading.Event) -> None:
        with self._acked:
            before = set(self._table.silent)
            while self._table.holds(target_s, self._wall_s()) and not stop.is_set():
                if not self._acked.wait(_POLL_S):
                    self.send_tick(self._tick_s)
            for module in self._table.silent - before:
                _log.warning("not waited for any more module=%s now_s=%.2f", module, self._now_s)

    def _keep_pace(self, target_s: float, stop: threading.Event) -> None:
        ahead_s = self._anchor_s + target_s / self.speed - self._wall_s()
        if ahead_s > 0:
            stop.wait(ahead_s)
        elif ahead_s < -_LOST_PACE_S:
            self._anchor_s -= ahead_s
