"""The bridge: serial line -> `ODOMETRY`, `RANGES`, `DISTANCES`, `CARRIER`, `STATUS[sim]`, `STATUS[car]`;
`DRIVE`, `PERMIT`, `STOP` -> serial line.

Heartbeats go to the board only while the robot may move; their absence stops it. Towards a board that has not sent
HELLO the bridge is silent: a bootloader that receives anything would never start the sketch.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from typing import Any, TypeVar

from common.bus import Bus
from common.config import Config
from common.constants import PERMIT_TIMEOUT_S
from common.errors import ErrorCode
from common.messages.motion import CarrierReport
from common.messages.topics import CARRIER, DISTANCES, DRIVE, ODOMETRY, PERMIT, RANGES, STATUS, STOP, Topic
from common.status import StatusPace, StatusReporter
from onboard.bridge import translation
from onboard.bridge.board_orders import BoardOrders, Wanted
from onboard.bridge.motion_gate import MotionGate
from onboard.bridge.protocol import (
    STOP_BYTE,
    CarSta,
    CarState,
    Dst,
    Message,
    Odo,
    Rng,
    SimSta,
    SimState,
    Stp,
)
from onboard.bridge.serial_link import LinkState, SerialLink
from onboard.bridge.serial_port import Port, SerialLost, SerialPort

NOISE_LINES = 10  # damaged lines within NOISE_WINDOW_S that are worth a warning

_DRIVING_OR_STANDING = (("car", CarState.READY.name), ("car", CarState.MOVING.name))  # alternate at every turn
# From the first byte to the step that takes it. A period's reports stand on the wire within 19 ms, odometry and ranges
# in their last 8; a line that comes alone, soon after them, is of something that has changed
_BURST_S, _LINE_S = 0.022, 0.003
_BETWEEN_BURSTS_S = 0.06  # since the step that took one: the next one has not begun
_JUST_AFTER_S = 0.001  # after its timeout a permit counts no longer, not at it
P = TypeVar("P")

_log = logging.getLogger("bridge")


class Bridge:
    """The node. `port_factory` opens the port, or raises SerialLost with a sentence for people."""

    name = "bridge"
    period_s = 0.1
    wakes_on: tuple[Topic[Any], ...] = (STOP, PERMIT, DRIVE)

    def __init__(self, port_factory: Callable[[], Port]) -> None:
        self._link = SerialLink(port_factory, self._forget_board)
        self._gate = MotionGate()
        self._orders = BoardOrders(self._gate)
        self._may_move = False
        self._sim: SimSta | None = None
        self._car: CarSta | None = None
        self._stop: Stp | None = None
        self._carrier: CarrierReport | None = None  # the newest report
        self._sensed_s = float("-inf")  # the step that took odometry
        self._riding: list[tuple[Topic[Any], Any]] = []  # no news, not published yet
        self._heartbeat_counts = {"sim": 0, "car": 0}
        self._logged: dict[str, tuple[str, int]] = {}
        self._car_pace, self._car_error = StatusPace(), 0
        self._status = StatusReporter(self.name)

    def fileno(self) -> int | None:
        return self._link.fileno()

    def settle_s(self, now_s: float) -> float:
        return _LINE_S if now_s - self._sensed_s < _BETWEEN_BURSTS_S else _BURST_S

    def step(self, bus: Bus, now_s: float) -> float:
        try:
            self._step_stop(bus, now_s)
            received = sensed = False
            for message, t_s in self._link.read(now_s):
                received, sensed = True, sensed or isinstance(message, Odo)
                self._publish(bus, message, t_s)
            if received:
                self._judge(bus, now_s)
            wanted = self._wanted()
            self._command(wanted, now_s)
        except SerialLost as error:
            self._link.close(str(error))
            wanted, sensed = (), True
        if sensed:
            self._sensed_s = now_s
        # What is no news travels in one bundle with the next odometry
        if sensed or now_s >= self._status.latest_s:
            self._publish_riding(bus)
            self._report(bus, now_s)
        return self._due_s(bus, now_s, wanted)

    def close(self) -> None:
        self._link.close_standing("the bridge ends")

    # --- stop and permit: first of all, in every step

    def _step_stop(self, bus: Bus, now_s: float) -> None:
        for request in bus.take(STOP):
            self._gate.request(request)
        self._judge(bus, now_s)
        for command in bus.take(DRIVE):
            self._orders.take_drive(command)
        if not self._may_move:
            self._orders.forget_drive()

    def _judge(self, bus: Bus, now_s: float) -> None:
        """Whether the robot may move; where it no longer may, the board knows at once."""
        permitted = self._gate.may_move(bus.latest(PERMIT), bus.age_s(PERMIT))
        may_move = permitted and self._link.connected
        if may_move != self._may_move:
            _log.info("may_move=%s stop_sources=%s", may_move, sorted(self._gate.stop_sources))
            self._may_move = may_move
            self._orders.begin_anew()
            if not may_move and self._link.connected:
                self._send_stop(now_s)
        if not may_move:
            self._orders.forget_drive()

    def _send_stop(self, now_s: float) -> None:
        if self._orders.stop_due(now_s):
            self._link.write(STOP_BYTE)

    # --- from the board

    def _forget_board(self) -> None:
        self._sim = self._car = self._stop = None
        self._orders.forget_drive()

    def _publish(self, bus: Bus, message: Message, t_s: float) -> None:
        match message:
            case Odo():
                imu_works = self._sim is not None and self._sim.state == SimState.RUNNING
                bus.publish(ODOMETRY, translation.odometry(message, t_s, self._link.session, imu_works))
            case Rng():
                bus.publish(RANGES, translation.ranges(message, t_s))
            case Dst():
                bus.publish(DISTANCES, translation.distances(message, t_s))
            case SimSta():
                last, self._sim = self._sim, message
                self._heartbeat_counts["sim"] += 1
                status = translation.sim_status(message, t_s, self._heartbeat_counts["sim"])
                news = last is None or (last.state, last.error) != (message.state, message.error)
                self._offer(bus, STATUS["sim"], status, news=news)
                self._log_change("sim", SimState(message.state).name, message.error)
            case CarSta():
                self._car = message
                self._heartbeat_counts["car"] += 1
                self._publish_carrier(bus, t_s)
                # The Carrier reports every new drive command too, which is no news of its state
                self._log_change("car", CarState(message.state).name, message.error)
                urgent, self._car_error = message.error != self._car_error, message.error
                if self._car_pace.due(t_s, urgent):
                    free_ram = self._sim.free_ram if self._sim is not None else 0
                    status = translation.car_status(message, t_s, self._heartbeat_counts["car"], free_ram)
                    self._offer(bus, STATUS["car"], status, news=urgent)

            case Stp():
                news, self._stop = message != self._stop, message
                self._gate.board(self._link.session, message)
                if news:
                    self._publish_carrier(bus, t_s)

    def _offer(self, bus: Bus, topic: Topic[P], payload: P, *, news: bool) -> None:
        """Publishes news at once, after what rides; the rest rides."""
        if news:
            self._publish_riding(bus)
            bus.publish(topic, payload)
        else:
            self._riding.append((topic, payload))

    def _publish_riding(self, bus: Bus) -> None:
        for topic, payload in self._riding:
            bus.publish(topic, payload, news=False)
        self._riding.clear()

    def _publish_carrier(self, bus: Bus, t_s: float) -> None:
        """Publishes the Carrier's report once both of its lines (CarSta, Stp) have come."""
        if self._car is not None and self._stop is not None:
            report = translation.carrier_report(self._car, self._stop, t_s, self._gate)
            last, self._carrier = self._carrier, report
            self._offer(bus, CARRIER, report, news=last is None or _essence(last) != _essence(report))

    def _log_change(self, module: str, state: str, error: int) -> None:
        """Logs state and error of SIM or Carrier when they change; a sound Carrier drives and stands by turns."""
        shown = "SOUND" if (module, state) in _DRIVING_OR_STANDING else state
        if self._logged.get(module) != (shown, error):
            self._logged[module] = (shown, error)
            _log.info("%s state=%s error=%s", module, state, translation.error_code(error).name)

    # --- to the board

    def _wanted(self) -> tuple[Wanted, ...]:
        if not self._link.connected:
            return ()
        return tuple(self._orders.wanted(self._car, self._stop, may_move=self._may_move))

    def _command(self, wanted: tuple[Wanted, ...], now_s: float) -> None:
        due = self._orders.due(wanted, now_s)
        if None in due:
            self._link.write(STOP_BYTE)
        self._link.send([message for message in due if message is not None], now_s)

    def _due_s(self, bus: Bus, now_s: float, wanted: tuple[Wanted, ...]) -> float:
        """When something is to be done though nothing arrives."""
        due_s = min(self._status.latest_s, self._link.due_s)
        if not self._link.connected:
            return due_s
        if self._may_move:
            due_s = min(due_s, now_s + PERMIT_TIMEOUT_S - bus.age_s(PERMIT) + _JUST_AFTER_S)
        return min([due_s, *[pace.latest_s for pace, _ in wanted]])

    # --- its own status

    def _report(self, bus: Bus, now_s: float) -> None:
        error, detail = self._trouble(now_s)
        board_ready = (
            self._sim is not None
            and self._sim.state == SimState.RUNNING
            and self._car is not None
            and self._car.state not in (CarState.BOOT, CarState.FAULT)
        )
        ready = self._link.connected and board_ready
        state = self._link.state.value
        if self._link.connected:
            state = "MOVE" if self._may_move else "STOPPED" if self._gate.stop_sources else "HOLD"
        self._status.report(bus, now_s, state=state, error=error, ready=ready, detail=detail)

    def _trouble(self, now_s: float) -> tuple[ErrorCode, str]:
        bad_lines = self._link.bad_lines_lately(now_s)
        if self._link.state is LinkState.MISMATCH:
            return ErrorCode.PROTOCOL_MISMATCH, ""
        if not self._link.connected:
            return ErrorCode.SERIAL_LOST, self._link.why_closed
        if self._gate.stop_sources:
            return ErrorCode.STOP_LATCHED, ",".join(sorted(self._gate.stop_sources))
        if not self._may_move:
            return ErrorCode.NO_PERMIT, ""
        if bad_lines >= NOISE_LINES:
            return ErrorCode.LINE_NOISE, f"bad_lines={self._link.bad_lines}"
        return ErrorCode.OK, ""


def _essence(report: CarrierReport) -> tuple[object, ...]:
    """What others act on at once when it changes."""
    stops = report.stop_latched, report.button_pressed, report.stop_ids
    return report.state, *stops, report.board_epoch, report.bridge_epoch, report.comm_life


def make_bridge(config: Config, _: argparse.Namespace) -> Bridge:
    """The node of the process."""
    return Bridge(lambda: SerialPort(config.bridge.serial_port, config.bridge.baud))
