"""The board at the end of its serial line, without a mesh: `check-sensors`, `drive` and `calibrate` talk to it by this.

Port -> messages of the board; heartbeats and commands -> port. It stands where the bridge stands otherwise, and keeps
the bridge's rules: silent until HELLO, heartbeats only while motion is allowed. The time is given.
"""

from __future__ import annotations

from math import inf

from common.constants import HEARTBEAT_PERIOD_S
from common.errors import StartError
from common.messages.motion import Speed
from onboard.bridge import protocol
from onboard.bridge.line_protocol import LineDecoder, encode
from onboard.bridge.protocol import (
    STOP_BYTE,
    CarSta,
    CarState,
    Drv,
    Hb,
    Hello,
    Message,
    Odo,
    Rel,
    Rng,
    SimSta,
    Start,
    Stp,
)
from onboard.bridge.serial_port import Port

BOOT = 0  # under which its commands are known
REPEAT_S = 0.1
LOST_S = 0.3  # no line for this long: silent until the next HELLO


class WrongFirmware(StartError):
    """The firmware on the board has another version of the protocol."""


class BoardLink:
    """One board. `step` as often as convenient, at least 50 times a second while it drives."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._decoder = LineDecoder()
        self._began_s: float | None = None
        self._received_s = -inf
        self._heartbeat_s = self._commanded_s = -inf
        self._heartbeat_count = 0
        self._command: Drv | None = None
        self._last_id = 0
        self._moving_allowed = False
        self.connected = False
        self.hello: Hello | None = None
        self.odo: Odo | None = None
        self.rng: Rng | None = None
        self.sim: SimSta | None = None
        self.car: CarSta | None = None
        self.stop_report: Stp | None = None

    def step(self, now_s: float) -> list[Message]:
        """Reads what has come, sends what is due; the new messages. Raises SerialLost and WrongFirmware."""
        if self._began_s is None:
            self._began_s = now_s
        messages = [received.message for received in self._decoder.feed(self._port.read())]
        for message in messages:
            self._received_s = now_s
            self._keep(message)
        if now_s - self._received_s > LOST_S:
            self._forget()
        if self.connected and self._moving_allowed:
            self._keep_moving(now_s)
        return messages

    def allow_motion(self) -> None:
        """Heartbeats from now on; a latched stop is released, and the board armed."""
        self._moving_allowed = True

    def stop(self) -> None:
        """At once, whatever it does; nothing moves until `allow_motion` and another command."""
        self._moving_allowed = False
        self._command = None
        if self.connected:
            self._port.write(STOP_BYTE)

    def drive(self, speed: Speed, yaw_deg: float) -> int:
        """Drives at that speed and heading, absolute as the board counts it; the command's number."""
        # Above every number the board knows: it may have been driven before without a restart
        known = (self.car.command_id, self.car.completed_id, self.car.aborted_id) if self.car is not None else ()
        self._last_id = max(self._last_id, *known) + 1
        self._command = Drv(BOOT, self._last_id, int(speed), round(yaw_deg * 100.0) % 36000)
        self._commanded_s = -inf
        return self._last_id

    @property
    def ready(self) -> bool:
        """Armed, calibrated, nothing latched."""
        return self.car is not None and self.car.state in (CarState.READY, CarState.MOVING)

    @property
    def _board_epoch(self) -> int:
        """Of the newest stop that the board knows: the person beside it decides."""
        return self.stop_report.epoch if self.stop_report is not None else 0

    @property
    def bad_lines(self) -> int:
        return self._decoder.bad_lines

    def completed(self, command_id: int) -> bool:
        return self.car is not None and (self.car.boot, self.car.completed_id) == (BOOT, command_id)

    def aborted(self, command_id: int) -> bool:
        return self.car is not None and (self.car.boot, self.car.aborted_id) == (BOOT, command_id)

    def _keep(self, message: Message) -> None:
        match message:
            case Hello():
                if (message.version, message.hash) != (protocol.VERSION, protocol.HASH):
                    raise WrongFirmware(
                        f"The board uses protocol {message.version}/{message.hash:04X}, this program "
                        f"{protocol.VERSION}/{protocol.HASH:04X}: flash this version's firmware (arduino/README.md)."
                    )
                self.hello, self.connected = message, True
            case Odo():
                self.odo = message
            case Rng():
                self.rng = message
            case SimSta():
                self.sim = message
            case CarSta():
                self.car = message
            case Stp():
                self.stop_report = message

    def _forget(self) -> None:
        self.connected = False
        self.hello = self.odo = self.rng = self.sim = self.car = self.stop_report = None
        self._command = None

    def _keep_moving(self, now_s: float) -> None:
        if now_s - self._heartbeat_s >= HEARTBEAT_PERIOD_S - 1e-6:
            self._heartbeat_s = now_s
            self._heartbeat_count = (self._heartbeat_count + 1) % 65536
            self._send(Hb(self._heartbeat_count, self._board_epoch), now_s)
        if self.car is None or now_s - self._commanded_s < REPEAT_S - 1e-6:
            return
        if self.car.stop_latched:
            self._send_command(Rel(self._board_epoch), now_s)
        elif self.car.state == CarState.DISARMED:
            self._send_command(Start(protocol.HASH, self._board_epoch), now_s)
        elif self._command is not None:
            known = (self.car.command_id, self.car.completed_id, self.car.aborted_id)
            if self.car.boot == BOOT and self._command.command_id in known:
                self._command = None
            elif self.ready:
                self._send_command(self._command, now_s)

    def _send_command(self, message: Message, now_s: float) -> None:
        self._commanded_s = now_s
        self._send(message, now_s)

    def _send(self, message: Message, now_s: float) -> None:
        assert self._began_s is not None
        self._port.write(encode(message, int((now_s - self._began_s) * 1000.0)))
