"""The simulated camera as the POI module's frame source, for nodes in one thread with the world (`simulate`)."""

from __future__ import annotations

from offboard.simulator.camera import Camera
from onboard.poi.frame import PREVIEW_PERIOD_S, Frame, Image

_ROUNDING_S = 1e-6


class CameraFrames:
    """Draws when asked, at the time that it is: a preview every PREVIEW_PERIOD_S, a full frame after each request."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._due_s = 0.0
        self._wanted = False

    def preview(self, now_s: float) -> Frame | None:
        if now_s < self._due_s - _ROUNDING_S:
            return None
        self._due_s = now_s + PREVIEW_PERIOD_S
        return _frame(now_s, self._camera.preview())

    def request_full(self) -> None:
        self._wanted = True

    def full(self, now_s: float) -> Frame | None:
        if not self._wanted:
            return None
        self._wanted = False
        return _frame(now_s, self._camera.full())

    def close(self) -> None:
        """The camera belongs to the simulation."""


def _frame(now_s: float, image: Image | None) -> Frame | None:
    return Frame(now_s, image) if image is not None else None
