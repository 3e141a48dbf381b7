"""Pictures that a camera should not give: none, the same again, black, white, or far too few."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from common.errors import ErrorCode, StartError
from onboard.poi.camera import frames_beside
from onboard.poi.camera.frame import Frame, Image
from onboard.poi.camera.frame_health import FrameHealth
from onboard.poi.camera.frames_beside import FramesBeside, camera_source, is_camera

PERIOD_S = 0.4
STEP_M = 0.064


def plain(grey: int) -> Image:
    return np.full((480, 640, 3), grey, np.uint8)


def edge(at: int, grey: int = 200) -> Image:
    """A wall whose colour changes in one column."""
    image = plain(grey)
    image[:, at:] = 60
    return image


def after(pictures: list[Image], period_s: float = PERIOD_S, step_m: float = STEP_M) -> tuple[ErrorCode, list[bool]]:
    """The fault after these pictures, from a robot that drives, and which of them may be looked at."""
    health = FrameHealth()
    health.fault(0.0)
    taken = [health.takes(image, period_s * i, step_m * i) for i, image in enumerate(pictures, 1)]
    return health.fault(period_s * len(pictures) + 0.05), taken


def test_pictures_of_a_wall_that_the_robot_passes_are_all_new() -> None:
    assert after([edge(500 - 20 * i) for i in range(10)]) == (ErrorCode.OK, [True] * 10)


def test_picture_that_comes_again_while_the_robot_drives_is_left_out_and_reported() -> None:
    fault, taken = after([edge(500)] * 10)
    assert fault is ErrorCode.FRAMES_FROZEN
    assert taken == [True] + [False] * 9


def test_picture_that_comes_again_while_the_robot_stands_is_no_fault() -> None:
    assert after([edge(500)] * 10, step_m=0.0) == (ErrorCode.OK, [True] * 10)


def test_plain_wall_of_a_camera_without_noise_is_no_fault() -> None:
    assert after([plain(220)] * 10)[0] is ErrorCode.OK


@pytest.mark.parametrize(("grey", "fault"), [(3, ErrorCode.FRAMES_DARK), (255, ErrorCode.FRAMES_BRIGHT)])
def test_black_and_white_pictures_are_a_fault_that_heals(grey: int, fault: ErrorCode) -> None:
    noise = np.random.default_rng(1)
    pictures = [cv2.subtract(plain(grey), noise.integers(0, 3, (480, 640, 3)).astype(np.uint8)) for _ in range(6)]
    assert after(pictures[:3])[0] is ErrorCode.OK
    assert after(pictures)[0] is fault
    assert after([*pictures, edge(300)])[0] is ErrorCode.OK


def test_camera_that_is_ten_times_too_slow_is_slow_and_not_away() -> None:
    pictures = [edge(500 - 20 * i) for i in range(5)]
    health = FrameHealth()
    for i, image in enumerate(pictures):
        health.takes(image, 4.0 * i, 0.64 * i)
    assert {health.fault(16.0 + t) for t in (0.1, 2.5, 3.9)} == {ErrorCode.FRAMES_RARE}
    assert health.fault(30.0) is ErrorCode.NO_FRAMES


def test_pictures_that_nobody_looked_at_are_not_missing() -> None:
    health = FrameHealth()
    health.takes(edge(500), 0.0, 0.0)
    health.paused(60.0)
    assert health.fault(60.05) is ErrorCode.OK
    health.takes(edge(400), 60.3, 0.0)
    assert health.fault(60.35) is ErrorCode.OK


# A camera whose driver blocks


class Driver:
    """Gives a picture every time, blocks while `blocked`, and none once it was unplugged."""

    def __init__(self) -> None:
        self.blocked, self.unplugged, self.closed = threading.Event(), False, False
        self.blocked.set()
        self._wanted = False

    def preview(self, now_s: float) -> Frame | None:
        self.blocked.wait(20.0)
        return None if self.unplugged else Frame(now_s, plain(100))

    def request_full(self) -> None:
        self._wanted = True

    def full(self, now_s: float) -> Frame | None:
        return None if self.unplugged else Frame(now_s, plain(101))

    def close(self) -> None:
        self.closed = True


def until(condition: Callable[[], Any], within_s: float = 20.0) -> Any:
    deadline_s = time.monotonic() + within_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s, "waited too long"
        time.sleep(0.005)
    return value


def test_driver_that_blocks_holds_up_no_step() -> None:
    driver = Driver()
    source = FramesBeside(lambda: driver)
    assert until(lambda: source.preview(5.0)).t_s == pytest.approx(5.0, abs=2.0)
    source.request_full()
    assert until(lambda: source.full(5.0)).image[0, 0, 0] == 101
    driver.blocked.clear()
    time.sleep(0.1)
    source.preview(6.0)
    began_s = time.monotonic()
    assert [source.preview(7.0) for _ in range(100)] == [None] * 100
    assert time.monotonic() - began_s < 5.0
    driver.blocked.set()
    until(lambda: source.preview(8.0))
    source.close()
    until(lambda: driver.closed)


def test_camera_that_was_unplugged_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames_beside, "REOPENED_S", 0.05)
    first, second = Driver(), Driver()
    answers: list[Driver | StartError] = [first, StartError("no camera answers"), second]

    def opened() -> Driver:
        answer = answers.pop(0)
        if isinstance(answer, StartError):
            raise answer
        return answer

    source = FramesBeside(opened)
    until(lambda: source.preview(0.0))
    first.unplugged = True
    until(lambda: not answers)
    until(lambda: source.preview(1.0))
    assert first.closed
    source.close()


def test_camera_that_is_not_there_at_the_start_is_reported_in_a_sentence() -> None:
    assert is_camera("picamera")
    assert is_camera("0")
    assert not is_camera("unix:frames")
    with pytest.raises(StartError, match="camera"):
        camera_source("/dev/video97")
