"""Nodes with their buses and a clock: the loop that steps them, and how long their steps took."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from common.alarm import Alarm
from common.clock import Clock
from common.messages.topics import LOG
from common.node import Agenda, Node
from common.process_log import BusLogHandler
from common.service_notify import ServiceNotifier
from common.zenoh_bus import ZenohBus
from common.zenoh_log import ZenohOutput

_LATE_S = 0.1  # a node that is later than this, and than five periods, logs it
_STEPS_KEPT = 50_000  # of the newest steps, for the percentile
STEPS_SUFFIX = ".steps.json"


class StepTimer:
    """Processor time of the steps of a node, in `<name>.steps.json` at the end.

    Of the thread that steps, so that a busy machine makes no step longer.
    """

    def __init__(self) -> None:
        self._recent_s = np.zeros(_STEPS_KEPT, np.float32)  # a ring, whole from the beginning: memory does not grow
        self._count, self._sum_s, self._max_s = 0, 0.0, 0.0

    def add(self, duration_s: float) -> None:
        self._recent_s[self._count % _STEPS_KEPT] = duration_s
        self._count += 1
        self._sum_s += duration_s
        self._max_s = max(self._max_s, duration_s)

    def write(self, file: Path) -> None:
        """Nothing when there was no step; raises OSError."""
        if not self._count:
            return
        p99_s, p999_s = np.percentile(self._recent_s[: self._count], (99.0, 99.9)).tolist()
        figures = {"mean_ms": self._sum_s / self._count, "p99_ms": p99_s, "p999_ms": p999_s, "max_ms": self._max_s}
        content = {name: round(1000 * value_s, 4) for name, value_s in figures.items()} | {"count": self._count}
        file.write_text(json.dumps(content) + "\n", encoding="utf-8")


class Member:
    """One node of a loop, with its bus."""

    def __init__(self, node: Node, bus: ZenohBus) -> None:
        self.node, self.bus = node, bus
        self.steps = StepTimer()
        self.log = logging.getLogger(node.name)
        self.late = False


class NodeLoop:
    """Steps its nodes when they are due, in their order, until `stop` is set. One thread runs it.

    What one publishes and the next one wakes on, that one takes in the same pass. It is the `Schedule` of its clock.
    """

    def __init__(
        self,
        members: Sequence[Member],
        clock: Clock,
        bus_log: BusLogHandler,
        zenoh_output: ZenohOutput | None,
        notifier: ServiceNotifier | None = None,
    ) -> None:
        """`zenoh_output` is logged after every step, where it is given; `notifier` learns of every step."""
        self.members = tuple(members)
        self.name = "+".join(member.node.name for member in members)
        self._clock, self._bus_log, self._zenoh_output, self._notifier = clock, bus_log, zenoh_output, notifier
        self._agendas: list[Agenda] = []
        self._alarm = Alarm()

    @property
    def due_s(self) -> float:
        return min(agenda.due_s for agenda in self._agendas)

    def fileno(self) -> int | None:
        return self._agendas[0].fileno() if len(self._agendas) == 1 else None  # the bridge is alone

    def file_has(self, now_s: float) -> None:
        self._agendas[0].file_has(now_s)

    def run(self, stop: threading.Event) -> None:
        """What a step raises, this raises, after it was logged and published."""
        begin_s = self._clock.begin(stop)
        self._agendas = [Agenda(member.node, begin_s) for member in self.members]
        for member, agenda in zip(self.members, self._agendas, strict=True):
            member.bus.wake_on(member.node.wakes_on, partial(self._wake, agenda))
        while True:
            now_s = self._clock.wait(self, self._alarm, stop)
            if stop.is_set():
                return
            self._alarm.reset()
            for member, agenda in zip(self.members, self._agendas, strict=True):
                if now_s >= agenda.due_s:
                    self._step(member, agenda, now_s)
            if self._zenoh_output is not None:
                self._zenoh_output.report(now_s)

    def close(self, folder: Path | None) -> None:
        """Closes the nodes, leaves the figures of their steps in `folder`, and leaves the mesh."""
        for member in self.members:
            try:
                member.node.close()
                if folder is not None:
                    member.steps.write(folder / f"{member.node.name}{STEPS_SUFFIX}")
            finally:
                member.bus.close()

    def _wake(self, agenda: Agenda) -> None:
        agenda.woken = True
        self._alarm.ring()

    def _step(self, member: Member, agenda: Agenda, now_s: float) -> None:
        self._bus_log.work_for(member.node.name)
        self._note_lateness(member, now_s - agenda.due_s)
        agenda.begin_step()
        began_s = time.thread_time()
        try:
            with member.bus.bundling():
                due_s = member.node.step(member.bus, now_s)
        except Exception as error:
            member.log.error("cannot go on: %s", error, exc_info=error)
            self._publish_log(member, now_s)
            raise
        member.steps.add(time.thread_time() - began_s)
        agenda.stepped(now_s, due_s)
        self._publish_log(member, now_s)
        if self._notifier is not None:
            self._notifier.stepped(member.node.name)

    def _note_lateness(self, member: Member, behind_s: float) -> None:
        was_late, member.late = member.late, behind_s > max(_LATE_S, 5 * member.node.period_s)
        if member.late and not was_late:
            member.log.warning("late behind_s=%.3f period_s=%.3f", behind_s, member.node.period_s)

    def _publish_log(self, member: Member, now_s: float) -> None:
        if member.node.name in LOG:
            self._bus_log.flush_to(member.bus, member.node.name, now_s)
