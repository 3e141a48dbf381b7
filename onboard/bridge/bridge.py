"""The bridge: serial line -> `ODOMETRY`, `RANGES`, `DISTANCES`, `CARRIER`, `STATUS[sim]`, `STATUS[car]`;
`DRIVE`, `PERMIT`, `STOP` -> serial line.

Heartbeats go to the board only while the robot may move; their absence stops it. Towards a board that has not said
HELLO the bridge is silent: a bootloader that hears anything would never start the sketch.
"""

from __future__ import annotations

import argparse
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from enum import Enum

from common.bus import Bus
from common.config import Config
from common.constants import HEARTBEAT_PERIOD_S
from common.errors import ErrorCode
from common.messages import CARRIER, DISTANCES, DRIVE, ODOMETRY, PERMIT, RANGES, STATUS, STOP, DriveCommand, Speed
from common.status import StatusPace, StatusReporter
from onboard.bridge import protocol, translation
from onboard.bridge.board_clock import BoardClock
from onboard.bridge.line_protocol import LineDecoder, Received, encode
from onboard.bridge.motion_gate import MotionGate
from onboard.bridge.protocol import (
    STOP_BYTE,
    CarSta,
    CarState,
    Dst,
    Hb,
    Hello,
    Message,
    Odo,
    Rel,
    Rng,
    SimSta,
    SimState,
    Start,
    Stop,
    Stp,
)
from onboard.bridge.serial_port import Port, SerialLost, SerialPort

LINE_LOST_S = 0.3  # no valid line for this long: the board is lost
REOPEN_S = 1.0
RESET_AFTER_S = 10.0  # a port that stays mute for this long is opened anew
REPEAT_S = 0.1  # until the board confirms
NOISE_WINDOW_S = 10.0
NOISE_LINES = 10  # damaged lines within the window that are worth a warning

_WORKING = (CarState.READY, CarState.MOVING, CarState.BACKING_OFF)
_log = logging.getLogger("bridge")


class LinkState(Enum):
    CLOSED = "CLOSED"  # no port
    LISTENING = "LISTENING"  # open, no HELLO yet
    MISMATCH = "MISMATCH"  # HELLO of another protocol
    CONNECTED = "CONNECTED"


