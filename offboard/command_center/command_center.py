"""Node `command_center`: status, log and whatever else people want to see of every module in; `OPERATION` out.

`step` runs on the thread of the bus and only collects; the screen pulls `snapshot`, `floor_picture` and `take_log` a
few times a second and never waits for the bus. The software stop goes through the desk (`stop_desk.py`).
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from math import hypot
from typing import Any, TypeVar

import numpy as np

from common.bus import Bus
from common.codec import as_text
from common.door_names import DoorNote, all_notes
from common.messages.health import LogLine
from common.messages.mapping import PoseEstimate, Trajectory
from common.messages.mission import Operation
from common.messages.topics import (
    BOARD,
    CARRIER,
    DOOR_NOTES,
    LOG,
    MAP,
    PERMIT,
    PLAN,
    POI,
    POSE,
    STATUS,
    TOPICS,
    TRAJECTORY,
    ZONES,
    Topic,
)
from common.modules import OPTIONAL
from common.status import StatusReporter
from common.zones import Zone, zones_of
from offboard.command_center.board_watch import BoardRow, board_row
from offboard.command_center.log_book import MESSAGE_LEVEL, LogEntry
from offboard.command_center.module_watch import Freshness, ModuleRow, RateMeter, freshness
from offboard.command_center.places import named
from offboard.command_center.snapshot import Finding, FloorPicture, OperationResult, Snapshot
from offboard.operate import operations
from offboard.operate.health_history import HealthHistory
from offboard.operate.operations import Answer, Order
from offboard.operate.order_sender import OrderSender
from offboard.operate.software_stop import look, robot_report
from offboard.operate.stop_desk import StopDesk
from offboard.runs.map_assembly import MapAssembly

LOG_WAITING_MAX = 5000  # entries kept for a screen that is slow to fetch them
TRAIL_STEP_M = 0.2
TRAIL_MAX = 20_000
# The clock is no message of the robot; log lines are in the log anyway
MESSAGE_TOPICS = tuple(t for t in TOPICS if t.producer != "clock" and t.payload is not LogLine)
_OWN_TOPICS = frozenset({MAP.key, TRAJECTORY.key, POSE.key, POI.key, *(topic.key for topic in STATUS.values())})

P = TypeVar("P")
_log = logging.getLogger("command_center")


class CommandCenter:
    """The node. `clock` is the time that `step` is given too: people press keys between two steps. The clocks of the
    robot's computers are compared with `wall_clock` (s since 1970).

    `findings`: points of interest by their id that were found before this program was started; `earlier_log`: what was
    logged before that.
    """

    name = "command_center"
    period_s = 0.05
    wakes_on: tuple[Topic[Any], ...] = (PERMIT, CARRIER)  # what a stop is confirmed by

    def __init__(
        self,
        clock: Callable[[], float],
        findings: Mapping[int, Finding] | None = None,
        wall_clock: Callable[[], float] = time.time,
        earlier_log: Iterable[LogEntry] = (),
    ) -> None:
        self.stop_desk = StopDesk(clock)
        self._clock, self._wall_clock = clock, wall_clock
        self._lock = threading.Lock()  # all that `step` collects and the screen reads
        self._snapshot = Snapshot(clock())
        self._status = StatusReporter(self.name)
        self._rates = {module: RateMeter() for module in STATUS}
        self._histories = {module: HealthHistory() for module in STATUS}
        self._logs = deque(earlier_log)
        self._dropped = 0
        self._shown_topics: frozenset[str] = frozenset()
        self._subscribed_topics: frozenset[str] = frozenset()
        self._map = MapAssembly()
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_MAX)
        self._findings = dict(findings or {})
        self._zones: tuple[Zone, ...] = ()
        self._notes: tuple[DoorNote, ...] | None = None  # of doors, by people; None: as they were found
        self._orders = OrderSender()
        self._result: OperationResult | None = None

    # The thread of the bus

    def step(self, bus: Bus, now_s: float) -> None:
        report = robot_report(bus, now_s)
        control = self.stop_desk.receive(report, now_s)
        with self._lock:
            self._take_logs(bus, now_s)
            for update in self._take(bus, MAP, now_s):
                self._map.add(update)
            for trajectory in self._take(bus, TRAJECTORY, now_s):
                self._redraw_trail(trajectory)
            for pose in self._take(bus, POSE, now_s):
                self._extend_trail(pose)
            for poi in self._take(bus, POI, now_s):
                self._findings[poi.poi_id] = Finding(poi.number, poi.x_m, poi.y_m, number_read=poi.number)
                self._name_doors()
            for statements in self._take(bus, DOOR_NOTES, now_s):
                self._notes = all_notes(statements)
                self._name_doors()
            for zones in self._take(bus, ZONES, now_s):
                self._zones = zones_of(zones)
            self._operate(bus, now_s)
            self._snapshot = Snapshot(
                now_s,
                rows=self._rows(bus, now_s),
                boards=self._boards(bus),
                control=control,
                report=report,
                permit=bus.latest(PERMIT),
                pose=bus.latest(POSE),
                pose_age_s=bus.age_s(POSE),
                carrier=bus.latest(CARRIER),
                carrier_age_s=bus.age_s(CARRIER),
                view=bus.latest(PLAN),
                view_age_s=bus.age_s(PLAN),
                findings=tuple(self._findings.values()),
                zones=self._zones,
                operation=self._result,
                lines_dropped=self._dropped,
            )
        self._status.report(bus, now_s, state=look(control, report, now_s).name, ready=True)

    def close(self) -> None:
        """Nothing is held open."""

    # The thread of the screen

    def snapshot(self) -> Snapshot:
        """The newest picture, with the demand as it is at this very moment."""
        with self._lock:
            snapshot = self._snapshot
        return replace(snapshot, now_s=self._clock(), control=self.stop_desk.control)

    def take_log(self) -> list[LogEntry]:
        """Every entry since the last call, oldest first."""
        with self._lock:
            entries = list(self._logs)
            self._logs.clear()
        return entries

    def floor_picture(self) -> FloorPicture:
        with self._lock:
            walls_m, inferred = self._map.known()
            trail_m = np.array(self._trail, dtype=np.float64).reshape(-1, 2)
            snapshot = self._snapshot
        path_m = snapshot.view.path_m if snapshot.view is not None else np.zeros((0, 2), np.float32)
        live = freshness(snapshot.pose_age_s) is Freshness.LIVE
        return FloorPicture(walls_m, inferred, trail_m, path_m, snapshot.findings, snapshot.pose, live, snapshot.zones)

    def show_messages(self, topics: frozenset[str]) -> None:
        """From now on every message of these topics comes with the log."""
        with self._lock:
            self._shown_topics = topics
            self._subscribed_topics |= topics

    def operate(self, operation: Operation, x_m: float = 0.0, y_m: float = 0.0) -> None:
        """Sends a command to the Planner."""
        self.give(Order(operation, x_m, y_m))

    def give(self, order: Order) -> None:
        """Sends an order to the Planner; a newer one replaces one that is not taken yet."""
        now_s = self._clock()
        with self._lock:
            serial = self._result.serial + 1 if self._result is not None else 1
            permit, draw = self._snapshot.permit, secrets.randbits
            self._orders.give(operations.new_operation(order, permit, now_s, draw))
            self._result = OperationResult(serial, order.operation.value, Answer.WAITING, "")
        _log.info("%s", order)

    # Parts of `step`

    def _take(self, bus: Bus, topic: Topic[P], now_s: float) -> list[P]:
        messages = bus.take(topic)
        if topic.key in self._shown_topics:
            for payload in messages:
                text = as_text(topic.producer, self.name, payload)
                self._keep(LogEntry(now_s, topic.producer, topic.key, MESSAGE_LEVEL, text, text))
        return messages

    def _name_doors(self) -> None:
        if self._notes is not None:
            self._findings = {poi_id: named(poi_id, f, self._notes) for poi_id, f in self._findings.items()}

    def _take_logs(self, bus: Bus, now_s: float) -> None:
        for module, topic in LOG.items():
            for line in bus.take(topic):
                text = as_text(module, self.name, line)
                self._keep(LogEntry(now_s, module, topic.key, line.level, text, line.text))
        for other in MESSAGE_TOPICS:
            if other.key in self._subscribed_topics and other.key not in _OWN_TOPICS:
                self._take(bus, other, now_s)

    def _keep(self, entry: LogEntry) -> None:
        if len(self._logs) >= LOG_WAITING_MAX:
            self._logs.popleft()
            self._dropped += 1
        self._logs.append(entry)

    def _rows(self, bus: Bus, now_s: float) -> tuple[ModuleRow, ...]:
        """Of every module; an optional one is missed by nobody before it has reported."""
        rows = (self._row(bus, module, now_s) for module in STATUS)
        return tuple(row for row in rows if row.status is not None or row.module not in OPTIONAL)

    def _row(self, bus: Bus, module: str, now_s: float) -> ModuleRow:
        topic, meter, history = STATUS[module], self._rates[module], self._histories[module]
        statuses = self._take(bus, topic, now_s)
        meter.add(len(statuses), now_s)
        for status in statuses:
            history.add(status, now_s)
        return ModuleRow(module, bus.latest(topic), bus.age_s(topic), meter.rate_hz(now_s), history.samples)

    def _boards(self, bus: Bus) -> tuple[BoardRow, ...]:
        wall_s = self._wall_clock()
        states = ((bus.latest(topic), bus.age_s(topic)) for topic in BOARD.values())
        return tuple(board_row(state, age_s, wall_s) for state, age_s in states if state is not None)

    def _redraw_trail(self, trajectory: Trajectory) -> None:
        """The past was corrected, or this program has just joined."""
        self._trail.clear()
        self._trail.extend((x_m, y_m) for x_m, y_m in trajectory.poses[-TRAIL_MAX:, :2].tolist())

    def _extend_trail(self, pose: PoseEstimate) -> None:
        if pose.valid:
            last = self._trail[-1] if self._trail else None
            if last is None or hypot(pose.x_m - last[0], pose.y_m - last[1]) >= TRAIL_STEP_M:
                self._trail.append((pose.x_m, pose.y_m))

    def _operate(self, bus: Bus, now_s: float) -> None:
        answer = self._orders.step(bus, now_s)
        if answer is None or answer is Answer.WAITING or self._result is None:
            return
        sentence = operations.result_sentence(self._result.operation, answer, bus.latest(PERMIT), bus.latest(PLAN))
        self._result = replace(self._result, answer=answer, sentence=sentence)
        _log.info("operation=%s answer=%s", self._result.operation, answer.name)
