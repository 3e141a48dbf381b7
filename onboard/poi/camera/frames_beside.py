"""A camera on a thread of its own: whatever a driver does, no step of the node waits for it.

A driver blocks until the next picture; that of a camera whose plug was pulled, for seconds. The thread captures and
keeps the newest pictures, and the node takes them.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from common.errors import StartError
from onboard.poi.camera.frame import Frame
from onboard.poi.camera.frame_source import FrameSource, is_camera, open_source

LOOK_S = 0.02  # between two looks at what is due
REOPENED_S = 2.0  # between two tries to open a camera again that gives nothing
END_S = 2.0  # how long the end waits for a driver

_log = logging.getLogger("poi")


class FramesBeside:
    """Captures from a source that may block. `opened` gives it anew after it has given nothing for REOPENED_S."""

    def __init__(self, opened: Callable[[], FrameSource]) -> None:
        """Opens the source once in the calling thread; raises what that raises."""
        self._opened = opened
        self._source: FrameSource | None = opened()
        self._ahead_s: float | None = None  # of the node's clock, from this machine's
        self._preview: Frame | None = None
        self._full: Frame | None = None
        self._wanted = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def preview(self, now_s: float) -> Frame | None:
        self._ahead_s = now_s - time.monotonic()
        frame, self._preview = self._preview, None
        return frame

    def request_full(self) -> None:
        self._wanted.set()

    def full(self, now_s: float) -> Frame | None:
        frame, self._full = self._full, None
        return frame

    def close(self) -> None:
        self._stop.set()
        self._thread.join(END_S)

    def _run(self) -> None:
        given_s = time.monotonic()
        while not self._stop.wait(LOOK_S):
            if self._source is not None and self._captured(self._source):
                given_s = time.monotonic()
            elif time.monotonic() - given_s > REOPENED_S:
                given_s = time.monotonic()
                self._reopen()
        if self._source is not None:
            self._source.close()

    def _captured(self, source: FrameSource) -> bool:
        """Captures what is due; whether there was anything."""
        if self._ahead_s is None:
            return True
        preview = source.preview(time.monotonic() + self._ahead_s)
        if preview is not None:
            self._preview = preview
        if self._wanted.is_set():
            source.request_full()
            full = source.full(time.monotonic() + self._ahead_s)
            if full is not None:
                self._wanted.clear()
                self._full = full
        return preview is not None

    def _reopen(self) -> None:
        if self._source is not None:
            _log.warning("camera=silent opening it again")
            self._source.close()
        try:
            self._source = self._opened()
        except (StartError, OSError, RuntimeError) as error:
            self._source = None
            _log.debug("camera=away reason=%s", error)


def camera_source(uri: str) -> FrameSource:
    """The source that a URI names, a camera on a thread of its own; raises StartError."""
    return FramesBeside(lambda: open_source(uri)) if is_camera(uri) else open_source(uri)
