"""A TCP relay in place of a Wi-Fi link: it can be cut, fall silent, and be slow."""

from __future__ import annotations

import queue
import socket
import threading
import time
from contextlib import suppress

_CHUNK_BYTES = 16_384


class Relay:
    """Listens on `endpoint` and passes on to `target` (both `tcp/host:port`)."""

    def __init__(self, target: str) -> None:
        self._target = _address(target)
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        self.delay_s = 0.0
        self._up = threading.Event()
        self._up.set()
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Connections end, new ones end at once."""
        self._up.clear()
        for end in self._sockets:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._sockets.clear()

    def silence(self) -> None:
        """Nothing is passed on, and nobody is told."""
        self._up.clear()

    def restore(self) -> None:
        self._up.set()

    def close(self) -> None:
        self.cut()
        self._server.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                if not self._up.is_set():
                    near.close()
                    continue
                far = socket.create_connection(self._target)
                self._sockets += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(source, sink), daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket) -> None:
        """Delay without loss of throughput: one thread reads, this one writes when it is time."""
        late: queue.Queue[tuple[float, bytes]] = queue.Queue()

        def read() -> None:
            with suppress(OSError):
                while data := source.recv(_CHUNK_BYTES):
                    late.put((time.monotonic() + self.delay_s, data))
            late.put((0.0, b""))

        threading.Thread(target=read, daemon=True).start()
        with suppress(OSError):
            while (item := late.get())[1]:
                self._up.wait()
                time.sleep(max(0.0, item[0] - time.monotonic()))
                sink.sendall(item[1])
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


def _address(endpoint: str) -> tuple[str, int]:
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    return host, int(port)
