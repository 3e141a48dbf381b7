"""The web server: `Feed` -> the page, its WebSocket, photos, exports. In a thread of its own; the node only feeds."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from common.errors import StartError, sentence
from offboard.operate.bus_operator import NoOperator, Operator
from offboard.visualizer.connections import CONNECTIONS_MAX, BoundedProtocol, keep_log_brief
from offboard.visualizer.exports import Exports, attachment
from offboard.visualizer.feed import Feed
from offboard.visualizer.guards import PAGE, KnownHosts, PolicyHeaders
from offboard.visualizer.open_pages import NoPlayback, OpenPages, Playback

_RECEIVED_BYTES_MAX = 1024  # a page sends what it has received, and orders
_PIECE_BYTES = 64_000
_END_TIMEOUT_S = 2
_START_TIMEOUT_S = 10.0


class _Pieces(StreamingResponse):
    """Content that goes out as it is read: a whole copy would wait for every slow reader."""

    def __init__(self, content: bytes, media_type: str, headers: Mapping[str, str] | None = None) -> None:
        async def pieces() -> AsyncIterator[bytes]:
            for start in range(0, len(content), _PIECE_BYTES):
                yield content[start : start + _PIECE_BYTES]

        super().__init__(pieces(), media_type=media_type, headers=headers)
        self.headers["Content-Length"] = str(len(content))


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
        keep_log_brief()
        self._feed, self._robot = feed, robot
        self._operator = operator or NoOperator()
        self._exports = Exports(feed)
        self._open = OpenPages(feed, robot, self._exports.offered, self._operator, playback or NoPlayback())
        self._socket = _listen(host, port)
        shown = "127.0.0.1" if host in ("", "0.0.0.0", "::") else host
        self.port: int = self._socket.getsockname()[1]
        self.address = f"http://{f'[{shown}]' if ':' in shown else shown}:{self.port}/"
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
    def pages(self) -> int:
        """How many look at present."""
        return self._open.count

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def start(self) -> None:
        self._feed.on_change = self._open.wake
        self._operator.open()
        self._thread.start()
        self._ready.wait(_START_TIMEOUT_S)

    def close(self) -> None:
        self._feed.on_change = lambda: None
        self._operator.close()
        self._server.should_exit = True
        self._open.end()
        if self._thread.is_alive():
            self._thread.join(2.0 * _END_TIMEOUT_S)
        self._socket.close()

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])

    def _application(self, names: list[str]) -> Starlette:
        own = socket.gethostname()
        hosts = ["localhost", own, f"{own.partition('.')[0]}.local", *names]
        guards = [Middleware(PolicyHeaders), Middleware(KnownHosts, allowed_hosts=hosts, www_redirect=False)]

        @asynccontextmanager
        async def lifespan(_: Starlette) -> AsyncIterator[None]:
            self._ready.set()
            yield

        routes = [
            WebSocketRoute("/live", self._open.serve),
            Route("/refusal", self._refused),
            Route("/photos/{poi_id}.jpg", self._photo),
            Route("/export/map.{form}", self._export),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        return Starlette(routes=routes, middleware=guards, lifespan=lifespan)

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
        return PlainTextResponse(self._open.refusal(origin, request.headers.get("host", "")))


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
