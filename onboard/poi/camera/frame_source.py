"""Where frames come from: a URI of robot.toml -> a `FrameSource` with two streams.

A small preview comes by itself, a few times a second; a full frame comes after a request. `picamera` is the
Raspberry Pi's camera, `/dev/video0` or a number a USB camera, a file or folder holds photos, and `unix:PATH` is a
socket that serves frames. All but the first two are for machines without a camera.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from common.errors import StartError
from common.json_reader import Node, load_json
from onboard.poi.camera.frame import FULL_SIZE_PX, PREVIEW_PERIOD_S, PREVIEW_SIZE_PX, Frame, Image
from onboard.poi.camera.frame_socket import SocketFrames

EXPOSURE_US = 15_000  # at 0.16 m/s a plate's stroke moves by 2.4 mm meanwhile
PHOTO_SIDE_MIN_PX = 32  # smaller files are no photos
_JPEG_BEGIN, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp")
_ROUNDING_S = 1e-6  # of clocks that add up steps


class FrameSource(Protocol):
    """Two streams. Nothing here waits: what is not there yet is None."""

    def preview(self, now_s: float) -> Frame | None:
        """The newest small frame, once."""

    def request_full(self) -> None: ...

    def full(self, now_s: float) -> Frame | None:
        """The requested full frame, once."""

    def close(self) -> None: ...


class PacedFrames(ABC):
    """A camera that captures on command: a preview every PREVIEW_PERIOD_S, a full frame per request."""

    def __init__(self) -> None:
        self._due_s = 0.0
        self._wanted = False

    def preview(self, now_s: float) -> Frame | None:
        if now_s < self._due_s - _ROUNDING_S:
            return None
        self._due_s = now_s + PREVIEW_PERIOD_S
        return self._capture_preview(now_s)

    def request_full(self) -> None:
        self._wanted = True

    def full(self, now_s: float) -> Frame | None:
        if not self._wanted:
            return None
        self._wanted = False
        return self._capture_full(now_s)

    @abstractmethod
    def close(self) -> None: ...

    @abstractmethod
    def _capture_preview(self, now_s: float) -> Frame | None:
        """A frame of PREVIEW_SIZE_PX; None when the camera gave none."""

    @abstractmethod
    def _capture_full(self, now_s: float) -> Frame | None:
        """A full frame, or the newest one of a camera with one stream; None when the camera gave none."""


class PiCameraFrames(PacedFrames):
    """Picamera2: `lores` is the preview and `main` the full frame of one sensor. Exposure and colours stay locked."""

    def __init__(self) -> None:
        super().__init__()
        try:
            from picamera2 import Picamera2  # of the system: it cannot be installed from PyPI
        except ImportError as error:
            raise StartError(
                "The camera needs Picamera2: run 'sudo apt install python3-picamera2', and let the environment of the "
                "robot see the system's packages."
            ) from error
        self._camera: Any = Picamera2()
        self._camera.configure(
            self._camera.create_video_configuration(
                main={"size": FULL_SIZE_PX, "format": "RGB888"},  # this name means blue, green, red in memory
                lores={"size": PREVIEW_SIZE_PX, "format": "YUV420"},
                controls={"ExposureTime": EXPOSURE_US, "AeEnable": False},
            )
        )
        self._camera.start()

    def close(self) -> None:
        self._camera.stop()
        self._camera.close()

    def _capture_preview(self, now_s: float) -> Frame:
        planes = self._camera.capture_array("lores")
        return Frame(now_s, np.asarray(cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420), dtype=np.uint8))

    def _capture_full(self, now_s: float) -> Frame:
        return Frame(now_s, np.asarray(self._camera.capture_array("main"), dtype=np.uint8))


class VideoFrames(PacedFrames):
    """A USB camera by OpenCV; its one stream is scaled down for the preview."""

    def __init__(self, device: str | int) -> None:
        super().__init__()
        self._capture = cv2.VideoCapture(device, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise StartError(f"No camera answers at {device}: plug it in, or correct poi.source in robot.toml.")
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, FULL_SIZE_PX[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, FULL_SIZE_PX[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._newest: Frame | None = None

    def close(self) -> None:
        self._capture.release()

    def _capture_preview(self, now_s: float) -> Frame | None:
        self._capture.grab()  # what waits in the driver is as old as the last preview
        works, image = self._capture.read()
        if not works:
            return None
        self._newest = Frame(now_s, np.asarray(image, dtype=np.uint8))
        return Frame(now_s, np.asarray(cv2.resize(image, PREVIEW_SIZE_PX, interpolation=cv2.INTER_AREA), np.uint8))

    def _capture_full(self, now_s: float) -> Frame | None:
        return self._newest


class StoredFrames(PacedFrames):
    """Photos of a file or folder in the order of their names, one after the other as previews and full frames."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._files = photo_files(path)
        self._newest: Frame | None = None

    def close(self) -> None:
        """Nothing is held open."""

    def _capture_preview(self, now_s: float) -> Frame | None:
        if not self._files:
            return None
        self._newest = Frame(now_s, read_photo(self._files.pop(0)))
        return Frame(now_s, np.asarray(cv2.resize(self._newest.image, PREVIEW_SIZE_PX), dtype=np.uint8))

    def _capture_full(self, now_s: float) -> Frame | None:
        return self._newest


