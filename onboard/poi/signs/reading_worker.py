"""OCR beside the steps, since it takes longer than one: jobs in, readings out some steps later.

On the robot a thread of low priority reads. In lockstep, where nothing may depend on this machine's speed, a job is
done at once and its reading is handed out after a fixed time.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import cv2

from common.geometry import Pose2
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Frame, Image
from onboard.poi.camera.sharpness import Sharpness, sharpness
from onboard.poi.placement.wall_line import WallLine
from onboard.poi.signs.sign_detection import Box
from onboard.poi.signs.sign_reading import SignReading, SignRules, TextLine, signs

HALF_WIDTH_M, LOW_M, HIGH_M = 0.45, 1.12, 1.88  # what is read around a candidate
PX_PER_M = 840.0  # a plate of 30 mm capitals is legible; more pixels cost time and add nothing
JOBS_MAX = 4  # waiting; further ones are dropped
NICENESS = 10  # of the thread
LATENCY_S = 0.5  # simulated
_BORDER = 0.4  # a line nearer to the border than this share of its height is cut off

_log = logging.getLogger("poi")


class Reader(Protocol):
    """An OCR engine, as `sign_reading.SignReader` implements it."""

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
    """The result of a job; no finding = nothing legible."""

    job: Job
    findings: tuple[Finding, ...]


def read(job: Job, reader: Reader, rules: SignRules, camera: CameraModel) -> Reading:
    """Reads the signs around the candidate, without those that the border of that part cuts off."""
    depth_m = job.wall.distance_m
    m_per_px = camera.metres_per_px(depth_m)
    top, bottom = (min(max(round(camera.row_px(z, depth_m)), 0), camera.height_px) for z in (HIGH_M, LOW_M))
    centre_px = job.candidate.centre_px[0]
    half_px = max(HALF_WIDTH_M / m_per_px, job.candidate.width_px)
    left, right = max(round(centre_px - half_px), 0), min(round(centre_px + half_px), camera.width_px)
    part = job.frame.image[top:bottom, left:right]
    scale = min(1.0, PX_PER_M * m_per_px)
    if scale < 1.0:
        part = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    findings = []
    for lines in signs(reader.lines(part)):
        if any(_cut_off(line, part.shape[1]) for line in lines):
            continue
        reading = rules.judge(lines, m_per_px / scale, part.shape[0])
        x, y, width, height = reading.box
        around = cv2.cvtColor(
            part[max(int(y - height / 2), 0) : int(y + 1.5 * height) + 1, max(int(x - 8), 0) : int(x + width + 8) + 1],
            cv2.COLOR_BGR2GRAY,
        )
        findings.append(Finding(reading, left + (x + width / 2) / scale, sharpness(around)))
    return Reading(job, tuple(findings))


def _cut_off(line: TextLine, width_px: int) -> bool:
    border = _BORDER * line.height_px
    return line.x_px < border or line.right_px > width_px - border


class ReadingWorker(Protocol):
    """Takes jobs and hands their readings out in the same order; neither call waits."""

    @property
    def pending(self) -> int:
        """How many jobs have no reading yet."""

    @property
    def ready(self) -> bool:
        """The models are loaded."""

    def submit(self, job: Job, now_s: float) -> None:
        """Takes a job; a worker with too many drops it."""

    def results(self, now_s: float) -> list[Reading]:
        """The readings that became ready since the last call, oldest first."""

    def close(self) -> None: ...


Read = Callable[[Job], Reading]


class DeferredReading:
    """Lockstep: a result comes LATENCY_S of simulated time after its job, whatever the reading took."""

    ready = True

    def __init__(self, load: Callable[[], Read]) -> None:
        self._load = load
        self._read: Read | None = None
        self._waiting: deque[tuple[float, Reading]] = deque()

    @property
    def pending(self) -> int:
        return len(self._waiting)

    def submit(self, job: Job, now_s: float) -> None:
        if self._read is None:
            self._read = self._load()
        self._waiting.append((now_s + LATENCY_S, self._read(job)))

    def results(self, now_s: float) -> list[Reading]:
        due = []
        while self._waiting and self._waiting[0][0] <= now_s:
            due.append(self._waiting.popleft()[1])
        return due

    def close(self) -> None:
        """Nothing runs."""


class ThreadWorker:
    """The robot: a thread of low priority. It refuses more than JOBS_MAX."""

    def __init__(self, load: Callable[[], Read]) -> None:
        self._thread = ThreadPoolExecutor(1, "reading", initializer=_yield_to_others)
        self._read = self._thread.submit(load)
        self._jobs: deque[Future[Reading]] = deque()

    @property
    def pending(self) -> int:
        return len(self._jobs)

    @property
    def ready(self) -> bool:
        return self._read.done()

    def submit(self, job: Job, now_s: float) -> None:
        if len(self._jobs) >= JOBS_MAX:
            _log.info("reading=behind dropped_job_t_s=%.2f", now_s)
            return
        self._jobs.append(self._thread.submit(lambda: self._read.result()(job)))

    def results(self, now_s: float) -> list[Reading]:
        """The readings that are done. Raises what the thread raised, which ends the process."""
        if self._read.done():
            self._read.result()
        done = []
        while self._jobs and self._jobs[0].done():
            done.append(self._jobs.popleft().result())
        return done

    def close(self) -> None:
        self._thread.shutdown(wait=True, cancel_futures=True)


def _yield_to_others() -> None:
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
