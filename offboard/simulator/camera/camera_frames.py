"""The simulated camera as the POI module's frame source, for nodes in one thread with the world (`simulate`)."""

from __future__ import annotations

from offboard.simulator.camera.camera import Camera
from onboard.poi.camera.frame import Frame, Image
from onboard.poi.camera.frame_source import PacedFrames


class CameraFrames(PacedFrames):
    """Renders in the step that captures."""

    def __init__(self, camera: Camera) -> None:
        super().__init__()
        self._camera = camera

    def close(self) -> None:
        """The camera belongs to the simulation."""

    def _capture_preview(self, now_s: float) -> Frame | None:
        return _frame(now_s, self._camera.preview())

    def _capture_full(self, now_s: float) -> Frame | None:
        return _frame(now_s, self._camera.full())


def _frame(now_s: float, image: Image | None) -> Frame | None:
    return Frame(now_s, image) if image is not None else None
