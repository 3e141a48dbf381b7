"""The web server: a `Site` -> HTTP and WebSockets of browsers, in a thread of its own."""

from __future__ import annotations

import socket
import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Protocol

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.routing import BaseRoute

from common.errors import StartError
from offboard.visualizer.connections import CONNECTIONS_MAX, BoundedProtocol, keep_log_brief
from offboard.visualizer.guards import KnownHosts, PolicyHeaders

_RECEIVED_BYTES_MAX = 1024  # a page sends what it has received, and orders
_END_TIMEOUT_S = 2
_START_TIMEOUT_S = 10.0


class Site(Protocol):
    """What is served."""

    routes: list[BaseRoute]

    @property
    def pages(self) -> int:
        """How many pages are open there."""

    def open(self) -> None: ...

    def close(self) -> None: ...


class PageServer:
    """Listens from the start on, so that a taken port is known at once; serves from `start` to `close`.

    Raises StartError when it cannot listen. Port 0 takes any free one.
    """

    def __init__(self, site: Site, host: str, port: int, names: Sequence[str] = ()) -> None:
        """`names`: further host names under which browsers may request it."""
        keep_log_brief()
        self._site = site
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
        return self._site.pages

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def start(self) -> None:
        self._site.open()
        self._thread.start()
        self._ready.wait(_START_TIMEOUT_S)

    def close(self) -> None:
        self._server.should_exit = True
        self._site.close()
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

        return Starlette(routes=self._site.routes, middleware=guards, lifespan=lifespan)


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
