"""What a person says of a door, on its way to the recorder: for the page and the verb `door`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from common.bus import Bus
from common.messages.points_of_interest import DoorStatement
from common.messages.topics import DOOR, DOOR_NOTES
from offboard.operate.operations import ANSWER_TIMEOUT_S, REPEAT_S, Answer

_COMMAND_ID_BITS = 31
SENTENCES = {
    Answer.WAITING: "Sent: what you said of the door.",
    Answer.TAKEN: "The recorder keeps what you said of the door.",
    Answer.NONE: "Nobody answered: is the recorder running?",
}


@dataclass(frozen=True, slots=True)
class OfDoor:
    """What a person says of a door: its number, its room's name; both empty take back what was said."""

    poi_id: int
    x_m: float
    y_m: float
    number: str
    room_name: str


class DoorSender:
    """Sends the newest statement at once and then every REPEAT_S, until the recorder has it on its disk."""

    def __init__(self, random_bits: Callable[[int], int]) -> None:
        self._random_bits = random_bits
        self._pending: DoorStatement | None = None
        self._due_s = -inf

    def give(self, now_s: float, poi_id: int, place_m: tuple[float, float], number: str, room_name: str) -> None:
        """In place of one that is not answered yet."""
        command_id = self._random_bits(_COMMAND_ID_BITS) or 1
        self._pending = DoorStatement(now_s, poi_id, *place_m, number, room_name, command_id=command_id)
        self._due_s = -inf

    def step(self, bus: Bus, now_s: float) -> Answer | None:
        """The answer as of now to the statement under way; None where none is, also after its answer was returned."""
        notes, pending = bus.latest(DOOR_NOTES), self._pending
        if pending is None:
            return None
        answer = Answer.WAITING
        if notes is not None and notes.command_id == pending.command_id:
            answer = Answer.TAKEN
        elif now_s - pending.t_s > ANSWER_TIMEOUT_S:
            answer = Answer.NONE
        if answer is not Answer.WAITING:
            self._pending = None
        elif now_s >= self._due_s:
            self._due_s = now_s + REPEAT_S
            bus.publish(DOOR, pending)
        return answer
