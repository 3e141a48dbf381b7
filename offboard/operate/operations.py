"""Commands of the operator, repeated until they are acknowledged: by the Planner, a pose by the mapping unit. Pure.

For the Command Center and the verbs `start`, `pause`, `resume`, `home`, `goto`, `pose`: `OPERATION` out every REPEAT_S,
the acknowledgement back as the `command_id` of `PlannerView` or `PoseAnswer`. A resume names the stop after which the
robot may go on; it is taken once the permit confirms it too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import degrees

from common.messages.mission import Operation, OperatorCommand, PlannerView, PoseAnswer
from common.messages.stop import Permit

REPEAT_S = 0.1
ANSWER_TIMEOUT_S = 3.0
_COMMAND_ID_BITS = 31


class Answer(Enum):
    WAITING = "not answered yet"
    TAKEN = "it was taken"
    REFUSED = "it was refused"
    NONE = "nobody answered"


@dataclass(frozen=True, slots=True)
class Order:
    """What a person wants: a goto with its place in the map, a line or area with its corners, or the number of one; or
    what a person knows: where the robot stands, with standard deviations.
    """

    operation: Operation
    x_m: float = 0.0
    y_m: float = 0.0
    corners_m: tuple[tuple[float, float], ...] = ()
    zone: int = 0
    heading_rad: float = 0.0
    sd_m: float = 0.0
    sd_heading_rad: float = 0.0

    def __str__(self) -> str:
        if self.operation is Operation.POSE:
            heading_deg, sd_deg = degrees(self.heading_rad), degrees(self.sd_heading_rad)
            place = f"x_m={self.x_m:.2f} y_m={self.y_m:.2f} heading_deg={heading_deg:.0f}"
            return f"operation=pose {place} sd_m={self.sd_m:.2f} sd_deg={sd_deg:.0f}"
        corners = " ".join(f"{x_m:.2f},{y_m:.2f}" for x_m, y_m in self.corners_m)
        return f"operation={self.operation.value} x_m={self.x_m:.2f} y_m={self.y_m:.2f} {corners} zone={self.zone}"


@dataclass(frozen=True, slots=True)
class PendingOperation:
    """A command under way and when it was given."""

    command: OperatorCommand
    since_s: float

    def answer(self, view: PlannerView | PoseAnswer | None, permit: Permit | None, now_s: float) -> Answer:
        """With the newest view (of a pose: answer) and permit, None where none came."""
        acknowledged = view is not None and view.command_id == self.command.command_id
        if acknowledged and view is not None and view.refused:
            return Answer.REFUSED
        if acknowledged and (self.command.operation is not Operation.RESUME or _resumed(self.command, permit)):
            return Answer.TAKEN
        return Answer.NONE if now_s - self.since_s > ANSWER_TIMEOUT_S else Answer.WAITING


def _resumed(command: OperatorCommand, permit: Permit | None) -> bool:
    return permit is not None and permit.resumed and permit.stop_epoch == command.epoch


def new_operation(
    order: Order, permit: Permit | None, now_s: float, random_bits: Callable[[int], int]
) -> PendingOperation:
    """A command with an id of its own, drawn at random so that several senders do not meet; 0 would be none.

    It carries the stop epoch of the newest permit: a resume counts for the stop that the person saw, and for no later.
    """
    command_id, epoch = random_bits(_COMMAND_ID_BITS) or 1, permit.stop_epoch if permit is not None else 0
    command = OperatorCommand(
        now_s,
        order.operation,
        order.x_m,
        order.y_m,
        command_id=command_id,
        epoch=epoch,
        corners_x_m=tuple(x_m for x_m, _ in order.corners_m),
        corners_y_m=tuple(y_m for _, y_m in order.corners_m),
        zone=order.zone,
        heading_rad=order.heading_rad,
        sd_m=order.sd_m,
        sd_heading_rad=order.sd_heading_rad,
    )
    return PendingOperation(command, now_s)


def result_sentence(
    operation: str, answer: Answer, permit: Permit | None, view: PlannerView | PoseAnswer | None
) -> str:
    """The sentence for a person about a command that is over; `view`: what it was answered with."""
    if operation == Operation.POSE.value:
        note = view.note if view is not None else ""
        return {Answer.TAKEN: f"The robot takes that pose. {note}", Answer.REFUSED: f"Refused. {note}"}.get(
            answer, "Nobody answered the pose: is the mapping unit running?"
        )
    held = permit.reason if permit is not None and (permit.stop_sources or not permit.resumed) else ""
    if answer is Answer.TAKEN:
        note = f" {view.note}" if view is not None and view.note else ""
        return f"The planner took the {operation}{f', but the robot stands: {held}' if held else ''}.{note}"
    if answer is Answer.REFUSED:
        return f"The planner refused the {operation}: {view.note if view is not None else ''}"
    if operation == Operation.RESUME.value and permit is not None:
        if held:
            return f"The robot did not take the resume: {held}."
        return "The planner did not answer the resume; the robot may move as soon as the planner is back."
    return f"Nobody answered the {operation}: is the planner running?"
