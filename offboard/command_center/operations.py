"""What the operator asks of the mission, repeated until the Planner says that it took it. Pure.

For the Command Center and the verbs `start`, `pause`, `resume`, `home`, `goto`: `OPERATION` out every REPEAT_S, the
acknowledgement back as `PlannerView.command_id`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from common.messages import OperatorCommand

REPEAT_S = 0.1
ANSWER_TIMEOUT_S = 3.0
_COMMAND_ID_BITS = 31


class Answer(Enum):
    WAITING = "not answered yet"
    TAKEN = "the Planner took it"
    NONE = "nobody answered"


@dataclass(frozen=True, slots=True)
class PendingOperation:
    """A command under way and when it was given."""

    command: OperatorCommand
    since_s: float

    def answer(self, acknowledged_id: int | None, now_s: float) -> Answer:
        """`acknowledged_id`: of the Planner's newest view, None where none came."""
        if acknowledged_id == self.command.command_id:
            return Answer.TAKEN
        return Answer.NONE if now_s - self.since_s > ANSWER_TIMEOUT_S else Answer.WAITING


def new_command_id(random_bits: Callable[[int], int]) -> int:
    """Drawn at random, so that several senders do not meet; 0 is none."""
    return random_bits(_COMMAND_ID_BITS) or 1


def result_sentence(operation: str, answer: Answer, stop_sources: tuple[str, ...]) -> str:
    """What a person is told about a command that is over."""
    if answer is not Answer.TAKEN:
        return f"Nobody answered the {operation}: is the planner running?"
    if stop_sources:
        return f"The planner took the {operation}, but the robot stands: stopped by {', '.join(stop_sources)}."
    return f"The planner took the {operation}."
