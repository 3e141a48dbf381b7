"""What a page may send: what it has received, an order, which moment of a recorded run it wants. Text -> values. Pure.

A stop needs nothing. Everything else needs the token that the server gives to pages on its own machine, with the first
message of a socket whose Origin and Host it has checked: another site's page can neither open that socket nor read it.
"""

from __future__ import annotations

import hmac
import json
from dataclasses import dataclass
from math import isfinite
from typing import Any

from common.fields import COORDINATE, CORNERS_MAX, POI_ID_MAX, WORD_MAX
from common.messages.mission import Operation
from common.plain_text import plain
from common.zones import KIND_OF
from offboard.operate.door_sender import OfDoor
from offboard.operate.operations import Order

STOP, RELEASE, DOOR = "stop", "release", "door"
_OPERATIONS = {operation.value: operation for operation in Operation}


class BadRequest(ValueError):
    """The page sent what no page of ours sends."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """So many bytes have arrived there, when its clock showed `at_s`."""

    received_bytes: int
    at_s: float


@dataclass(frozen=True, slots=True)
class Stop:
    """The software stop."""


@dataclass(frozen=True, slots=True)
class Release:
    """Of the software stop that the page showed."""

    epoch: int


@dataclass(frozen=True, slots=True)
class Replay:
    """A recorded run from this moment on (None: from where it is), so many times as fast; 0 stands."""

    at_s: float | None
    speed: float


def parse(text: str, token: str) -> Confirmation | Order | OfDoor | Release | Stop | Replay:
    """`token`: what an order must carry; with an empty one none but a stop is taken. Raises BadRequest."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadRequest("no JSON") from error
    if not isinstance(message, dict):
        raise BadRequest("no message")
    if "replay" in message:
        return _replay(message["replay"])
    return _order(message, token) if "order" in message else _confirmation(message)


def _replay(wanted: Any) -> Replay:
    if not isinstance(wanted, dict):
        raise BadRequest("no moment")
    at_s = wanted.get("at_s")
    return Replay(None if at_s is None else _number(at_s), _number(wanted.get("speed")))


def _confirmation(message: dict[str, Any]) -> Confirmation:
    received, at_s = message.get("received"), message.get("at")
    if type(received) is not int:
        raise BadRequest("no number of bytes")
    return Confirmation(received, _number(at_s))


def _order(message: dict[str, Any], token: str) -> Order | OfDoor | Release | Stop:
    name, given = message["order"], message.get("token")
    if name == STOP:
        return Stop()
    if not token or not isinstance(given, str) or not hmac.compare_digest(given.encode(), token.encode()):
        raise BadRequest("no right to give orders")
    if name == RELEASE:
        return Release(_count(message.get("epoch"), "stop"))
    if name == DOOR:
        return _of_door(message)
    if not isinstance(name, str) or name not in _OPERATIONS:
        raise BadRequest("no order")
    operation = _OPERATIONS[name]
    if operation is Operation.GOTO:
        return Order(operation, *_place(message.get("x_m"), message.get("y_m")))
    if operation in KIND_OF:
        return Order(operation, corners_m=_corners(message.get("corners_m")))
    if operation is Operation.REMOVE_ZONE:
        return Order(operation, zone=_count(message.get("zone"), "line or area"))
    return Order(operation)


def _place(x_m: Any, y_m: Any) -> tuple[float, float]:
    place = _number(x_m), _number(y_m)
    if not all(COORDINATE.low <= metres <= COORDINATE.high for metres in place):
        raise BadRequest("no place of a floor")
    return place


def _of_door(message: dict[str, Any]) -> OfDoor:
    poi_id, number, room_name = message.get("poi_id"), message.get("number"), message.get("room_name")
    if type(poi_id) is not int or not 0 <= poi_id <= POI_ID_MAX:
        raise BadRequest("no door")
    return OfDoor(poi_id, *_place(message.get("x_m"), message.get("y_m")), _word(number), _word(room_name))


def _word(text: Any) -> str:
    if not isinstance(text, str) or len(text) > WORD_MAX:
        raise BadRequest("no text")
    return plain(text, WORD_MAX)


def _corners(given: Any) -> tuple[tuple[float, float], ...]:
    if not isinstance(given, list) or len(given) > CORNERS_MAX:
        raise BadRequest("no corners")
    if not all(isinstance(corner, list) and len(corner) == 2 for corner in given):
        raise BadRequest("no corner")
    return tuple(_place(*corner) for corner in given)


def _count(value: Any, what: str) -> int:
    if type(value) is not int or not 0 <= value < 2**53:
        raise BadRequest(f"no number of a {what}")
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise BadRequest("no number")
    return float(value)
