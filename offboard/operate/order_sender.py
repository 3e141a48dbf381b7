"""A command of the operator on its way: for the Command Center, the page and the verbs."""

from __future__ import annotations

from math import inf

from common.bus import Bus
from common.messages.mission import Operation, PlannerView, PoseAnswer
from common.messages.topics import OPERATION, PERMIT, PLAN, POSE_ANSWER
from offboard.operate.operations import REPEAT_S, Answer, PendingOperation


def answer_to(bus: Bus, operation: str) -> PlannerView | PoseAnswer | None:
    """The newest message that answers such a command."""
    return bus.latest(POSE_ANSWER) if operation == Operation.POSE.value else bus.latest(PLAN)


class OrderSender:
    """Sends the newest command at once and then every REPEAT_S, until it is answered."""

    def __init__(self) -> None:
        self._pending: PendingOperation | None = None
        self._due_s = -inf

    def give(self, pending: PendingOperation) -> None:
        """In place of one that is not answered yet."""
        self._pending, self._due_s = pending, -inf

    def step(self, bus: Bus, now_s: float) -> Answer | None:
        """The answer as of now to the command under way; None where none is, also after its answer was returned."""
        # Joined from the beginning: the answer to the first command must not get lost on the way
        view, stated, permit = bus.latest(PLAN), bus.latest(POSE_ANSWER), bus.latest(PERMIT)
        pending = self._pending
        if pending is None:
            return None
        answer = pending.answer(stated if pending.command.operation is Operation.POSE else view, permit, now_s)
        if answer is not Answer.WAITING:
            self._pending = None
        elif now_s >= self._due_s:
            self._due_s = now_s + REPEAT_S
            bus.publish(OPERATION, pending.command)
        return answer
