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

from common.fields import COORDINATE
from common.messages.mission import Operation

STOP = "stop"
_OPERATIONS = {operation.value: operation for operation in Operation}


class BadRequest(ValueError):
    """The page sent what no page of ours sends."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """So many bytes have arrived there, when its clock showed `at_s`."""

    received_bytes: int
    at_s: float


@dataclass(frozen=True, slots=True)
class Order:
    """`operation` None is the stop."""

    operation: Operation | None
    x_m: float = 0.0
    y_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Replay:
    """A recorded run from this moment on (None: from where it is), so many times as fast; 0 stands."""

    at_s: float | None
    speed: float


def parse(text: str, token: str) -> Confirmation | Order | Replay:
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


def _order(message: dict[str, Any], token: str) -> Order:
    name, given = message["order"], message.get("token")
    if name == STOP:
        return Order(None)
    if not token or not isinstance(given, str) or not hmac.compare_digest(given.encode(), token.encode()):
        raise BadRequest("no right to give orders")
    if not isinstance(name, str) or name not in _OPERATIONS:
        raise BadRequest("no order")
    if _OPERATIONS[name] is not Operation.GOTO:
        return Order(_OPERATIONS[name])
    x_m, y_m = _number(message.get("x_m")), _number(message.get("y_m"))
    if not all(COORDINATE.low <= metres <= COORDINATE.high for metres in (x_m, y_m)):
        raise BadRequest("no place of a floor")
    return Order(Operation.GOTO, x_m, y_m)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise BadRequest("no number")
    return float(value)
