"""The socket of a page, read as the page does: confirms what it has received, and joins what came in parts."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from websockets.sync.client import ClientConnection, connect

Frame = tuple[dict[str, Any], bytes]  # head and raw values


def unpacked(message: str | bytes) -> Frame:
    """A message as the page reads it."""
    if isinstance(message, str):
        return json.loads(message), b""
    length = int.from_bytes(message[:4], "little")
    assert (4 + length) % 4 == 0, "numbers must begin where a browser can read them"
    return json.loads(message[4 : 4 + length]), message[4 + length :]


class Parts:
    """Joins messages that travel in parts."""

    def __init__(self) -> None:
        self._parts: dict[str, bytes] = {}

    def join(self, frame: Frame) -> Frame | None:
        """The frame itself, or the whole message with its last part; None while parts are missing."""
        head, body = frame
        if head["channel"] != "part":
            return frame
        before = self._parts.pop(head["of"], b"") if head["start"] else b""
        assert len(before) == head["start"], "a part is missing"
        whole = before + body
        if len(whole) < head["total"]:
            self._parts[head["of"]] = whole
            return None
        return unpacked(whole.decode() if head["text"] else whole)


class PageSocket:
    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.received_bytes = 0
        self._parts = Parts()
        self._confirm()

    def next(self, timeout_s: float) -> Frame:
        """The next whole message. Raises TimeoutError, ConnectionClosed."""
        while True:
            message = self.connection.recv(timeout=timeout_s)
            self.received_bytes += len(message)
            self._confirm()
            frame = self._parts.join(unpacked(message))
            if frame is not None:
                return frame

    def of_channel(self, channel: str, timeout_s: float = 5.0) -> Frame:
        """The next message of a channel; what comes before is read over."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            frame = self.next(timeout_s)
            if frame[0]["channel"] == channel:
                return frame
        raise TimeoutError(channel)

    def _confirm(self) -> None:
        self.connection.send(json.dumps({"received": self.received_bytes, "at": time.monotonic()}))


@contextmanager
def page_socket(address: str, held: str = "", **options: Any) -> Iterator[PageSocket]:
    """Of the page at this address, `http://host:port/`; `held` as the page says it."""
    url = f"{address.replace('http', 'ws')}live?held={held}"
    with connect(url, **({"open_timeout": 5, "close_timeout": 0.2, "max_size": None} | options)) as connection:
        yield PageSocket(connection)
