"""Frames over a local socket: previews as they come, full frames on request. The receiving end, and the wire format.

Each frame is a header (kind, time, height, width) and its raw pixels; a request is one byte. A thread reads, and the
node takes what has arrived. The thread connects again to a server that is not there yet or has gone.
"""

from __future__ import annotations

import logging
import socket
import struct
import threading
from collections import deque
from pathlib import Path

import numpy as np

from onboard.poi.camera.frame import Frame, Image

HEADER = struct.Struct("<cdHH")
PREVIEW, FULL = b"p", b"f"
REQUEST = b"F"
_RETRY_S = 0.2
_SIDE_MAX_PX = 4096

_log = logging.getLogger("poi")


def packed(kind: bytes, t_s: float, image: Image) -> bytes:
    """A frame as it goes over the socket."""
    return HEADER.pack(kind, t_s, *image.shape[:2]) + image.tobytes()


class SocketFrames:
    """Keeps the newest preview, and full frames until they are taken."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._preview: Frame | None = None
        self._fulls: deque[Frame] = deque(maxlen=4)
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._thread.start()

    def preview(self, now_s: float) -> Frame | None:
        with self._lock:
            frame, self._preview = self._preview, None
        return frame

    def request_full(self) -> None:
        connection = self._socket
        if connection is not None:
            try:
                connection.send(REQUEST)
            except OSError:
                _log.info("camera=away full_frame=not_requested")

    def full(self, now_s: float) -> Frame | None:
        with self._lock:
            return self._fulls.popleft() if self._fulls else None

    def close(self) -> None:
        self._stop.set()
        connection = self._socket
        if connection is not None:
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError:
                _log.debug("the camera had left before")
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                with socket.socket(socket.AF_UNIX) as connection:
                    connection.connect(str(self._path))
                    self._socket = connection
                    _log.info("camera=connected path=%s", self._path)
                    self._receive(connection)
            except OSError as error:
                _log.debug("camera=away path=%s reason=%s", self._path, error)
            finally:
                self._socket = None
            self._stop.wait(_RETRY_S)

    def _receive(self, connection: socket.socket) -> None:
        with connection.makefile("rb") as stream:
            while not self._stop.is_set():
                header = stream.read(HEADER.size)
                if len(header) < HEADER.size:
                    return
                kind, t_s, height, width = HEADER.unpack(header)
                if not (0 < height <= _SIDE_MAX_PX and 0 < width <= _SIDE_MAX_PX):
                    _log.warning("camera=garbled height=%d width=%d", height, width)
                    return
                pixels = stream.read(height * width * 3)
                if len(pixels) < height * width * 3:
                    return
                frame = Frame(t_s, np.frombuffer(pixels, np.uint8).reshape(height, width, 3))
                with self._lock:
                    if kind == FULL:
                        self._fulls.append(frame)
                    else:
                        self._preview = frame
