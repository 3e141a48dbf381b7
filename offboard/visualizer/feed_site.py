"""The page of one feed: its files, WebSocket, photos and exports. `Feed` -> routes of a server."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Mapping

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Mount, Route, Router, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from common.errors import StartError, sentence
from offboard.operate.bus_operator import NoOperator, Operator
from offboard.visualizer.exports import Exports, attachment
from offboard.visualizer.feed import Feed
from offboard.visualizer.guards import PAGE
from offboard.visualizer.open_pages import NoPlayback, OpenPages, Playback
from offboard.visualizer.run_overlay import RunOverlay

_PIECE_BYTES = 64_000


class _Pieces(StreamingResponse):
    """Content that goes out as it is read: a whole copy would wait for every slow reader."""

    def __init__(self, content: bytes, media_type: str, headers: Mapping[str, str] | None = None) -> None:
        async def pieces() -> AsyncIterator[bytes]:
            for start in range(0, len(content), _PIECE_BYTES):
                yield content[start : start + _PIECE_BYTES]

        super().__init__(pieces(), media_type=media_type, headers=headers)
        self.headers["Content-Length"] = str(len(content))


class FeedSite:
    """A `Site` of one feed; also an application by itself, below another one."""

    def __init__(
        self,
        feed: Feed,
        robot: str = "robot",
        operator: Operator | None = None,
        playback: Playback | None = None,
        overlay: RunOverlay | None = None,
    ) -> None:
        self._feed, self._robot, self._overlay = feed, robot, overlay
        self._operator, self._playback = operator or NoOperator(), playback or NoPlayback()
        self._exports = Exports(feed)
        over = overlay.name if overlay is not None else ""
        self._open = OpenPages(feed, robot, self._exports.offered, self._operator, self._playback, over)
        self.routes: list[BaseRoute] = [
            WebSocketRoute("/live", self._open.serve),
            Route("/refusal", self._refused),
            Route("/photos/{poi_id}.jpg", self._photo),
            Route("/export/map.{form}", self._export),
            Route("/comparison", self._comparison),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        self._router = Router(self.routes)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._router(scope, receive, send)

    @property
    def pages(self) -> int:
        """How many look at present."""
        return self._open.count

    def open(self) -> None:
        self._feed.on_change = self._open.wake
        self._operator.open()
        self._playback.open()

    def close(self) -> None:
        self._feed.on_change = lambda: None
        self._operator.close()
        self._playback.close()
        self._open.end()

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

    def _comparison(self, _: Request) -> Response:
        if self._overlay is None:
            return PlainTextResponse("No other run lies over this one.", 404)
        try:
            return JSONResponse(self._overlay.layers())
        except (StartError, OSError) as error:
            return PlainTextResponse(sentence(error), 500)

    def _refused(self, request: Request) -> Response:
        """Why the socket of a page of that origin is refused: a browser does not let the page read it from there."""
        origin = request.query_params.get("origin", "")
        return PlainTextResponse(self._open.refusal(origin, request.headers.get("host", "")))
