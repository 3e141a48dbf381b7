"""What a person orders elsewhere (page, ROS) -> the robot, by the rules of the Command Center; and what became of it.

It joins the mesh as the verbs `estop` and `goto` do: as a client of the Command Center's role, with its keys where the
mesh has keys. A thread of its own does so, because the mesh may start after the program, or again.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from common.bus import Bus
from common.errors import StartError, sentence
from common.messages.topics import PERMIT
from offboard.operate import operations
from offboard.operate.door_sender import SENTENCES, DoorSender, OfDoor
from offboard.operate.operations import Answer, Order
from offboard.operate.order_sender import OrderSender, answer_to
from offboard.operate.software_stop import look, release_hindrance, robot_report
from offboard.operate.stop_desk import StopDesk, StopSender

_STEP_S = 0.05
_RETRY_S = 2.0

_log = logging.getLogger("operator")


class ClosableBus(Bus, Protocol):
    def close(self) -> object: ...


@dataclass(frozen=True, slots=True)
class OperatorView:
    """What to show of it: the stop (a name of `software_stop.Look`), the newest order's answer.

    `hindrance`: why nothing can be ordered here, as one sentence; empty where it can. `epoch`: of that stop;
    `latched`: why it must not be released now, empty where it may.
    """

    stop: str = ""
    answer: str = ""
    hindrance: str = ""
    epoch: int = 0
    latched: str = ""


class Operator(Protocol):
    """Used by one thread, from `open` to `close`."""

    def open(self) -> None: ...
    def close(self) -> None: ...
    def stop(self) -> None: ...
    def release(self, epoch: int) -> None: ...
    def operate(self, order: Order) -> None: ...
    def note_door(self, of_door: OfDoor) -> None: ...


class NoOperator:
    """Where no robot is meant."""

    def open(self) -> None: ...
    def close(self) -> None: ...
    def stop(self) -> None: ...
    def release(self, epoch: int) -> None: ...
    def operate(self, order: Order) -> None: ...
    def note_door(self, of_door: OfDoor) -> None: ...


class BusOperator:
    """`join` opens the bus and raises StartError while it cannot; `on_view` takes every new view."""

    def __init__(self, join: Callable[[], ClosableBus], on_view: Callable[[OperatorView], None]) -> None:
        self._join, self._on_view = join, on_view
        self._desk = StopDesk(time.monotonic)
        self._lock = threading.Lock()
        self._order: Order | None = None
        self._orders, self._ordered = OrderSender(), ""
        self._of_door: OfDoor | None = None
        self._doors = DoorSender(secrets.randbits)
        self._view = OperatorView()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="operator", daemon=True)

    def open(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def stop(self) -> None:
        self._desk.press()

    def release(self, epoch: int) -> None:
        """Of the stop that a person saw, and of none that was pressed since."""
        self._desk.release(epoch)

    def operate(self, order: Order) -> None:
        """A newer order replaces one that was not taken yet."""
        with self._lock:
            self._order = order
        _log.info("%s", order)

    def note_door(self, of_door: OfDoor) -> None:
        with self._lock:
            self._of_door = of_door
        _log.info("door poi_id=%d number=%s room_name=%s", of_door.poi_id, of_door.number, of_door.room_name)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                bus = self._join()
            except StartError as error:
                self._show(replace(self._view, stop="LINK_LOST", hindrance=sentence(error)))
                self._ended.wait(_RETRY_S)
                continue
            sender = StopSender(self._desk, bus)
            sender.start()
            try:
                while not self._ended.wait(_STEP_S):
                    self._step(bus, time.monotonic())
            finally:
                sender.close()
                bus.close()

    def _step(self, bus: Bus, now_s: float) -> None:
        report = robot_report(bus, now_s)
        control = self._desk.receive(report, now_s)
        answer = self._note_door(bus, now_s) or self._operate(bus, now_s)
        stop, epoch = look(control, report, now_s), report.permit.stop_epoch
        self._show(OperatorView(stop.name, answer, "", epoch, release_hindrance(control, report, now_s)))

    def _operate(self, bus: Bus, now_s: float) -> str:
        """Sends the order until it is answered; the sentence about it."""
        with self._lock:
            order, self._order = self._order, None
        if order is not None:
            self._ordered, permit, draw = order.operation.value, bus.latest(PERMIT), secrets.randbits
            self._orders.give(operations.new_operation(order, permit, now_s, draw))
        answer = self._orders.step(bus, now_s)
        if answer is None:
            return self._view.answer
        if answer is Answer.WAITING:
            return f"Sent: {self._ordered}."
        return operations.result_sentence(self._ordered, answer, bus.latest(PERMIT), answer_to(bus, self._ordered))

    def _note_door(self, bus: Bus, now_s: float) -> str:
        """As `_operate`, for what was said of a door; empty where nothing is under way."""
        with self._lock:
            door, self._of_door = self._of_door, None
        if door is not None:
            self._doors.give(now_s, door.poi_id, (door.x_m, door.y_m), door.number, door.room_name)
        answer = self._doors.step(bus, now_s)
        return SENTENCES[answer] if answer is not None else ""

    def _show(self, view: OperatorView) -> None:
        if view != self._view:
            self._view = view
            self._on_view(view)
