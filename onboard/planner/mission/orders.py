"""Operator commands -> events of the mission's table, and what is answered; which thing a resume ends is known here.

Pure: command and permit in, event out. A command that cannot be judged yet gets no answer; it comes again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from common.messages.mission import Operation, OperatorCommand
from common.messages.stop import Permit
from onboard.planner.mission.table import Event, Step

ANSWERED_KEPT = 16  # commands whose repeats are known as such
_EVENTS = {
    Operation.START: Event.START,
    Operation.PAUSE: Event.PAUSE,
    Operation.HOME: Event.GO_HOME,
    Operation.GOTO: Event.GO_TO,
}


@dataclass(frozen=True, slots=True)
class Answer:
    """To the newest command: its id (0: none was answered), whether it was refused, and what its sender should read."""

    command_id: int = 0
    refused: bool = False
    note: str = ""


class Orders:
    """The commands so far. `answer` goes out with the Planner's view."""

    def __init__(self) -> None:
        self.answer = Answer()
        self._answered: deque[int] = deque(maxlen=ANSWERED_KEPT)
        self._resumed_epoch = 0  # the newest stop of which the resume is known

    def is_repeat(self, command: OperatorCommand) -> bool:
        """Was it answered before?"""
        return bool(command.command_id) and command.command_id in self._answered

    def event_of(self, command: OperatorCommand, permit: Permit | None) -> Event | None:
        """What it means now; None for a resume that does not name the newest stop, or comes before its release."""
        if command.operation is not Operation.RESUME:
            return _EVENTS[command.operation]
        if permit is None or permit.stop_sources or command.epoch != permit.stop_epoch:
            return None
        return Event.RESUME_STOP if command.epoch > self._resumed_epoch else Event.RESUME

    def answered(self, command: OperatorCommand, permit: Permit | None, step: Step) -> None:
        """The mission has taken it, or refused it."""
        if command.operation is Operation.RESUME:
            self._resumed_epoch = command.epoch
        elif permit is not None and permit.resumed:
            self._resumed_epoch = permit.stop_epoch  # what is ordered after a resume is not before that stop
        if command.command_id:
            self._answered.append(command.command_id)
            self.answer = Answer(command.command_id, step.refused, step.note)
