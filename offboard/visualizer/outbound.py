"""What goes to one page next: `Client` -> messages, never more under way than a slow link carries in a moment. Pure.

Every buffer between server and browser takes what it is given, so on a slow link a pose would wait behind a whole map,
and nobody could say how old it is. So the page confirms how much it has received (`page/link.js`), nothing is sent
while WINDOW_BYTES are not confirmed, and what is sent then is chosen only then: the robot first, then a piece of what
is large, each channel in its turn.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import inf

from offboard.visualizer import protocol
from offboard.visualizer.feed import Client
from offboard.visualizer.protocol import PIECE_BYTES, PageMessage
from offboard.visualizer.requests import BadRequest, Confirmation

WINDOW_BYTES = 12_000  # 0.6 s of a link of 20 kB/s; over 300 ms there and back still 40 kB/s
HEARTBEAT_PERIOD_S = 0.2
# Text and figures for people; ages come with every heartbeat
_PERIOD_S = {"modules": 1.0, "vitals": 1.0, "health": 5.0}
# Half of all pieces are the map's: it is what a page that was just opened waits for
_OTHERS = ("plan", "zones", "vitals", "modules", "moments", "pois", "trail", "grid", "health", "log")
_TURNS = tuple(channel for other in _OTHERS for channel in (other, "map"))


class Outbound:
    """`next` until it is None, then again when there is news, a confirmation, or HEARTBEAT_PERIOD_S is over."""

    def __init__(self, client: Client, greeting: PageMessage) -> None:
        self._client = client
        self._greeting: PageMessage | None = greeting
        self._sent_bytes = self._received_bytes = 0
        self._echo: tuple[float, float] | None = None  # the page's clock at its last message, ours when that arrived
        self._heartbeat_s = -inf
        self._begun_s = dict.fromkeys(_PERIOD_S, -inf)
        self._pieces: dict[str, deque[bytes]] = {}  # of a message that has begun, by channel
        self._turn = 0

    def confirm(self, confirmation: Confirmation) -> None:
        """Raises BadRequest where it cannot be true."""
        received_bytes = confirmation.received_bytes
        if not self._received_bytes <= received_bytes <= self._sent_bytes:
            raise BadRequest("more than was sent, or less than before")
        if self._echo is None:
            self._heartbeat_s = -inf  # the page's first: it waits to learn how old everything is
        self._received_bytes, self._echo = received_bytes, (confirmation.at_s, self._client.now_s())

    def next(self) -> PageMessage | None:
        """None while nothing is new, or too much is under way."""
        if self._sent_bytes - self._received_bytes >= WINDOW_BYTES:
            return None
        message = self._greet() or self._heartbeat() or self._client.urgent() or self._next_piece()
        self._sent_bytes += len(message) if message is not None else 0
        return message

    def _greet(self) -> PageMessage | None:
        greeting, self._greeting = self._greeting, None
        return greeting

    def _heartbeat(self) -> PageMessage | None:
        now_s = self._client.now_s()
        if 0.0 <= now_s - self._heartbeat_s < HEARTBEAT_PERIOD_S:
            return None
        self._heartbeat_s = now_s
        return self._client.heartbeat(self._echo)

    def _next_piece(self) -> PageMessage | None:
        for _ in _TURNS:
            channel = _TURNS[self._turn]
            self._turn = (self._turn + 1) % len(_TURNS)
            pieces = self._pieces.get(channel)
            if pieces:
                return pieces.popleft()
            message = self._begin(channel)
            if message is not None and len(message) <= PIECE_BYTES:
                return message
            if message is not None:
                self._pieces[channel] = deque(_split(channel, message))
                return self._pieces[channel].popleft()
        return None

    def _begin(self, channel: str) -> PageMessage | None:
        period_s = _PERIOD_S.get(channel)
        if period_s is None:
            return self._client.bulk(channel)
        now_s = self._client.now_s()
        if 0.0 <= now_s - self._begun_s[channel] < period_s:
            return None
        message = self._client.bulk(channel)
        if message is not None:
            self._begun_s[channel] = now_s
        return message


def _split(channel: str, message: PageMessage) -> Iterator[bytes]:
    text = isinstance(message, str)
    whole = memoryview(message.encode() if isinstance(message, str) else message)
    for start in range(0, len(whole), PIECE_BYTES):
        piece = whole[start : start + PIECE_BYTES]
        yield protocol.binary_message("part", piece, of=channel, start=start, total=len(whole), text=text)
