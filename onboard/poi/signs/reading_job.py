"""OCR beside the steps, since it takes longer than one (`common/side_work.py`): jobs in, readings out later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cv2

from common.geometry import Pose2
from common.side_work import DeferredWorker, SideWorker, ThreadWorker
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Frame, Image
from onboard.poi.camera.sharpness import Sharpness, sharpness
from onboard.poi.placement.wall_line import WallLine
from onboard.poi.signs.grouping import signs
from onboard.poi.signs.sign_detection import Box
from onboard.poi.signs.sign_reading import SignReading, SignRules
from onboard.poi.signs.text_line import TextLine, around

HALF_WIDTH_M, LOW_M, HIGH_M = 0.45, 1.12, 1.88  # what is read around a candidate
NICENESS = 10  # of the thread
LATENCY_S = 0.5  # simulated
_BORDER = 0.4  # a line nearer to the border than this share of its height is cut off


class Reader(Protocol):
    """An OCR engine, as `ocr_engine.SignReader` implements it."""

    def lines(self, image: Image) -> list[TextLine]:
        """All lines of text, with their places in pixels of `image`."""


@dataclass(frozen=True, slots=True)
class Job:
    """A full frame, where it was taken from, and the part of it that may be a sign."""

    frame: Frame
    pose: Pose2
    wall: WallLine
    candidate: Box


@dataclass(frozen=True, slots=True)
class Finding:
    """One sign that was read; `u_px` is its middle column in the full frame. `sharpness` is that of its own part."""

    reading: SignReading
    u_px: float
    sharpness: Sharpness


@dataclass(frozen=True, slots=True)
class Reading:
    """The result of a job; no finding = nothing legible. `read`: there was an engine to read it."""

    job: Job
    findings: tuple[Finding, ...]
    read: bool = True


def read(job: Job, reader: Reader, rules: SignRules, camera: CameraModel) -> Reading:
    """Reads the signs around the candidate, without those that the border of that part cuts off.

    The part is read in the frame's own size, whatever that is; `camera` gives the lens.
    """
    image, depth_m = job.frame.image, job.wall.distance_m
    camera = camera.resized(image.shape[1], image.shape[0])
    m_per_px = camera.metres_per_px(depth_m)
    top, bottom = (min(max(round(camera.row_px(z, depth_m)), 0), camera.height_px) for z in (HIGH_M, LOW_M))
    centre_px = job.candidate.centre_px[0]
    half_px = max(HALF_WIDTH_M / m_per_px, job.candidate.width_px)
    left, right = max(round(centre_px - half_px), 0), min(round(centre_px + half_px), camera.width_px)
    part = image[top:bottom, left:right]
    findings = []
    for lines in signs(reader.lines(part)):
        if any(_cut_off(line, part.shape[1]) for line in lines):
            continue
        reading = rules.judge(lines, m_per_px, part.shape[0])
        x, y, width, height = reading.box
        beside = cv2.cvtColor(
            part[max(int(y - height / 2), 0) : int(y + 1.5 * height) + 1, max(int(x - 8), 0) : int(x + width + 8) + 1],
            cv2.COLOR_BGR2GRAY,
        )
        findings.append(Finding(reading, left + x + width / 2, sharpness(beside)))
    return Reading(job, tuple(findings))


def _cut_off(line: TextLine, width_px: int) -> bool:
    border = _BORDER * line.letter_px
    x, _, width, _ = around([line])
    return x < border or x + width > width_px - border


Read = Callable[[Job], Reading]
ReadingWorker = SideWorker[Job, Reading]


def deferred_reading(load: Callable[[], Read]) -> ReadingWorker:
    """For lockstep: a reading comes LATENCY_S of simulated time after its job, whatever it took."""
    return DeferredWorker(load, LATENCY_S)


def reading_beside(load: Callable[[], Read]) -> ReadingWorker:
    """For the robot: on a thread of low priority, which waits for nobody, since OpenCV releases the interpreter."""
    return ThreadWorker("reading", load, niceness=NICENESS)
