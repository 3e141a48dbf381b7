"""The web server: `Feed` -> the page, its WebSocket, photos, exports. In a thread of its own; the node only feeds.

What a page orders goes to the `Operator`; a page on another machine may look and stop, and nothing else.
"""

from __future__ import annotations

import asyncio
import re
import secrets
import socket
import threading
from base64 import b64encode
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from common.errors import StartError, sentence
from offboard.visualizer import protocol
from offboard.visualizer.connections import CONNECTIONS_MAX, BoundedProtocol, keep_log_brief
from offboard.visualizer.exports import Exports, attachment
from offboard.visualizer.feed import Feed, Held
from offboard.visualizer.operator import NoOperator, Operator
from offboard.visualizer.outbound import HEARTBEAT_PERIOD_S, Outbound
from offboard.visualizer.requests import BadRequest, Confirmation, Replay, Stop, parse

PAGE = Path(__file__).with_name("page")
PAGES_MAX = 32  # the other connections are for files, photos and exports
_RECEIVED_BYTES_MAX = 1024  # a page sends what it has received, and nothing else
_PIECE_BYTES = 64_000
_END_TIMEOUT_S = 2
_START_TIMEOUT_S = 10.0
_INLINE = re.search(r"<script>(.*?)</script>", (PAGE / "index.html").read_text(encoding="utf-8"), re.DOTALL)
assert _INLINE is not None
_INLINE_HASH = b64encode(sha256(_INLINE[1].encode()).digest()).decode()
# A browser that obeys it sends no request to any other server
_POLICY = (
    f"default-src 'self'; script-src 'self' 'sha256-{_INLINE_HASH}'; img-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class _Headers:
    """The policy on every answer, and nothing kept: after an update no browser shows half of the old page."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = _POLICY + _own_socket(scope)
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers.setdefault("Cache-Control", "no-cache")
            await send(message)

        await self._app(scope, receive, with_headers)


class _Pieces(StreamingResponse):
    """Content that goes out as it is read: a whole copy would wait for every slow reader."""

    def __init__(self, content: bytes, media_type: str, headers: Mapping[str, str] | None = None) -> None:
        async def pieces() -> AsyncIterator[bytes]:
            for start in range(0, len(content), _PIECE_BYTES):
                yield content[start : start + _PIECE_BYTES]

        super().__init__(pieces(), media_type=media_type, headers=headers)
        self.headers["Content-Length"] = str(len(content))


class _KnownHosts(TrustedHostMiddleware):
    """Accepts only requests for a name of this machine. A page of the internet could resolve its own name to this
    machine's address (DNS rebinding).

    A bare IP address cannot be rebound like that, so every address is accepted.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket") and _is_address(Headers(scope=scope).get("host", "")):
            await self.app(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)


class Playback(Protocol):
    """Of a recorded run."""

    def show(self, at_s: float | None, speed: float) -> None: ...


class NoPlayback:
    """Of a live run, which has the present moment only."""

    def show(self, at_s: float | None, speed: float) -> None: ...


class PageServer:
    """Listens from the start on, so that a taken port is known at once; serves from `start` to `close`.

    Raises StartError when it cannot listen. Port 0 takes any free one.
    """

    def __init__(
        self,
        feed: Feed,
        host: str,
        port: int,
        robot: str = "robot",
        names: Sequence[str] = (),
        operator: Operator | None = None,
        playback: Playback | None = None,
    ) -> None:
        """`names`: further host names under which browsers may request the page."""
        self._operator = operator or NoOperator()
        self._playback: Playback = playback or NoPlayback()
        self._token = secrets.token_urlsafe(16)
        keep_log_brief()
        self._feed = feed
        self._exports = Exports(feed)
        self._robot = robot
        self._socket = _listen(host, port)
        shown = "127.0.0.1" if host in ("", "0.0.0.0", "::") else host
        self.port: int = self._socket.getsockname()[1]
        self.address = f"http://{f'[{shown}]' if ':' in shown else shown}:{self.port}/"
        self.pages = 0  # how many look at present
        self._waiting: set[asyncio.Event] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._application([host, *names]),
                loop="asyncio",
                http=BoundedProtocol,
                backlog=CONNECTIONS_MAX,
                ws="websockets-sansio",
                ws_max_size=_RECEIVED_BYTES_MAX,
                # A page on the same machine or Wi-Fi gains nothing by it, and every pose would pay
                ws_per_message_deflate=False,
                log_config=None,
                log_level="warning",
                access_log=False,
                timeout_graceful_shutdown=_END_TIMEOUT_S,
            )
        )
        self._thread = threading.Thread(target=self._serve, name="page-server", daemon=True)

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def start(self) -> None:
        self._feed.on_change = self._wake
        self._operator.open()
        self._thread.start()
        self._ready.wait(_START_TIMEOUT_S)

    def close(self) -> None:
        self._feed.on_change = lambda: None
        self._operator.close()
        self._server.should_exit = True
        if self._thread.is_alive():
            self._wake()
            self._thread.join(2.0 * _END_TIMEOUT_S)
        self._socket.close()

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])

    def _application(self, names: list[str]) -> Starlette:
        own = socket.gethostname()
        hosts = ["localhost", own, f"{own.partition('.')[0]}.local", *names]
        guards = [Middleware(_Headers), Middleware(_KnownHosts, allowed_hosts=hosts, www_redirect=False)]

        @asynccontextmanager
        async def lifespan(_: Starlette) -> AsyncIterator[None]:
            self._loop = asyncio.get_running_loop()
            self._ready.set()
            yield

        routes = [
            WebSocketRoute("/live", self._live),
            Route("/refusal", self._refused),
            Route("/photos/{poi_id}.jpg", self._photo),
            Route("/export/map.{form}", self._export),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        return Starlette(routes=routes, middleware=guards, lifespan=lifespan)

    def _wake(self) -> None:
        loop = self._loop
        if self._waiting and loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._wake_clients)

    def _wake_clients(self) -> None:
        for event in self._waiting:
            event.set()

    # Endpoints; those that are not `async` run in a thread of their own

    def _photo(self, request: Request) -> Response:
        number = request.path_params["poi_id"]
        photo = self._feed.photo(int(number)) if re.fullmatch(r"[0-9]{1,18}", number) else None
        if photo is None:
            return PlainTextResponse("There is no photo of this point of interest.", 404)
        return _Pieces(photo, "image/jpeg")

    async def _export(self, request: Request) -> Response:
        form = request.path_params["form"]
        if form not in self._exports.offered:
            return PlainTextResponse(f"No export as {form}; choose from {', '.join(self._exports.offered)}.", 404)
        try:
            file = await self._exports.get(form)
        except (StartError, OSError) as error:
            return PlainTextResponse(sentence(error), 500)
        disposition = {"Content-Disposition": attachment(f"{self._robot}-{file.name}")}
        return _Pieces(file.content, file.media_type, disposition)

    def _refused(self, request: Request) -> Response:
        """Why the socket of a page of that origin is refused: a browser does not let the page read it from there."""
        origin = request.query_params.get("origin", "")
        return PlainTextResponse(self._refusal(origin, request.headers.get("host", "")))

    def _refusal(self, origin: str | None, host: str) -> str:
        """Empty where a page may look. Browsers send the origin of the requesting page; other programs need not."""
        if origin is not None and urlsplit(origin).netloc != host:
            return (
                "This address and the one at the server differ: a proxy between them changes the Host header. "
                "Let it pass Host on unchanged, or open the page at its own address."
            )
        return f"{PAGES_MAX} pages are open, and more may not be: close one." if self.pages >= PAGES_MAX else ""

    async def _live(self, page: WebSocket) -> None:
        if self._refusal(page.headers.get("origin"), page.headers.get("host", "")):
            await page.close(1008)
            return
        await page.accept()
        news = asyncio.Event()
        self._waiting.add(news)
        self.pages += 1
        token = self._token if page.client is not None and _is_own(page.client.host) else ""
        hello = protocol.hello(self._robot, self._exports.offered, self._feed.model_id, self._feed.run, token)
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
            self.pages -= 1
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
                else:
                    self._operator.operate(request)
            except BadRequest:
                await page.close(1008)
                return
            news.set()

    async def _send(self, page: WebSocket, outbound: Outbound, news: asyncio.Event) -> None:
        """Sends what is new as fast as the page confirms it."""
        while not self._server.should_exit:
            news.clear()
            while (message := outbound.next()) is not None:
                await _send_message(page, message)
            try:
                await asyncio.wait_for(news.wait(), HEARTBEAT_PERIOD_S)
            except TimeoutError:
                continue
        await page.close(1001)


def _own_socket(scope: Scope) -> str:
    """Not every browser counts a WebSocket of the same host as 'self'."""
    host = dict(scope["headers"]).get(b"host", b"").decode("latin-1")
    return f"; connect-src 'self' ws://{host}" if re.fullmatch(r"[\w.:\[\]-]+", host) else ""


async def _send_message(page: WebSocket, message: protocol.PageMessage) -> None:
    if isinstance(message, str):
        await page.send_text(message)
    else:
        await page.send_bytes(message)


def _held(page: WebSocket) -> Held | None:
    """What a page that comes back has of the map, as it says in its address."""
    found = re.fullmatch(r"(\w{1,32}),([0-9]{1,9}),([0-9]{1,9})", page.query_params.get("held", ""), re.ASCII)
    return Held(found[1], int(found[2]), int(found[3])) if found else None


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise StartError(
            f"The page cannot be served at {host} port {port} ({error.strerror}): end what uses it, "
            "or set another [visualizer] port in robot.toml."
        ) from error
    return listener


def _is_own(address: str) -> bool:
    """Whether a browser at that address runs on this machine."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return False


def _is_address(host: str) -> bool:
    """Whether a Host header names an address, with or without a port."""
    try:
        ip_address(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return False
    return True
