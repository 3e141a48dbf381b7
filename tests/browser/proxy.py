"""What may lie between browser and server: a slow link, one that breaks, a proxy that changes requests."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from math import inf
from queue import Empty, Queue

_READ_BYTES = 4096
_POLL_S = 0.05

_Due = tuple[float, bytes]  # when it has left, and what


class Proxy:
    """A TCP proxy to a port of this machine. Both ways have the delay; what the server sends shares the rate.

    `changed`: what becomes of what the browser sends.
    """

    def __init__(
        self,
        to_port: int,
        bytes_s: float = inf,
        delay_s: float = 0.0,
        changed: Callable[[bytes], bytes] = lambda data: data,
    ) -> None:
        self._to = ("127.0.0.1", to_port)
        self._delay_s = delay_s
        self._bytes_s = bytes_s
        self._changed = changed
        self._free_s = 0.0
        self._lock = threading.Lock()
        self._sockets: list[socket.socket] = []
        self._ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._start(self._accept)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def cut(self) -> None:
        """Ends the connections that there are."""
        with self._lock:
            for connection in self._sockets:
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
            self._sockets.clear()

    def close(self) -> None:
        self._ended.set()
        self._listener.close()
        self.cut()

    def _start(self, run: Callable[..., None], *arguments: object) -> None:
        threading.Thread(target=run, args=arguments, daemon=True).start()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                browser, _ = self._listener.accept()
            except OSError:
                return
            server = socket.create_connection(self._to)
            for connection in (browser, server):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._sockets += [browser, server]
            self._carry(browser, server, lambda data: (time.monotonic(), self._changed(data)))
            self._carry(server, browser, self._limited)

    def _limited(self, data: bytes) -> _Due:
        with self._lock:
            self._free_s = max(time.monotonic(), self._free_s) + len(data) / self._bytes_s
            return self._free_s, data

    def _carry(self, source: socket.socket, target: socket.socket, due: Callable[[bytes], _Due]) -> None:
        """As a modem does: it takes whatever it is given, and sends it on one after the other."""
        waiting: Queue[_Due] = Queue()
        self._start(self._read, source, waiting, due)
        self._start(self._write, target, waiting)

    def _read(self, source: socket.socket, waiting: Queue[_Due], due: Callable[[bytes], _Due]) -> None:
        data = b"x"
        while data:
            try:
                data = source.recv(_READ_BYTES)
            except OSError:
                data = b""
            waiting.put(due(data))

    def _write(self, target: socket.socket, waiting: Queue[_Due]) -> None:
        while not self._ended.is_set():
            try:
                due_s, data = waiting.get(timeout=_POLL_S)
            except Empty:
                continue
            time.sleep(max(0.0, due_s + self._delay_s - time.monotonic()))
            try:
                if not data:
                    target.shutdown(socket.SHUT_WR)
                    return
                target.sendall(data)
            except OSError:
                return
