"""What a person may want to see again of a recorded run: its messages -> moments, for page and terminal. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from common.messages.health import LogLine
from common.messages.mission import PlannerView
from common.messages.points_of_interest import PointOfInterest
from offboard.runs.run_database import Message

_LEVELS = ("WARNING", "ERROR", "CRITICAL")


@dataclass(frozen=True, slots=True)
class Moment:
    """`kind` is mission, door or log; `at_s` counts from the run's first message."""

    at_s: float
    kind: str
    text: str


def moments_of(shown: Iterable[Message[Any]], lines: Iterable[Message[LogLine]], began_s: float) -> list[Moment]:
    """In order: another thing that the mission does, a door, a warning or error.

    `shown` and `lines` as they arrived; `began_s`: what moments count from, on the recorder's clock.
    """
    moments, doing, doors = [], "", set()
    for message in shown:
        payload, at_s = message.payload, message.arrived_s - began_s
        if isinstance(payload, PlannerView) and payload.detail != doing:
            doing = payload.detail
            moments.append(Moment(at_s, "mission", doing))
        elif isinstance(payload, PointOfInterest) and payload.poi_id not in doors:
            doors.add(payload.poi_id)
            moments.append(Moment(at_s, "door", f"{payload.name} {payload.number}".strip()))
    for line in lines:
        if line.payload.level in _LEVELS:
            text = f"{line.topic.producer}: {line.payload.text}"
            moments.append(Moment(line.arrived_s - began_s, "log", text))
    return sorted(moments, key=lambda moment: moment.at_s)
