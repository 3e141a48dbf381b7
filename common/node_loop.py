"""A node with its bus and its clock: the loop that steps it, and how long its steps took."""

from __future__ import annotations

import json
import logging
import threading
import time
from pathlib import Path

import numpy as np

from common.alarm import Alarm
from common.clock import Clock
from common.messages import LOG
from common.node import Agenda, FileNode, Node
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


class NodeLoop:
    """Steps one node when its agenda says so, until `stop` is set. One thread runs it."""

    def __init__(
        self,
        node: Node,
        bus: ZenohBus,
        clock: Clock,
        bus_log: BusLogHandler,
        zenoh_output: ZenohOutput | None,
        notifier: ServiceNotifier | None = None,
    ) -> None:
        """`zenoh_output` is logged after every step, where it is given; `notifier` learns of every step."""
        self.node, self.bus = node, bus
        self._clock, self._bus_log, self._zenoh_output, self._notifier = clock, bus_log, zenoh_output, notifier
        self._steps = StepTimer()
        self._log = logging.getLogger(node.name)

    def run(self, stop: threading.Event) -> None:
        """What a step raises, this raises, after it was logged and published."""
        alarm = Alarm(self.node.fileno) if isinstance(self.node, FileNode) else Alarm()
        self.bus.wake_on(self.node.wakes_on, alarm.ring)
        agenda = Agenda(self.node, self._clock.begin(stop))
        late = False
        while True:
            now_s = self._clock.wait(agenda, alarm, stop)
            if stop.is_set():
                return
            alarm.reset()
            was_late, late = late, now_s - agenda.due_s > max(_LATE_S, 5 * self.node.period_s)
            if late and not was_late:
                self._log.warning("late behind_s=%.3f period_s=%.3f", now_s - agenda.due_s, self.node.period_s)
            agenda.stepped(now_s, self._step(now_s))
            if self._zenoh_output is not None:
                self._zenoh_output.report(now_s)
            self._publish_log(now_s)
            if self._notifier is not None:
                self._notifier.stepped(self.node.name)

    def close(self, folder: Path | None) -> None:
        """Closes the node, leaves the figures of its steps in `folder`, and leaves the mesh."""
        try:
            self.node.close()
            if folder is not None:
                self._steps.write(folder / f"{self.node.name}{STEPS_SUFFIX}")
        finally:
            self.bus.close()

    def _step(self, now_s: float) -> float | None:
        began_s = time.thread_time()
        try:
            with self.bus.bundling():
                due_s = self.node.step(self.bus, now_s)
        except Exception as error:
            self._log.error("cannot go on: %s", error, exc_info=error)
            self._publish_log(now_s)
            raise
        self._steps.add(time.thread_time() - began_s)
        return due_s

    def _publish_log(self, now_s: float) -> None:
        if self.node.name in LOG:
            self._bus_log.flush_to(self.bus, self.node.name, now_s)