class _Pace:
    """Something that is sent again and again, at most every so often."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._sent_s = float("-inf")

    def due(self, now_s: float) -> bool:
        if now_s - self._sent_s < self._period_s - 1e-6:
            return False
        self._sent_s = now_s
        return True

    def reset(self) -> None:
        self._sent_s = float("-inf")


class Bridge:
    """The node. `port_factory` opens the port, or raises SerialLost with a sentence for people."""

    name = "bridge"
    period_s = 0.01

    def __init__(self, port_factory: Callable[[], Port]) -> None:
        self._open_port = port_factory
        self._port: Port | None = None
        self._link = LinkState.CLOSED
        self._why_closed = ""
        self._opening = _Pace(REOPEN_S)
        self._decoder = LineDecoder()
        self._heard_s = float("-inf")
        self._clock = BoardClock()
        self._session = -1
        self._started_s: float | None = None

        self._gate = MotionGate()
        self._may_move = False
        self._sim: SimSta | None = None
        self._car: CarSta | None = None
        self._stop: Stp | None = None
        self._heartbeat_counts = {"sim": 0, "car": 0}
        self._told: dict[str, tuple[str, int]] = {}
        # A little less than the period: the board's own beat decides, not the jitter of the line
        self._car_pace, self._car_error = StatusPace(), 0
        self._drive: DriveCommand | None = None
        self._dropped: tuple[int, int] | None = None  # boot and id of the command that must not be begun any more
        self._heartbeat = _Pace(HEARTBEAT_PERIOD_S)
        self._heartbeats = 0
        self._stopping, self._arming, self._driving = _Pace(REPEAT_S), _Pace(REPEAT_S), _Pace(REPEAT_S)
        self._teaching = _Pace(REPEAT_S)
        self._noise: deque[tuple[float, int]] = deque([(float("-inf"), 0)])
        self._status = StatusReporter(self.name)

    def step(self, bus: Bus, now_s: float) -> None:
        if self._started_s is None:
            self._started_s = now_s
        try:
            self._step_stop(bus, now_s)
            self._listen(bus, now_s)
            if self._link is LinkState.CONNECTED:
                self._command(now_s)
        except SerialLost as error:
            self._close_port(str(error))
        self._report(bus, now_s)

    def close(self) -> None:
        if self._port is not None and self._link is LinkState.CONNECTED:
            try:
                self._port.write(STOP_BYTE)
            except SerialLost as error:
                _log.warning("stop byte not sent reason=%s", error)
        self._close_port("the bridge ends")

    # --- stop and permit: first of all, in every step

    def _step_stop(self, bus: Bus, now_s: float) -> None:
        for request in bus.take(STOP):
            self._gate.request(request)
        permitted = self._gate.may_move(bus.latest(PERMIT), bus.age_s(PERMIT))
        may_move = permitted and self._link is LinkState.CONNECTED
        if may_move != self._may_move:
            _log.info("may_move=%s stop_sources=%s", may_move, sorted(self._gate.stop_sources))
            self._may_move = may_move
            self._stopping.reset()
            self._arming.reset()
            if not may_move and self._link is LinkState.CONNECTED:
                self._send_stop(now_s)
        for command in bus.take(DRIVE):
            self._take_drive(command)
        if not may_move:
            self._forget_drive()

    def _take_drive(self, command: DriveCommand) -> None:
        """What repeats the command in force keeps its pace; a command to stand is held back by nothing else."""
        if self._drive is not None and replace(command, t_s=self._drive.t_s) == self._drive:
            return
        sound = command.valid and (command.boot, command.command_id) != self._dropped
        if command.speed is Speed.STOP or sound:
            self._drive = command
            self._driving.reset()

    def _forget_drive(self) -> None:
        """Neither a release nor a board that is back starts motion by itself: that takes another command."""
        if self._drive is not None:
            self._dropped = self._drive.boot, self._drive.command_id
        self._drive = None

    def _send_stop(self, now_s: float) -> None:
        if self._stopping.due(now_s):
            self._write(STOP_BYTE)

    # --- from the board

    def _listen(self, bus: Bus, now_s: float) -> None:
        if self._port is None and not self._reopen(now_s):
            return
        assert self._port is not None
        for received in self._decoder.feed(self._port.read()):
            self._take_line(bus, received, now_s)
        silent_s = now_s - self._heard_s
        if self._link is LinkState.CONNECTED and silent_s > LINE_LOST_S:
            self._lose_board(f"no line for {LINE_LOST_S:.1f} s")
        elif silent_s > RESET_AFTER_S:
            self._close_port(f"no line for {RESET_AFTER_S:.0f} s")

    def _reopen(self, now_s: float) -> bool:
        if not self._opening.due(now_s):
            return False
        self._port = self._open_port()
        self._decoder = LineDecoder()
        self._noise = deque([(now_s, 0)])
        self._link = LinkState.LISTENING
        self._heard_s = now_s
        self._why_closed = ""
        _log.info("link=%s", self._link.value)
        return True

    def _close_port(self, why: str) -> None:
        close = getattr(self._port, "close", None)
        if close is not None:
            close()
        if why != self._why_closed:
            _log.warning("link=CLOSED reason=%s", why)
        self._port, self._link, self._why_closed = None, LinkState.CLOSED, why
        self._forget_board()

    def _lose_board(self, why: str) -> None:
        self._link = LinkState.LISTENING
        _log.warning("link=%s reason=%s", self._link.value, why)
        self._forget_board()

    def _forget_board(self) -> None:
        self._sim = self._car = self._stop = None
        self._session = -1
        self._forget_drive()

    def _take_line(self, bus: Bus, received: Received, now_s: float) -> None:
        self._heard_s = now_s
        message = received.message
        if isinstance(message, Hello):
            self._greet(message)
        if self._link is not LinkState.CONNECTED:
            return
        if self._clock.jumped_back(received.time_ms):
            # Its HELLO was lost; counts and yaw began anew
            self._lose_board("the board has restarted")
            return
        self._publish(bus, message, self._clock.to_s(received.time_ms, now_s), now_s)

    def _greet(self, hello: Hello) -> None:
        if (hello.version, hello.hash) != (protocol.VERSION, protocol.HASH):
            if self._link is not LinkState.MISMATCH:
                _log.error("protocol mismatch board=%d/%04X own=%d/%04X", *hello[:2], protocol.VERSION, protocol.HASH)
            self._link = LinkState.MISMATCH
            self._forget_board()
            return
        if self._link is LinkState.CONNECTED and hello.session == self._session:
            return
        self._forget_board()
        self._link = LinkState.CONNECTED
        self._session = hello.session
        self._clock = BoardClock()
        _log.info("link=%s session=%d reset_cause=%d", self._link.value, hello.session, hello.reset_cause)

    def _publish(self, bus: Bus, message: Message, t_s: float, now_s: float) -> None:
        match message:
            case Odo():
                imu_works = self._sim is not None and self._sim.state == SimState.RUNNING
                bus.publish(ODOMETRY, translation.odometry(message, t_s, self._session, imu_works))
            case Rng():
                bus.publish(RANGES, translation.ranges(message, t_s))
            case Dst():
                bus.publish(DISTANCES, translation.distances(message, t_s))
            case SimSta():
                self._sim = message
                self._heartbeat_counts["sim"] += 1
                bus.publish(STATUS["sim"], translation.sim_status(message, t_s, self._heartbeat_counts["sim"]))
                self._tell("sim", SimState(message.state).name, message.error)
            case CarSta():
                self._car = message
                self._heartbeat_counts["car"] += 1
                self._publish_carrier(bus, t_s)
                # The Carrier reports every new drive command too, which is no news of its state
                self._tell("car", CarState(message.state).name, message.error)
                urgent, self._car_error = message.error != self._car_error, message.error
                if self._car_pace.due(t_s, urgent):
                    free_ram = self._sim.free_ram if self._sim is not None else 0
                    bus.publish(
                        STATUS["car"], translation.car_status(message, t_s, self._heartbeat_counts["car"], free_ram)
                    )

            case Stp():
                news, self._stop = message != self._stop, message
                self._gate.board(self._session, message)
                if news:
                    self._publish_carrier(bus, t_s)

    def _publish_carrier(self, bus: Bus, t_s: float) -> None:
        """Once both halves of it are known."""
        if self._car is not None and self._stop is not None:
            bus.publish(CARRIER, translation.carrier_report(self._car, self._stop, t_s, self._gate))

    def _tell(self, module: str, state: str, error: int) -> None:
        """Log what is new."""
        if self._told.get(module) != (state, error):
            self._told[module] = (state, error)
            _log.info("%s state=%s error=%s", module, state, translation.error_code(error).name)

    # --- to the board

    def _command(self, now_s: float) -> None:
        car, epoch = self._car, self._gate.epoch
        if not self._may_move:
            if car is not None and self._stop is not None:
                self._hold(car, self._stop, now_s)
            return
        if self._heartbeat.due(now_s):
            self._heartbeats += 1
            self._send(Hb(self._heartbeats % 65536, epoch), now_s)
        if car is None:
            return
        if car.stop_latched and self._arming.due(now_s):
            self._send(Rel(epoch), now_s)
        elif car.state == CarState.DISARMED and self._arming.due(now_s):
            self._send(Start(protocol.HASH, epoch), now_s)
        elif (command := self._undelivered(car)) is not None and self._driving.due(now_s):
            self._send(translation.drive_line(command), now_s)

    def _undelivered(self, car: CarSta) -> DriveCommand | None:
        """What a working board neither has nor has given up; a command to stand is given up by nobody."""
        command = self._drive
        if command is None or car.state not in _WORKING:
            return None
        given_up = car.aborted_id == command.command_id and command.speed is not Speed.STOP
        known = car.boot == command.boot and (car.command_id == command.command_id or given_up)
        return None if known else command

    def _hold(self, car: CarSta, stop: Stp, now_s: float) -> None:
        """The board stands, and knows the newest stop too."""
        stopped = bool(self._gate.stop_sources)
        if (stopped or car.state in _WORKING) and not car.stop_latched:
            self._send_stop(now_s)
        if stopped and stop.epoch < self._gate.epoch and self._teaching.due(now_s):
            self._send(Stop(self._gate.epoch), now_s)

    def _send(self, message: Message, now_s: float) -> None:
        assert self._started_s is not None
        self._write(encode(message, int((now_s - self._started_s) * 1000.0)))

    def _write(self, data: bytes) -> None:
        assert self._port is not None
        self._port.write(data)

    # --- its own status

    def _report(self, bus: Bus, now_s: float) -> None:
        error, detail = self._trouble(now_s)
        board_ready = (
            self._sim is not None
            and self._sim.state == SimState.RUNNING
            and self._car is not None
            and self._car.state not in (CarState.BOOT, CarState.FAULT)
        )
        ready = self._link is LinkState.CONNECTED and board_ready
        state = self._link.value
        if self._link is LinkState.CONNECTED:
            state = "MOVE" if self._may_move else "STOPPED" if self._gate.stop_sources else "HOLD"
        self._status.report(bus, now_s, state=state, error=error, ready=ready, detail=detail)

    def _trouble(self, now_s: float) -> tuple[ErrorCode, str]:
        if self._noise[-1][1] != self._decoder.bad_lines:
            self._noise.append((now_s, self._decoder.bad_lines))
        while len(self._noise) > 1 and self._noise[1][0] < now_s - NOISE_WINDOW_S:
            self._noise.popleft()
        if self._link is LinkState.MISMATCH:
            return ErrorCode.PROTOCOL_MISMATCH, ""
        if self._link is not LinkState.CONNECTED:
            return ErrorCode.SERIAL_LOST, self._why_closed
        if self._gate.stop_sources:
            return ErrorCode.STOP_LATCHED, ",".join(sorted(self._gate.stop_sources))
        if not self._may_move:
            return ErrorCode.NO_PERMIT, ""
        if self._noise[-1][1] - self._noise[0][1] >= NOISE_LINES:
            return ErrorCode.LINE_NOISE, f"bad_lines={self._decoder.bad_lines}"
        return ErrorCode.OK, ""


def make_bridge(config: Config, _: argparse.Namespace) -> Bridge:
    """The node of the process."""
    return Bridge(lambda: SerialPort(config.bridge.serial_port, config.bridge.baud))
