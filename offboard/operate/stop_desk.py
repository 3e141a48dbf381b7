"""The software stop between three threads: the screen presses, the node receives reports, `StopSender` sends `STOP`.

The sender has a thread of its own so that nothing that the node or the screen is busy with holds a stop up.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable

from common.bus import Bus
from common.messages.topics import STOP
from offboard.operate.software_stop import (
    Demand,
    RobotReport,
    StopControl,
    pressed,
    release_hindrance,
    release_requested,
    request,
    updated,
)
from offboard.operate.stop_press import REPEAT_S, new_stop_id

_log = logging.getLogger("command_center")


class StopDesk:
    """Holds the demand. `changed` is set when there is a new one to send."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.changed = threading.Event()
        self._clock = clock
        self._lock = threading.Lock()
        self._control = StopControl()
        self._report = RobotReport()

    @property
    def control(self) -> StopControl:
        with self._lock:
            return self._control

    def press(self) -> None:
        with self._lock:
            before = self._control
            self._control = pressed(before, self._clock(), new_stop_id(secrets.randbits))
            new = self._control is not before
        if new:
            self.changed.set()
            _log.warning("software stop pressed")

    def hindrance(self) -> str:
        """Why the stop must not be released now, as one sentence; empty where it may be."""
        with self._lock:
            return release_hindrance(self._control, self._report, self._clock())

    def release(self, epoch: int | None = None) -> None:
        """`epoch`: only of this stop, which a person saw some time ago."""
        with self._lock:
            before = self._control
            if epoch is None or epoch == self._report.permit.stop_epoch:
                self._control = release_requested(before, self._report, self._clock())
            new = self._control is not before
        if new:
            self.changed.set()
            _log.warning("release of the software stop requested")

    def receive(self, report: RobotReport, now_s: float) -> StopControl:
        """Takes the newest report; returns the demand in its light."""
        with self._lock:
            self._report = report
            before = self._control
            self._control = control = updated(before, report, now_s)
        if before.demand is Demand.STOP and control.demand is Demand.NONE and control.latency_s is not None:
            _log.warning("software stop confirmed latency_ms=%d", round(1000 * control.latency_s))
        elif before.demand is Demand.RELEASE and control.demand is Demand.NONE:
            _log.warning("software stop %s", "release NOT confirmed" if control.release_failed else "released")
        return control

    def send(self, bus: Bus) -> bool:
        """Send what is demanded; False where nothing is."""
        wanted = request(self.control, self._clock())
        if wanted is not None:
            bus.publish(STOP, wanted)
        return wanted is not None


class StopSender:
    """The thread: sends at once when a demand is new, then every REPEAT_S until the robot confirms."""

    def __init__(self, desk: StopDesk, bus: Bus) -> None:
        self._desk = desk
        self._bus = bus
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="stop-sender", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._desk.changed.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        while not self._ended.is_set():
            self._desk.changed.clear()
            sending = self._desk.send(self._bus)
            self._desk.changed.wait(REPEAT_S if sending else None)
