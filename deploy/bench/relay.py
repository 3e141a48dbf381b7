"""A TCP relay in place of a Wi-Fi link, for benchmarks and tests: it can be cut, fall silent, be slow and be late."""

from __future__ import annotations

import queue
import socket
import threading
import time
from contextlib import suppress

_CHUNK_BYTES = 4096  # 2 ms of a link of 2 MB/s: as long as one connection makes another one wait


class Relay:
    """Listens on `endpoint` and passes on to `target` (both `tcp/host:port`).

    `rate_bytes_s` is what the link carries, both ways and all connections together, by turns; 0 is no limit.
    """

    def __init__(self, target: str, rate_bytes_s: float = 0.0) -> None:
        self._target = _address(target)
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        self.delay_s = 0.0
        self.rate_bytes_s = rate_bytes_s
        self.relayed_bytes = 0
        self._free_s = 0.0  # when the link has carried what was taken so far
        self._turn = threading.Lock()
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
        """Nothing is passed on, and neither side is notified."""
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
                try:
                    far = socket.create_connection(self._target)
                except OSError:  # nobody listens there yet, or any more
                    near.close()
                    continue
                for end in (near, far):
                    # The relay sends every piece at once: collecting small ones (Nagle) is the decision of the two ends
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(source, sink), daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket) -> None:
        """Delay without loss of throughput: one thread reads, this one writes when it is time."""
        late: queue.Queue[tuple[float, bytes]] = queue.Queue()

        def read() -> None:
            with suppress(OSError):
                while data := source.recv(_CHUNK_BYTES):
                    self._carry(len(data))
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

    def _carry(self, count: int) -> None:
        """Returns when the link has carried so many bytes more; first come, first served."""
        with self._turn:
            self.relayed_bytes += count
            if not self.rate_bytes_s:
                return
            self._free_s = max(self._free_s, time.monotonic()) + count / self.rate_bytes_s
            done_s = self._free_s
        time.sleep(max(0.0, done_s - time.monotonic()))


def _address(endpoint: str) -> tuple[str, int]:
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    return host, int(port)
