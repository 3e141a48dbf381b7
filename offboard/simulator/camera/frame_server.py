"""The simulated camera on a local socket, for a POI module that is a process of its own (`local`).

The simulator renders in its own step and never waits: a preview every PREVIEW_PERIOD_S, a full frame in the step after
a request. A thread per connection sends; frames that a late receiver has no room for are dropped.
"""

from __future__ import annotations

import logging
import queue
import socket
import threading
from contextlib import suppress
from pathlib import Path

from offboard.simulator.camera.camera import Camera
from onboard.poi.camera.frame import PREVIEW_PERIOD_S, Image
from onboard.poi.camera.frame_socket import FULL, PREVIEW, REQUEST, packed

FRAMES_WAITING_MAX = 3

_log = logging.getLogger("simulator")


class FrameServer:
    """Serves one receiver at a time; a new one takes the place of the old."""

    def __init__(self, camera: Camera, path: Path) -> None:
        """Raises OSError when the socket cannot be made."""
        self._camera = camera
        self._path = path
        path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen(1)
        self._wanted = threading.Event()
        self._link: _Link | None = None
        self._due_s = 0.0
        threading.Thread(target=self._accept, name="frame server", daemon=True).start()

    def step(self, now_s: float) -> None:
        """Renders what is due, if a receiver is connected."""
        link = self._link
        if link is None:
            return
        if now_s >= self._due_s:
            self._due_s = now_s + PREVIEW_PERIOD_S
            link.send(PREVIEW, now_s, self._camera.preview())
        if self._wanted.is_set():
            self._wanted.clear()
            link.send(FULL, now_s, self._camera.full())

    def close(self) -> None:
        with suppress(OSError):  # a listener that nobody connected to has nothing to shut down
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        if self._link is not None:
            self._link.close()
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            if self._link is not None:
                self._link.close()
            _log.info("camera=receiver_connected path=%s", self._path)
            self._wanted.clear()
            self._link = _Link(connection, self._wanted)


class _Link:
    """One receiver: a thread that sends frames, and one that receives requests."""

    def __init__(self, connection: socket.socket, wanted: threading.Event) -> None:
        self._connection = connection
        self._wanted = wanted
        self._frames: queue.Queue[bytes | None] = queue.Queue(FRAMES_WAITING_MAX)
        for run in (self._send, self._receive):
            threading.Thread(target=run, name="frames", daemon=True).start()

    def send(self, kind: bytes, t_s: float, image: Image | None) -> None:
        if image is not None:
            with suppress(queue.Full):
                self._frames.put_nowait(packed(kind, t_s, image))

    def close(self) -> None:
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        with suppress(queue.Full):
            self._frames.put_nowait(None)

    def _send(self) -> None:
        with suppress(OSError), self._connection:
            while (data := self._frames.get()) is not None:
                self._connection.sendall(data)

    def _receive(self) -> None:
        with suppress(OSError):
            while data := self._connection.recv(64):
                if REQUEST in data:
                    self._wanted.set()
