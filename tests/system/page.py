"""What the page of the visualizer is told, read over its socket."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from websockets.exceptions import WebSocketException

from common.messages.mapping import MapUpdate
from tests.page_socket import page_socket
from tests.system.recording import Points, assembled

_WAIT_S = 5.0


def frames(host: str, port: int, wait_s: float = _WAIT_S) -> Iterator[tuple[dict[str, Any], bytes]]:
    """Head and raw values of every frame, until none comes for `wait_s` or the page is not there."""
    try:
        with page_socket(f"http://{host}:{port}/", open_timeout=2) as page:
            while True:
                yield page.next(wait_s)
    except (OSError, TimeoutError, WebSocketException):
        return


def page_map(host: str, port: int, count: int) -> Points:
    """The wall points that a page shows that is opened now: as soon as there are so many, else what it was told."""
    updates: list[MapUpdate] = []
    end_s = time.monotonic() + _WAIT_S
    for head, body in frames(host, port):
        if head["channel"] == "map":
            points = np.frombuffer(body, "<f4", 2 * head["count"]).reshape(-1, 2)
            updates.append(MapUpdate(0.0, 0, head["start"], points, np.zeros(len(points), np.uint8)))
        if len(assembled(updates)) == count or time.monotonic() > end_s:
            break
    return assembled(updates)
