"""The pages that are open, a WebSocket each: what is new goes out, confirmations and orders come in.

A page on another machine may look and stop, and nothing else.
"""

from __future__ import annotations

import asyncio
import re
import secrets
from collections.abc import Sequence
from typing import Protocol

from starlette.websockets import WebSocket, WebSocketDisconnect

from offboard.operate.bus_operator import Operator
from offboard.operate.door_sender import OfDoor
from offboard.visualizer import protocol
from offboard.visualizer.feed import Feed, Held
from offboard.visualizer.guards import is_of_host, is_own
from offboard.visualizer.outbound import HEARTBEAT_PERIOD_S, Outbound
from offboard.visualizer.requests import BadRequest, Confirmation, Release, Replay, Stop, parse

PAGES_MAX = 32  # the other connections are for files, photos and exports


class Playback(Protocol):
    """Of a recorded run."""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def show(self, at_s: float | None, speed: float) -> None: ...


class NoPlayback:
    """Of a live run, which has the present moment only."""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def show(self, at_s: float | None, speed: float) -> None: ...


class OpenPages:
    """`serve` each socket; `wake`, from any thread, when there is news; `end` before the server ends."""

    def __init__(
        self, feed: Feed, robot: str, exports: Sequence[str], operator: Operator, playback: Playback, over: str = ""
    ) -> None:
        """`exports`: those that the page offers; `over`: the run whose walls it shows too."""
        self._feed, self._robot, self._exports, self._over = feed, robot, exports, over
        self._operator, self._playback = operator, playback
        self._token = secrets.token_urlsafe(16)
        self.count = 0
        self._ended = False
        self._waiting: set[asyncio.Event] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    def refusal(self, origin: str | None, host: str) -> str:
        """Empty where a page may look."""
        if not is_of_host(origin, host):
            return (
                "This address and the one at the server differ: a proxy between them changes the Host header. "
                "Let it pass Host on unchanged, or open the page at its own address."
            )
        return f"{PAGES_MAX} pages are open, and more may not be: close one." if self.count >= PAGES_MAX else ""

    def wake(self) -> None:
        loop = self._loop
        if self._waiting and loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._wake_senders)

    def end(self) -> None:
        self._ended = True
        self.wake()

    def _wake_senders(self) -> None:
        for event in self._waiting:
            event.set()

    async def serve(self, page: WebSocket) -> None:
        if self.refusal(page.headers.get("origin"), page.headers.get("host", "")):
            await page.close(1008)
            return
        await page.accept()
        self._loop = asyncio.get_running_loop()
        news = asyncio.Event()
        self._waiting.add(news)
        self.count += 1
        token = self._token if page.client is not None and is_own(page.client.host) else ""
        hello = protocol.hello(self._robot, self._exports, self._feed.model_id, self._feed.run, token, self._over)
        outbound = Outbound(self._feed.client(_held(page)), hello)
        try:
            sender = asyncio.ensure_future(self._send(page, outbound, news))
            listener = asyncio.ensure_future(self._listen_to(page, outbound, news, token))
            done, pending = await asyncio.wait({sender, listener}, return_when=asyncio.FIRST_COMPLETED)
            for task in pending:
                task.cancel()
            await asyncio.gather(*pending, return_exceptions=True)
            for task in done:
                task.result()
        except WebSocketDisconnect:
            pass
        finally:
            self.count -= 1
            self._waiting.discard(news)

    async def _listen_to(self, page: WebSocket, outbound: Outbound, news: asyncio.Event, token: str) -> None:
        """Takes confirmations and orders until the page leaves, or sends something else."""
        while (event := await page.receive())["type"] != "websocket.disconnect":
            try:
                request = parse(event.get("text") or "", token)
                if isinstance(request, Confirmation):
                    outbound.confirm(request)
                elif isinstance(request, Replay):
                    self._playback.show(request.at_s, request.speed)
                elif isinstance(request, Stop):
                    self._operator.stop()
                elif isinstance(request, Release):
                    self._operator.release(request.epoch)
                elif isinstance(request, OfDoor):
                    self._operator.note_door(request)
                else:
                    self._operator.operate(request)
            except BadRequest:
                await page.close(1008)
                return
            news.set()

    async def _send(self, page: WebSocket, outbound: Outbound, news: asyncio.Event) -> None:
        """Sends what is new as fast as the page confirms it."""
        while not self._ended:
            news.clear()
            while (message := outbound.next()) is not None:
                await _send_message(page, message)
            try:
                await asyncio.wait_for(news.wait(), HEARTBEAT_PERIOD_S)
            except TimeoutError:
                continue
        await page.close(1001)


async def _send_message(page: WebSocket, message: protocol.PageMessage) -> None:
    if isinstance(message, str):
        await page.send_text(message)
    else:
        await page.send_bytes(message)


def _held(page: WebSocket) -> Held | None:
    """What a page that comes back has of the map, as it says in its address."""
    found = re.fullmatch(r"(\w{1,32}),([0-9]{1,9}),([0-9]{1,9})", page.query_params.get("held", ""), re.ASCII)
    return Held(found[1], int(found[2]), int(found[3])) if found else None
