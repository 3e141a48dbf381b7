"""What the board is to receive, again and again until its reports show that it has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from operator import attrgetter

from common.constants import HEARTBEAT_PERIOD_S
from common.messages.motion import DriveCommand, Speed
from common.pace import Pace
from onboard.bridge import protocol, translation
from onboard.bridge.motion_gate import MotionGate
from onboard.bridge.protocol import CarSta, CarState, Hb, Message, Rel, Start, Stop, Stp

REPEAT_S = 0.1  # until the board confirms
WORKING = (CarState.READY, CarState.MOVING, CarState.BACKING_OFF)

Wanted = tuple[Pace, Message | None]  # None is the stop byte

_order = attrgetter(*(field.name for field in fields(DriveCommand) if field.name != "t_s"))


class BoardOrders:
    """The drive command in force, and the paces of all that is repeated to the board."""

    def __init__(self, gate: MotionGate) -> None:
        self._gate = gate
        self._drive: DriveCommand | None = None
        self._dropped: tuple[int, int] | None = None  # boot and id of the command that must not be begun any more
        self._heartbeat, self._heartbeats = Pace(HEARTBEAT_PERIOD_S), 0
        self._stopping, self._arming, self._driving = Pace(REPEAT_S), Pace(REPEAT_S), Pace(REPEAT_S)
        self._teaching = Pace(REPEAT_S)

    def take_drive(self, command: DriveCommand) -> None:
        """What repeats the command in force keeps its pace; a command to stand is held back by nothing else."""
        if self._drive is not None and _order(command) == _order(self._drive):
            return
        sound = command.valid and (command.boot, command.command_id) != self._dropped
        if command.speed is Speed.STOP or sound:
            self._drive = command
            self._driving.reset()

    def forget_drive(self) -> None:
        """Neither a release nor a board that is back starts motion by itself: that takes another command."""
        if self._drive is not None:
            self._dropped = self._drive.boot, self._drive.command_id
        self._drive = None

    def begin_anew(self) -> None:
        """The robot may move from now on, or no longer: what that takes is due at once."""
        self._stopping.reset()
        self._arming.reset()

    def stop_due(self, now_s: float) -> bool:
        return self._stopping.due(now_s)

    def due(self, wanted: tuple[Wanted, ...], now_s: float) -> list[Message | None]:
        """Those of `wanted` whose pace is due; from now on each is due again after its period."""
        messages = [(pace, message) for pace, message in wanted if pace.due(now_s)]
        self._heartbeats += sum(pace is self._heartbeat for pace, _ in messages)
        return [message for _, message in messages]

    def wanted(self, car: CarSta | None, stop: Stp | None, *, may_move: bool) -> Iterator[Wanted]:
        """For a board of these newest reports; None for a report that has not come."""
        epoch = self._gate.epoch
        if not may_move:
            if car is not None and stop is not None:
                yield from self._hold(car, stop)
            return
        yield self._heartbeat, Hb((self._heartbeats + 1) % 65536, epoch)
        if car is None or stop is None:
            return  # the stop that it holds may be one that nobody knows yet
        if car.stop_latched:
            yield self._arming, Rel(epoch)
        elif car.state == CarState.DISARMED:
            yield self._arming, Start(protocol.HASH, epoch)
        elif (command := self._undelivered(car)) is not None:
            yield self._driving, translation.drive_line(command)

    def _undelivered(self, car: CarSta) -> DriveCommand | None:
        """What a working board neither has nor has given up; a command to stand is given up by nobody."""
        command = self._drive
        if command is None or car.state not in WORKING:
            return None
        given_up = car.aborted_id == command.command_id and command.speed is not Speed.STOP
        known = car.boot == command.boot and (car.command_id == command.command_id or given_up)
        return None if known else command

    def _hold(self, car: CarSta, stop: Stp) -> Iterator[Wanted]:
        """The board stands, and knows the newest stop too."""
        stopped = bool(self._gate.stop_sources)
        if (stopped or car.state in WORKING) and not car.stop_latched:
            yield self._stopping, None
        if stopped and stop.epoch < self._gate.epoch:
            yield self._teaching, Stop(self._gate.epoch)