def is_camera(uri: str) -> bool:
    """Whether a URI names a camera of this machine, whose driver may block."""
    return uri == "picamera" or uri.startswith("/dev/") or re.fullmatch("[0-9]{1,3}", uri) is not None


def open_source(uri: str) -> FrameSource:
    """The source that a URI names; raises StartError."""
    if uri == "picamera":
        return PiCameraFrames()
    if uri.startswith("unix:"):
        return SocketFrames(Path(uri.removeprefix("unix:")))
    if re.fullmatch("[0-9]{1,3}", uri):
        return VideoFrames(int(uri))
    if uri.startswith("/dev/"):
        return VideoFrames(uri)
    return StoredFrames(Path(uri))


def photo_files(path: Path) -> list[Path]:
    """The file, or the photos in a folder by name; raises StartError where there is none."""
    named = [f for f in sorted(path.iterdir()) if f.suffix.lower() in SUFFIXES] if path.is_dir() else [path]
    files = [file for file in named if file.is_file()]
    if not files:
        raise StartError(f"There is no photo at {path}; photos end in {', '.join(SUFFIXES)}.")
    return files


def read_photo(file: Path) -> Image:
    """A photo; raises StartError when it is none, or not all of one, OSError."""
    data = file.read_bytes()
    # The decoder invents the missing part of a truncated JPEG. Some cameras append data after the end marker
    if data.startswith(_JPEG_BEGIN) and _JPEG_END not in data[len(data) // 2 :]:
        raise StartError(f"{file} is only a part of a picture; copy it again.")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # empty, or larger than OpenCV takes
        image = None
    if image is None or min(image.shape[:2]) < PHOTO_SIDE_MIN_PX:
        raise StartError(f"{file} is no picture that can be read; give a JPEG or PNG file of the camera.")
    return np.asarray(image, dtype=np.uint8)


def pose_sidecar(file: Path) -> dict[str, float]:
    """The fields `x_m`, `y_m`, `heading_rad`, `wall_m` of `<photo>.json` beside a photo; empty without that file.

    Raises StartError when the file lacks one.
    """
    sidecar = file.with_suffix(".json")
    if not sidecar.is_file():
        return {}
    reader = Node(load_json(sidecar, str(sidecar), StartError), str(sidecar), StartError)
    return {key: reader.number(key) for key in ("x_m", "y_m", "heading_rad")} | {"wall_m": reader.length("wall_m")}
