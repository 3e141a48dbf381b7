"""The Command Center without its screen, as its process runs it."""

from __future__ import annotations

import threading
import time

from common.clock import FreeClock
from common.config import Config
from common.zenoh_bus import ZenohBus
from common.zenoh_channel import Mode
from offboard.command_center.command_center import CommandCenter
from offboard.command_center.module_watch import Freshness
from offboard.operate.stop_desk import StopSender


class Center:
    def __init__(self, config: Config, mode: Mode = "peer") -> None:
        self.bus = ZenohBus("command_center", config, FreeClock(), mode)
        self.node = CommandCenter(time.monotonic)
        self.sender = StopSender(self.node.stop_desk, self.bus)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.sender.start()
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(self.node.period_s):
            self.node.step(self.bus, time.monotonic())

    def live(self) -> set[str]:
        return {row.module for row in self.node.snapshot().rows if row.freshness is Freshness.LIVE}

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.sender.close()
        self.bus.close()
